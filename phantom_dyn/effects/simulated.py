"""What an effect changes in a simulation: torques, commands, readings or the robot, by compiled laws or functions."""

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
SPRING_DAMPING = 0.05
"""Damping ratio of link and motor on the spring between them; gears and belts have 0.02 to 0.1."""
SWING_DAMPING = 0.1
"""Damping ratio of a link on a stiff spring, if its motion is computed from recordings. At the resonance of such a
spring the reading of the motor is mostly noise, which a smaller ratio would amplify more."""
Channel = Literal["torque", "command", "reading"]
"""What a law changes: the torque on its joint, the torque that a drive gives for a command, or an encoder's reading."""


@dataclass(frozen=True)
class Moment:
    """State of a simulation at one instant, the input of a torque law; arrays have one entry per joint.

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
    """A joint with a spring, a damper and a play of full width ``gap`` between motor and link."""

    joint: str
    stiffness: float
    damping: float
    gap: float


def torque_law(function: F) -> F:
    """Mark a compiled function as a law that adds a torque on its joint, so that `compiled_laws` collects it.

    All arguments are scalars. The inputs come first: ``q``, ``v`` and ``load`` (position, velocity and transmitted
    torque), of which a law takes those that it needs, in this order. The parameters follow. A law with a memory has
    further arguments before the inputs: ``last``, the position at the step before, and at most two numbers of memory.
    It returns the new numbers of memory, then its torque.
    """
    return _marked(function, "torque")


def command_law(function: F) -> F:
    """Mark a compiled function as a law that gives the torque of a drive for the command ``tau``, see `torque_law`.

    Its arguments are ``tau`` and its parameter. A law with a memory takes one remembered number before ``tau`` and the
    length ``dt`` of the step after it, and returns the new number, then the torque.
    """
    return _marked(function, "command")


def reading_law(function: F) -> F:
    """Mark a compiled function as a law that gives the reading of an encoder, from position and parameters."""
    return _marked(function, "reading")


def _marked(function: F, channel: Channel) -> F:
    setattr(function, _MARK, channel)
    return function


def channel_of(function: object) -> Channel | None:
    """Channel of a marked law; None for any other object."""
    return getattr(function, _MARK, None)


@dataclass(frozen=True)
class Law:
    """A marked law on one joint, with its parameters.

    Attributes:
        function: Compiled law on scalars, see `torque_law`, `command_law` and `reading_law`.
        row: Index of the joint.
        numbers: Parameters of the law, at most four.
        start: State at the start, at most three numbers.
        other: Index of a second joint, for a coupling of two joints.
        share: Factor of the second joint: ``share`` times its velocity is added to ``v``, and ``share`` times the
            torque of the law acts on it. Zero if there is no second joint.
    """

    function: Callable
    row: int
    numbers: tuple[float, ...] = ()
    start: tuple[float, ...] = ()
    other: int = 0
    share: float = 0.0


@dataclass(frozen=True)
class Simulated:
    """What one effect changes in a simulation, and its state; None means no change.

    Attributes:
        start: State at the start.
        robot: Function that returns the changed robot.
        command: ``(state, dt, tau) -> (state, tau)``: torque that the drive gives for the command ``tau``.
        series: ``(t, tau) -> tau``: the same as ``command``, for all commands ``(N, nv)`` at uniform times, starting
            in equilibrium at the first one; None if ``command`` has to be called step by step.
        limit: Largest torque that ``command`` gives, if ``command`` only clips.
        torque: ``(state, dt, moment) -> (state, torque)``: torque that the effect adds on the joints.
        reading: Position readings ``(nv,)`` from true positions at the encoders.
        transmission: A transmission that is not rigid.
        inertia: Matrix that is added to the mass matrix, shape ``(nv, nv)``.
        reference_delay: Delay [s] of the references of each joint's controller, shape ``(nv,)``.
        laws: Compiled laws. If ``torque``, ``command`` or ``reading`` is not given, it is made from the laws. It is
            used in simulations that are stepped in Python because another effect has no compiled law.
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
        """Torque that the drive gives for commands ``tau`` at uniform times; it starts in equilibrium."""
        if self.command is None:
            return tau
        if self.series is not None:
            return self.series(t, tau)
        state, out = self.start, np.empty_like(tau)
        # The last time step is taken as long as the one before.
        for k, step in enumerate(np.diff(t, append=2.0 * t[-1] - t[-2])):
            state, out[k] = self.command(state, float(step), tau[k])
        return out


def _torque_of(laws: list[Law]) -> Callable[[Array, float, Moment], tuple[Array, Array]]:
    """Torque of all laws together; at most one of them has a memory."""
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
                *new, tau = tau
                state = np.array([inputs["q"], *new, *state[len(remembered) :]])
            out[law.row] += tau
            out[law.other] += law.share * tau
        return state, out

    return torque


def _command_of(laws: list[Law]) -> Callable[[Array, float, Array], tuple[Array, Array]]:
    """Torque of all drives; the state has one number for each law, used by laws with a memory only."""

    def command(state: Array, dt: float, tau: Array) -> tuple[Array, Array]:
        new_state, out = state.copy(), tau.copy()
        for k, law in enumerate(laws):
            if law.start:
                new_state[k], out[law.row] = law.function(state[k], tau[law.row], dt, *law.numbers)
            else:
                out[law.row] = law.function(tau[law.row], *law.numbers)
        return new_state, out

    return command


def _reading_of(laws: list[Law]) -> Callable[[Array], Array]:
    """Readings of all joints, for one sample or many."""

    def reading(q: Array) -> Array:
        out = np.array(q, dtype=float)
        for law in laws:
            out[..., law.row] = law.function(out[..., law.row], *law.numbers)
        return out

    return reading
