"""A robot that differs from its model, moved by its drives: what a recording of it would hold.

Effects enter through their `phantom_dyn.effects.effect.Simulated` channels, in the order in which they are given:
command -> drive -> transmission -> links -> reading. Friction, rotor and the effects' torques act on the motor's side
of a transmission that is not rigid.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from phantom_dyn.effects.effect import Effect, Moment, Simulated
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion, read_only
from phantom_dyn.robot import Robot
from phantom_dyn.stepping import Machine, State, in_balance, longest_step, machine_of, stepped

Array = np.ndarray

# What a drive is asked for [N m or N], shape (nv,), from time, position readings and velocities at the encoders.
Controller = Callable[[float, Array, Array], Array]
# No robot moves at this speed [rad/s or m/s]: the integration has blown up, or the drives push without end.
_TOO_FAST = 1e6


@dataclass(frozen=True)
class Cause:
    """An effect in its place with the contract's parameters in order."""

    effect: Effect
    joint: str | None
    theta: Float[Array, " p"]


@dataclass(frozen=True)
class Simulation:
    """What a recording of the robot holds, and what it does not.

    Attributes:
        t: Time [s], shape ``(N,)``.
        q: Position readings [rad or m], shape ``(N, nv)``.
        tau: Torque columns, shape ``(N, nv)``: what was asked of the drives, or what they gave if ``torque_source``
            is ``sensor``.
        encoders: True motion where the encoders sit (motor or link), without what readings add.
        links: True motion of the links.
    """

    t: Float[Array, " N"]
    q: Float[Array, "N nv"]
    tau: Float[Array, "N nv"]
    encoders: Motion = field(repr=False)
    links: Motion = field(repr=False)

    def __post_init__(self):
        for name in ("t", "q", "tau"):
            object.__setattr__(self, name, read_only(getattr(self, name)))


def simulate(
    robot: Robot,
    causes: tuple[Cause, ...],
    controller: Controller,
    t: Float[Array, " N"],
    q0: Float[Array, " nv"],
    v0: Float[Array, " nv"] | None = None,
    *,
    max_step: float = 5e-4,
) -> Simulation:
    """Motion of ``robot`` with ``causes`` in it, from ``q0``, ``v0`` at ``t[0]``.

    The torque is held from ``t[k]`` to ``t[k+1]`` if ``robot.torque_hold`` is ``zoh``, else it follows the controller
    at every step. Accelerations are means over one step before and one after a sample.

    Args:
        robot: The given model.
        causes: What the real robot has besides.
        controller: Torque from time, readings and velocities; a plain function, without memory.
        t: Sample times [s], increasing, of any spacing.
        q0: True link positions at the start [rad or m].
        v0: True link velocities at the start; 0 by default.
        max_step: Longest step [s]; transmissions take shorter ones by themselves.

    Raises:
        ParameterError: If times do not increase, an array has the wrong length, a motor without inertia would have to
            move by itself, or the motion leaves all bounds.
    """
    v0 = np.zeros(robot.nv) if v0 is None else v0
    _check(robot, t, q0, v0)
    parts = tuple(cause.effect.simulated(robot, cause.joint, np.asarray(cause.theta, dtype=float)) for cause in causes)
    true = robot
    for part in parts:
        true = true if part.robot is None else part.robot(true)
    machine = machine_of(true, tuple(part.transmission for part in parts if part.transmission is not None))
    channels = _Channels(machine, parts, controller, held=robot.torque_hold == "zoh")
    state, rows = in_balance(machine, np.asarray(q0, dtype=float), np.asarray(v0, dtype=float)), []
    limit = min(max_step, longest_step(machine, q0))
    for k in range(len(t)):
        before, after = state, state.a
        asked, given = channels.sample(float(t[k]), state)
        if k + 1 < len(t):
            count = int(np.ceil((t[k + 1] - t[k]) / limit - 1e-9))
            h = float(t[k + 1] - t[k]) / count
            for i in range(count):
                state = stepped(machine, state, float(t[k]) + i * h, h, channels.torques(h))
                _require_bounded(state, float(t[k]))
                if i == 0:
                    after = state.a
        logged = given if robot.torque_source == "sensor" else asked
        a = after if k == 0 else (before.a if k + 1 == len(t) else 0.5 * (before.a + after))
        rows.append((channels.reading(before), logged, before.x, before.v, a))
    return _recorded(machine, t, rows)


