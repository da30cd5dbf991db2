"""Simulates the recording of a robot that differs from its model by effects, and whose drives follow a controller.

Effects change the signals between controller and recording (`phantom_dyn.effects.simulated.Simulated`): command ->
drive -> transmission -> links -> reading. Several effects on one signal act in the order in which they are given.
Friction, rotor and torques of effects act on the motor's side of an elastic transmission.

There are three ways to compute the steps:

- Each effect has a compiled law, and the controller is a `phantom_dyn.simulation.control.Tracking`: all steps are
  compiled, and no Python runs between the first and the last sample.
- Each effect has a compiled law, and the controller is a Python function: each step is compiled.
- An effect has no compiled law: all steps are computed in Python, and `Channels` evaluates the laws.

Compiled steps do not hold the GIL.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.simulated import Moment, Simulated
from phantom_dyn.errors import ParameterError, RunawayError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion, Motion
from phantom_dyn.simulation.compiled.arm_steps import Arm, run_arm
from phantom_dyn.simulation.compiled.arrays import EffectLaws, Moving, Plan, Rows, moving_from, rows_for
from phantom_dyn.simulation.compiled_machine import compiled, control_of, require_closed_loops
from phantom_dyn.simulation.control import Tracking, with_late_references
from phantom_dyn.simulation.stepping import Machine, State, in_balance, longest_step, machine_of, stepped, with_motors

Controller = Callable[[float, Array, Array], Array]
"""Commanded torque of the drives [N m or N], (nv,), from time, position readings and velocities at the encoders."""
# Speed [rad/s or m/s] that no robot reaches: a higher speed means that the simulation diverged.
_TOO_FAST = 1e6
# Names of the initial positions and velocities of the motors in messages.
_MOTORS = ("motors[0]", "motors[1]")


@dataclass(frozen=True)
class Cause:
    """An effect of the simulated robot, its joint (None for the whole robot), and its parameters in their order."""

    effect: Effect
    joint: str | None
    theta: Float[Array, " p"]


@dataclass(frozen=True)
class Given:
    """Initial state of the motors, and motion of the base.

    Attributes:
        motors: Initial positions and velocities of the motors on elastic transmissions, one for each joint; values of
            joints with a rigid transmission are ignored. None: at the start each transmission carries the load of its
            link at constant speed.
        base: Motion of the root of a floating robot at the times of the samples; it is interpolated linearly.
    """

    motors: tuple[Float[Array, " nv"], Float[Array, " nv"]] | None = None
    base: BaseMotion | None = None


@dataclass(frozen=True)
class Simulation(ReadOnlyArrays):
    """Recorded signals of the robot, and its true motion.

    Attributes:
        t: Time [s], shape ``(N,)``.
        q: Position readings [rad or m], shape ``(N, nv)``.
        tau: Torque columns, shape ``(N, nv)``: the commanded torque, or the torque of the drives if ``torque_source``
            is ``sensor``.
        encoders: True motion where the encoders are (motor or link), without the effects on readings.
        links: True motion of the links.
    """

    t: Float[Array, " N"]
    q: Float[Array, "N nv"]
    tau: Float[Array, "N nv"]
    encoders: Motion = field(repr=False)
    links: Motion = field(repr=False)


def simulate(
    robot: Robot,
    causes: tuple[Cause, ...],
    controller: Controller,
    t: Float[Array, " N"],
    q0: Float[Array, " nv"],
    v0: Float[Array, " nv"] | None = None,
    *,
    max_step: float = 5e-4,
    given: Given = Given(),
) -> Simulation:
    """Simulate ``robot`` with the effects ``causes``, from ``q0``, ``v0`` at ``t[0]``.

    The torque is held from ``t[k]`` to ``t[k+1]`` if ``robot.torque_hold`` is ``zoh``. Otherwise the controller is
    evaluated at every step. Accelerations are means over one step before and one step after a sample.

    Args:
        robot: The given model.
        causes: Effects that the real robot has in addition.
        controller: Torque from time, readings and velocities; a function without memory.
        t: Sample times [s], increasing, with any spacing.
        q0: True link positions at the start [rad or m].
        v0: True link velocities at the start; 0 by default.
        max_step: Longest step [s]; elastic transmissions may need shorter steps.
        given: Initial state of the motors and motion of the base.

    Raises:
        ParameterError: If times do not increase, an array has the wrong length, a motor on an elastic transmission has
            no inertia, or the simulation diverges.
        RobotError: If the base is not bolted down and its motion is missing.
        ChainError: If a loop of a closed chain cannot be closed, or is singular, at a position of the motion.
    """
    v0 = np.zeros(robot.nv) if v0 is None else v0
    starts = {"q0": q0, "v0": v0} | ({} if given.motors is None else dict(zip(_MOTORS, given.motors, strict=True)))
    _check(robot, controller, t, starts, max_step)
    base = np.zeros((0, 9)) if given.base is None else given.base.columns
    if given.base is not None and len(base) != len(t):
        raise ParameterError(f"The motion of the base has {len(base)} samples, wanted {len(t)}, one a time.")
    parts = tuple(cause.effect.simulated(robot, cause.joint, np.asarray(cause.theta, dtype=float)) for cause in causes)
    controller = _with_late_references(controller, parts)
    true_robot = robot
    for part in parts:
        true_robot = true_robot if part.robot is None else part.robot(true_robot)
    machine = machine_of(
        true_robot,
        tuple(part.transmission for part in parts if part.transmission is not None),
        tuple(part.inertia for part in parts if part.inertia is not None),
    )
    t, first = np.array(t, dtype=float), None if given.base is None else given.base.at(slice(1))
    start = in_balance(machine, np.array(q0, dtype=float), np.array(v0, dtype=float), first)
    start = start if given.motors is None else with_motors(machine, start, *given.motors)
    spans = np.append(np.diff(t), 0.0)
    counts = np.ceil(spans / min(max_step, longest_step(machine, start.x[: robot.nv])) - 1e-9).astype(np.int64)
    counts[:-1] = np.maximum(counts[:-1], 1)
    plan = Plan(t, spans / np.maximum(counts, 1), counts, _TOO_FAST, base)
    steps = compiled(machine, parts, t, counts)
    channels = Channels(machine, parts, controller, held=_is_held(robot))
    if steps is None:
        rows = _in_python(machine, start, channels, plan)
    else:
        moving = moving_from(start.x, start.v, start.transmitted)
        rows = _compiled(*steps, moving, channels, plan, controller, robot)
    return _recorded(machine, t, rows, sensed=robot.torque_source == "sensor")


def _check(robot: Robot, controller: Controller, t: Array, starts: dict[str, Array], max_step: float) -> None:
    """Raise a `ParameterError` for wrong arguments of `simulate`."""
    if np.ndim(t) != 1 or len(t) < 2 or not np.isfinite(t).all() or not (np.diff(t) > 0).all():
        raise ParameterError("The times of a simulation do not increase: give at least two, each later than the last.")
    for name, values in starts.items():
        if np.shape(values) != (robot.nv,):
            raise ParameterError(f"{name} has shape {np.shape(values)}, wanted {robot.nv} numbers, one a joint.")
        if not np.isfinite(values).all():
            raise ParameterError(f"{name} is {values}: give finite numbers.")
    if not max_step > 0:
        raise ParameterError(f"max_step is {max_step} s: give a length above zero.")
    if isinstance(controller, Tracking) and len(controller.limits) != robot.nv:
        raise ParameterError(
            f"The tracking law is one of {len(controller.limits)} joints and the robot has {robot.nv}: give as many."
        )


def _with_late_references(controller: Controller, parts: tuple[Simulated, ...]) -> Controller:
    """The controller with delayed references, if effects delay them; it has to be a `Tracking` then."""
    delays = [part.reference_delay for part in parts if part.reference_delay is not None]
    if not delays:
        return controller
    if not isinstance(controller, Tracking):
        raise ParameterError(
            "A reference_delay was given with a controller that is a plain function, whose references nobody knows: "
            "give a Tracking of tables."
        )
    return with_late_references(controller, np.sum(delays, axis=0))


def _compiled(
    arm: Arm, laws: EffectLaws, moving: Moving, channels: Channels, plan: Plan, controller: Controller, robot: Robot
) -> Rows:
    """Recorded values from compiled steps: one call for a tracking law, else one after each call of the controller."""
    rows = rows_for(len(plan.t), robot.nv, len(moving.x))
    control = control_of(controller, robot)

    def run(now: Plan, out: Rows) -> None:
        failed_at = run_arm(arm, laws, control, moving, now, out)
        if failed_at >= 0:
            require_closed_loops(arm, float(now.t[failed_at]), robot)
            raise RunawayError(float(now.t[failed_at]))

    if isinstance(controller, Tracking):
        run(plan, rows)
        return rows
    none, one, scratch = np.zeros(1, np.int64), np.ones(1, np.int64), rows_for(1, robot.nv, len(moving.x))
    for k in range(len(plan.t)):
        sample = slice(k, k + 1)
        t, h, out = plan.t[sample], plan.steps[sample], Rows(*(part[sample] for part in rows))
        base = plan.base[k : k + 2]
        moving.commanded[:] = channels.command(float(t[0]), moving.x, moving.v)
        if _is_held(robot):
            run(Plan(t, h, plan.counts[sample], plan.far, base), out)
            continue
        # Without steps this call only records the sample.
        run(Plan(t, h, none, plan.far, base), out)
        for i in range(plan.counts[k]):
            x, v = moving.x + 0.5 * h * moving.v, moving.v + 0.5 * h * moving.a
            moving.commanded[:] = channels.command(float(t[0] + (i + 0.5) * h[0]), x, v)
            run(Plan(t, h, one, plan.far, _within(base, i / plan.counts[k], (i + 1) / plan.counts[k])), scratch)
            if i == 0:
                rows.after[k] = moving.a
    return rows


def _in_python(machine: Machine, state: State, channels: Channels, plan: Plan) -> Rows:
    """Recorded values from steps in Python, for any machine with any effects."""
    rows = rows_for(len(plan.t), machine.nv, len(state.x))
    for k, (t, h, count) in enumerate(zip(plan.t.tolist(), plan.steps.tolist(), plan.counts.tolist(), strict=True)):
        rows.commanded[k], rows.delivered[k] = channels.sample(t, state)
        rows.q[k], rows.x[k], rows.v[k] = channels.reading(state), state.x, state.v
        rows.before[k] = rows.after[k] = state.a
        for i in range(count):
            half = _within(plan.base[k : k + 2], (i + 0.5) / count)
            base = BaseMotion(*np.split(half, 3, axis=1)) if len(half) else None
            state = stepped(machine, state, t + i * h, h, channels.torques(h), base)
            if not np.abs(state.v).max() < plan.far:
                raise RunawayError(t)
            if i == 0:
                rows.after[k] = state.a
    return rows


def _within(ends: Float[Array, "n 9"], *shares: float) -> Float[Array, "m 9"]:
    """Motion of the base between two samples, at shares (0 to 1) of the time between them; empty for a fixed base."""
    return np.array([(1.0 - share) * ends[0] + share * ends[1] for share in shares]) if len(ends) else ends


class Channels:
    """Functions of all effects on commands, torques and readings, with their states, for steps in Python."""

    def __init__(self, machine: Machine, parts: tuple[Simulated, ...], controller: Controller, *, held: bool):
        self._controller, self._held = controller, held
        self._encoders, self._drives = list(machine.encoders), list(machine.drives)
        self._readings = [part.reading for part in parts if part.reading is not None]
        self._commands = [part.command for part in parts if part.command is not None]
        self._laws = [part.torque for part in parts if part.torque is not None]
        self._command_states = [part.start for part in parts if part.command is not None]
        self._law_states = [part.start for part in parts if part.torque is not None]
        self._commanded = np.zeros(machine.robot.nv)
        self._delivered: Array | None = None

    def reading(self, state: State) -> Array:
        """Position readings of a state."""
        return self._read(state.x[self._encoders])

    def _read(self, q: Array) -> Array:
        """Position readings from true positions at the encoders."""
        for reading in self._readings:
            q = reading(q)
        return q

    def sample(self, t: float, state: State) -> tuple[Array, Array]:
        """Commanded torque at a sample, and torque of the drives in the previous step."""
        self._commanded = self.command(t, state.x, state.v)
        return self._commanded, self._commanded if self._delivered is None else self._delivered

    def command(self, t: float, x: Array, v: Array) -> Array:
        """Torque that the controller commands at a state."""
        tau = np.asarray(self._controller(t, self._read(x[self._encoders]), v[self._encoders]), dtype=float)
        if tau.shape != (len(self._drives),):
            wanted = f"wanted {len(self._drives)} numbers, one a joint"
            raise ParameterError(f"The controller gave a torque of shape {tau.shape}, {wanted}.")
        return tau

    def torques(self, h: float) -> Callable[[float, Array, Array, Array], tuple[Array, Array]]:
        """A function that returns the drive torque and the effects' torques in a step of ``h`` seconds."""

        def at(t: float, x: Array, v: Array, transmitted: Array) -> tuple[Array, Array]:
            tau = self._commanded if self._held else self.command(t, x, v)
            for i, command in enumerate(self._commands):
                self._command_states[i], tau = command(self._command_states[i], h, tau)
            self._delivered = tau
            added = np.zeros(len(tau))
            if not self._laws:
                return tau, added
            moment = Moment(t, x[self._drives], v[self._drives], transmitted)
            for i, law in enumerate(self._laws):
                self._law_states[i], torque = law(self._law_states[i], h, moment)
                added = added + torque
            return tau, added

        return at


def _recorded(machine: Machine, t: Array, rows: Rows, *, sensed: bool) -> Simulation:
    """The simulation from its recorded values; ``sensed`` if the torque columns are the torque of the drives."""
    nv, seen = machine.nv, list(machine.encoders)
    # The mean over the steps before and after a sample; the first and the last sample have one step each.
    a = 0.5 * (rows.before + rows.after)
    a[0], a[-1] = rows.after[0], rows.before[-1]
    x, v = rows.x, rows.v
    links = Motion(t, x[:, :nv], v[:, :nv], a[:, :nv])
    encoders = Motion(t, x[:, seen], v[:, seen], a[:, seen])
    return Simulation(t, rows.q, rows.delivered if sensed else rows.commanded, encoders, links)


def _is_held(robot: Robot) -> bool:
    """True if a torque is held from one sample to the next."""
    return robot.torque_hold == "zoh"
