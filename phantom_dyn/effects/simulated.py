"""How an effect enters a simulation: the channels that it changes, as compiled laws of joints or Python functions."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, TypeVar

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot

F = TypeVar("F", bound=Callable[..., Any])

_MARK = "_channel_of_a_simulation"
# Damping ratio of link and motor on a spring between them; gears and belts have 0.02 to 0.1.
SPRING_DAMPING = 0.05
# The same of a link alone on a stiff spring, as it is computed from recordings. At the frequency of such a spring much
# of what is read is noise, since the motor nearly stands still: less damping would amplify it more.
SWING_DAMPING = 0.1
Channel = Literal["torque", "command", "reading"]


@dataclass(frozen=True)
class Moment:
    """One instant of a simulation, as a torque law sees it; arrays have one entry per joint.

    Attributes:
        t: Time [s].
        q: True joint positions [rad or m].
        v: True joint velocities.
        transmitted: Torque that the transmissions pass to the links.
    """

    t: float
    q: Float[Array, " nv"]
    v: Float[Array, " nv"]
    transmitted: Float[Array, " nv"]


@dataclass(frozen=True)
class Transmission:
    """A joint whose motor and link may move apart: a spring behind a play of full width ``gap``."""

    joint: str
    stiffness: float
    damping: float
    gap: float


def torque_law(function: F) -> F:
    """Mark a compiled function as a law that adds a torque on its joint, so that `compiled_laws` gathers it.

    Its arguments are scalars: of ``q``, ``v`` and ``load`` (position, velocity and transmitted torque of the moment)
    those that it needs, then its parameters. A law with a memory has ``last`` (position of the step before) and what it
    remembers in front, two numbers at most, and returns what it remembers now before its torque.
    """
    return _marked(function, "torque")


def command_law(function: F) -> F:
    """Mark a compiled function as a law of what a drive gives when ``tau`` is asked for, see `torque_law`.

    Its arguments are ``tau`` and its parameter. A law with a memory has one number in front and ``dt``, the length of
    the step, behind ``tau``, and returns the next number before what the drive gives.
    """
    return _marked(function, "command")


def reading_law(function: F) -> F:
    """Mark a compiled function as a law of what an encoder reads at position ``q``, its parameters behind it."""
    return _marked(function, "reading")


def _marked(function: F, channel: Channel) -> F:
    setattr(function, _MARK, channel)
    return function


def channel_of(function: object) -> Channel | None:
    """Channel of a law that is marked; None for anything else."""
    return getattr(function, _MARK, None)


@dataclass(frozen=True)
class Law:
    """A channel of `Simulated` on one joint, for compiled steps: a function that is marked as a law of that channel.

    Attributes:
        function: Compiled law on scalars, in the effect's own file.
        row: The joint.
        numbers: Its parameters, at most four.
        start: Its state at the start, at most three numbers.
        other: A joint whose speed counts too, ``share`` times, and that takes ``share`` of the torque.
        share: Speed and torque that count of ``other``, per unit; zero without one.
    """

    function: Callable
    row: int
    numbers: tuple[float, ...] = ()
    start: tuple[float, ...] = ()
    other: int = 0
    share: float = 0.0


@dataclass(frozen=True)
class Simulated:
    """How one effect enters a simulation: the channels that it changes, and its state; None leaves a channel alone.

    Attributes:
        start: State at the start.
        robot: Rigid-body model that moves instead of the given one.
        command: ``(state, dt, tau) -> (state, tau)``: what the drive gives when ``tau`` is asked for.
        series: ``(t, tau) -> tau``: the same for a torque ``(N, nv)`` that is asked for at uniform times, the drive in
            balance at the first; None where ``command`` has to be stepped through.
        limit: Torque beyond which ``command`` gives no more, where that is all it does.
        torque: ``(state, dt, moment) -> (state, torque)``: torque that it adds on the joints.
        reading: Position readings ``(nv,)`` from true positions at the encoders.
        transmission: A motor that is not rigidly tied to its link.
        inertia: What it adds to the joints' mass matrix, shape ``(nv, nv)``.
        reference_delay: Time [s] by which the references of each joint's controller arrive late, shape ``(nv,)``.
        laws: Compiled laws of joints; of those of a channel that is not given above its Python function is made, for
            steps beside an effect that has Python functions only.
    """

    start: Float[Array, " s"] = field(default_factory=lambda: np.zeros(0))
    robot: Callable[[Robot], Robot] | None = None
    command: Callable[[Array, float, Array], tuple[Array, Array]] | None = None
    series: Callable[[Array, Array], Array] | None = None
    limit: float | None = None
    torque: Callable[[Array, float, Moment], tuple[Array, Array]] | None = None
    reading: Callable[[Array], Array] | None = None
    transmission: Transmission | None = None
    inertia: Float[Array, "nv nv"] | None = None
    reference_delay: Float[Array, " nv"] | None = None
    laws: tuple[Law, ...] = ()

    def __post_init__(self):
        for channel, made in (("torque", _torque_of), ("command", _command_of), ("reading", _reading_of)):
            own = [law for law in self.laws if channel_of(law.function) == channel]
            if own and getattr(self, channel) is None:
                object.__setattr__(self, channel, made(own))

    def given(self, t: Float[Array, " N"], tau: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
        """Torque that the drive gives at uniform times when ``tau`` is asked for; it starts in balance."""
        if self.command is None:
            return tau
        if self.series is not None:
            return self.series(t, tau)
        state, out = self.start, np.empty_like(tau)
        for k, step in enumerate(np.diff(t, append=2.0 * t[-1] - t[-2])):
            state, out[k] = self.command(state, float(step), tau[k])
        return out


def _torque_of(laws: list[Law]) -> Callable[[Array, float, Moment], tuple[Array, Array]]:
    """Torque of all laws together, of which one that remembers is alone."""
    arguments = [tuple(inspect.signature(law.function).parameters) for law in laws]

    def torque(state: Array, dt: float, moment: Moment) -> tuple[Array, Array]:
        out = np.zeros(len(moment.v))
        for law, names in zip(laws, arguments, strict=True):
            speed = moment.v[law.row] + law.share * moment.v[law.other]
            inputs = {"q": moment.q[law.row], "v": speed, "load": moment.transmitted[law.row]}
            given = [inputs[name] for name in names if name in inputs]
            remembered = state[: len(names) - len(given) - len(law.numbers)]
            tau = law.function(*remembered, *given, *law.numbers)
            if len(remembered):
                *now, tau = tau
                state = np.array([inputs["q"], *now, *state[len(remembered) :]])
            out[law.row] += tau
            out[law.other] += law.share * tau
        return state, out

    return torque


def _command_of(laws: list[Law]) -> Callable[[Array, float, Array], tuple[Array, Array]]:
    """What all drives give; the state has one number of each if they remember."""

    def command(state: Array, dt: float, tau: Array) -> tuple[Array, Array]:
        now, out = state.copy(), tau.copy()
        for k, law in enumerate(laws):
            if law.start:
                now[k], out[law.row] = law.function(state[k], tau[law.row], dt, *law.numbers)
            else:
                out[law.row] = law.function(tau[law.row], *law.numbers)
        return now, out

    return command


def _reading_of(laws: list[Law]) -> Callable[[Array], Array]:
    """Readings of all joints, also of many samples."""

    def reading(q: Array) -> Array:
        out = np.array(q, dtype=float)
        for law in laws:
            out[..., law.row] = law.function(out[..., law.row], *law.numbers)
        return out

    return reading