def _check(robot: Robot, t: Array, q0: Array, v0: Array) -> None:
    if len(t) < 2 or not (np.diff(t) > 0).all():
        raise ParameterError("The times of a simulation do not increase: give at least two, each later than the last.")
    for name, values in (("q0", q0), ("v0", v0)):
        if np.shape(values) != (robot.nv,):
            raise ParameterError(f"{name} has shape {np.shape(values)}, wanted {robot.nv} numbers, one a joint.")


def _require_bounded(state: State, t: float) -> None:
    if not np.abs(state.v).max() < _TOO_FAST:
        raise ParameterError(
            f"The motion leaves all bounds after {t:.4g} s: check controller and parameters, or shorten max_step."
        )


def _recorded(machine: Machine, t: Array, rows: list[tuple[Array, ...]]) -> Simulation:
    q, tau, x, v, a = (np.array(column) for column in zip(*rows, strict=True))
    nv, seen = machine.robot.nv, list(_encoder_places(machine))
    links = Motion(t, x[:, :nv], v[:, :nv], a[:, :nv])
    return Simulation(t, q, tau, Motion(t, x[:, seen], v[:, seen], a[:, seen]), links)


def _encoder_places(machine: Machine) -> tuple[int, ...]:
    """Where in the state each joint's encoder sits."""
    sides = (actuator.encoder_side for actuator in machine.robot.actuators)
    return tuple(
        drive if side == "motor" else j for j, (drive, side) in enumerate(zip(machine.drives, sides, strict=True))
    )


class _Channels:
    """The effects' channels with their states, which move on with every step."""

    def __init__(self, machine: Machine, parts: tuple[Simulated, ...], controller: Controller, *, held: bool):
        self._controller, self._held = controller, held
        self._seen, self._drives = list(_encoder_places(machine)), list(machine.drives)
        self._readings = [part.reading for part in parts if part.reading is not None]
        self._commands = [part.command for part in parts if part.command is not None]
        self._laws = [part.torque for part in parts if part.torque is not None]
        self._command_states = [part.start for part in parts if part.command is not None]
        self._law_states = [part.start for part in parts if part.torque is not None]
        self._asked = np.zeros(machine.robot.nv)
        self._given: Array | None = None

    def reading(self, state: State) -> Array:
        """Position readings of a state."""
        return self._read(state.x[self._seen])

    def _read(self, q: Array) -> Array:
        for reading in self._readings:
            q = reading(q)
        return q

    def sample(self, t: float, state: State) -> tuple[Array, Array]:
        """What the drives are asked for at a sample, and what they gave in the step before it."""
        self._asked = self._ask(t, state.x, state.v)
        return self._asked, self._asked if self._given is None else self._given

    def _ask(self, t: float, x: Array, v: Array) -> Array:
        return np.asarray(self._controller(t, self._read(x[self._seen]), v[self._seen]), dtype=float)

    def torques(self, h: float) -> Callable[[float, Array, Array, Array], tuple[Array, Array]]:
        """Drive torque and the effects' torques for one step of ``h`` seconds."""

        def at(t: float, x: Array, v: Array, transmitted: Array) -> tuple[Array, Array]:
            tau = self._asked if self._held else self._ask(t, x, v)
            for i, command in enumerate(self._commands):
                self._command_states[i], tau = command(self._command_states[i], h, tau)
            self._given = tau
            added = np.zeros(len(tau))
            if not self._laws:
                return tau, added
            moment = Moment(t, x[self._drives], v[self._drives], transmitted)
            for i, law in enumerate(self._laws):
                self._law_states[i], torque = law(self._law_states[i], h, moment)
                added = added + torque
            return tau, added

        return at
