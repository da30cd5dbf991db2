"""The force that a hand feels on a cheaper device, from what it does with a good one and what is rendered to it.

One model of one degree of freedom per motor, composed as in Figure 7 of Brouwer and MacLean, Simulating Cheap Hardware:

- what the virtual environment asks for is clipped at the motor's limit (`phantom_dyn.effects.torque_saturation`);
- cogging at the probe's position (`phantom_dyn.effects.cogging`) and friction that sticks, of the probe's position and
  velocity (`phantom_dyn.effects.presliding_friction`), are added without the coupling in between;
- the gap's switch lets all of this through while the probe presses a wall, and blocks it in between
  (`phantom_dyn.haptics.gap_switch`);
- the force of the virtual mass, averaged, is added in the end (`phantom_dyn.haptics.virtual_mass`).

The sampling rate may change from sample to sample: the published one went from 500 to 2000 Hz. An average over 25
samples delays the inertia by 24, 12 or 6 ms at 500, 1000 or 2000 Hz. An encoder of 8 um gives speeds in steps of 4, 8
and 16 mm/s there, against a stick velocity of 5 mm/s: without the velocity's filter friction would not stick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from phantom_dyn.devices.phantom import PHANTOM_1_5, PhantomParameters, hybrid_jacobian
from phantom_dyn.effects.cogging import cogging_torque
from phantom_dyn.effects.presliding_friction import stick_law
from phantom_dyn.effects.torque_saturation import held_within
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.cheap_axis import CheapAxis
from phantom_dyn.haptics.gap_switch import GAP_DAMPING, coupling_force, side_of
from phantom_dyn.haptics.virtual_mass import WINDOW, low_passed, mass_step
from phantom_dyn.kernels.jit import jit

Array = np.ndarray

_clipped, _cogging = jit(held_within), jit(cogging_torque)
# Places in the state of an axis; the last forces of the coupling are behind them.
_LAST, _RAW, _SPEED, _MASS_X, _MASS_V, _STUCK, _ANCHOR, _COUNT = range(8)
_FORCES = 8
# Columns of what is rendered.
_FORCE, _COUPLING, _SIDE, _X, _V, _PROBE_SPEED, _STICKS = range(7)


@dataclass(frozen=True)
class Rendered:
    """What a hand feels over ``N`` samples, and the states behind it; each of shape ``(N,)``.

    Attributes:
        force: On the hand [N or N m].
        coupling: Of the virtual mass on the probe, before it is averaged.
        mass_position: Of the virtual mass; that of the probe where there is none.
        mass_velocity: Of the virtual mass.
        velocity: Of the probe, as filtered.
        contact: True where the probe presses a wall of the gap.
        stuck: True where the friction sticks.
    """

    force: Float[Array, " N"]
    coupling: Float[Array, " N"]
    mass_position: Float[Array, " N"]
    mass_velocity: Float[Array, " N"]
    velocity: Float[Array, " N"]
    contact: Bool[Array, " N"]
    stuck: Bool[Array, " N"]


def at_rest() -> Float[Array, " s"]:
    """State of an axis before its first sample, which it takes to be at rest there."""
    state = np.zeros(_FORCES + WINDOW)
    state[_LAST] = np.nan
    return state


def felt(
    axis: CheapAxis, state: Float[Array, " s"], dt: float, x: float, force: float
) -> tuple[Float[Array, " s"], float]:
    """The next state, and the force on the hand: one cycle of a controller.

    Args:
        axis: What is cheap.
        state: Of the cycle before, or `at_rest`; it is left as it is.
        dt: Time since the cycle before [s].
        x: Position of the probe [m or rad].
        force: That the virtual environment asks for [N or N m].
    """
    state, out = state.copy(), np.zeros((1, 7))
    _along(*_numbers(axis), state, np.array([dt]), np.array([x]), np.array([force]), out)
    return state, float(out[0, _FORCE])


def rendered(axis: CheapAxis, t: Float[Array, " N"], x: Float[Array, " N"], force: Float[Array, " N"]) -> Rendered:
    """What a hand feels that moves the probe along ``x``.

    Args:
        axis: What is cheap.
        t: Sample times [s], of any spacing that has the velocity's cut-off below half the rate (7 ms at 70 Hz).
        x: Positions of the probe [m or rad].
        force: That the virtual environment asks for [N or N m].

    Raises:
        ParameterError: If times do not increase or lie too far apart for the velocity's filter.
    """
    steps = np.diff(t, prepend=t[:1])
    if not (steps[1:] > 0).all():
        raise ParameterError("The sample times do not increase: give each sample a time later than the last.")
    if np.isfinite(axis.cutoff_hz) and not steps.max() < 0.5 / axis.cutoff_hz:
        raise ParameterError(
            f"Samples are up to {1e3 * steps.max():.3g} ms apart and the velocity is filtered at {axis.cutoff_hz:g} "
            f"Hz: give more than {2 * axis.cutoff_hz:g} samples a second."
        )
    out = np.zeros((len(t), 7))
    x, force = (np.ascontiguousarray(values, dtype=float) for values in (x, force))
    _along(*_numbers(axis), at_rest(), steps, x, force, out)
    return Rendered(
        force=out[:, _FORCE],
        coupling=out[:, _COUPLING],
        mass_position=out[:, _X],
        mass_velocity=out[:, _V],
        velocity=out[:, _PROBE_SPEED],
        contact=out[:, _SIDE] != 0,
        stuck=out[:, _STICKS] != 0,
    )


def rendered_axes(
    axes: tuple[CheapAxis, ...], t: Float[Array, " N"], q: Float[Array, "N n"], force: Float[Array, "N n"]
) -> Float[Array, "N n"]:
    """Forces [N or N m] on the hand of a device with several motors, each with a model of its own; see `rendered`.

    Raises:
        ParameterError: If the axes are not as many as the columns, or the times are refused.
    """
    if q.shape[1] != len(axes) or force.shape[1] != len(axes):
        raise ParameterError(
            f"There are {len(axes)} axes, {q.shape[1]} positions and {force.shape[1]} forces a sample: give as many."
        )
    return np.column_stack([rendered(axis, t, q[:, k], force[:, k]).force for k, axis in enumerate(axes)])


def phantom_tip_force(
    axes: tuple[CheapAxis, CheapAxis, CheapAxis],
    t: Float[Array, " N"],
    q: Float[Array, "N 3"],
    tip_force: Float[Array, "N 3"],
    parameters: PhantomParameters = PHANTOM_1_5,
) -> Float[Array, "N 3"]:
    r"""Force [N] on the hand at the tip of a PHANToM whose three motors are cheap.

    The force at the tip is brought to the motors, :math:`\tau = J^T F`, degraded there, and brought back.

    Args:
        axes: Of theta1, theta2, theta3; in rad and N m.
        t: Sample times [s].
        q: Absolute joint angles of seed 003 [rad].
        tip_force: That the virtual environment asks for, in the axes of the zero configuration.
        parameters: Of the device.
    """
    J = hybrid_jacobian(q, parameters)[:, :3]
    tau = np.einsum("nij,ni->nj", J, tip_force)
    given = rendered_axes(axes, t, q, tau)
    return np.linalg.solve(np.swapaxes(J, 1, 2), given[:, :, None])[:, :, 0]


def _numbers(axis: CheapAxis) -> tuple[Array, Array, Array, Array]:
    """An axis as arrays for the compiled loop: ten numbers, and the waves of its cogging."""
    mass, friction, waves = axis.mass, axis.friction, axis.cogging
    numbers = [0.0] * 3 if mass is None else [mass.inertia, mass.stiffness, mass.damping]
    numbers += [axis.gap, axis.limit]
    if friction is None:
        numbers += [0.0] * 4
    else:
        numbers += [friction.torque, friction.displacement, friction.static_ratio, friction.stick_velocity]
    numbers.append(axis.cutoff_hz)
    table = ((), (), ()) if waves is None else (waves.order, waves.amplitude, waves.phase)
    orders, amplitudes, phases = (np.array(values, dtype=float) for values in table)
    return np.array(numbers, dtype=float), orders, amplitudes, phases


@jit
def _along(
    numbers: Array,
    orders: Array,
    amplitudes: Array,
    phases: Array,
    state: Array,
    steps: Array,
    positions: Array,
    asked: Array,
    out: Array,
) -> None:
    """One cycle a sample; ``state`` moves on, ``out`` is filled."""
    mass, stiffness, damping, gap, limit = numbers[0], numbers[1], numbers[2], numbers[3], numbers[4]
    cutoff = numbers[9]
    slip, displacement, ratio, stick_velocity = numbers[5], numbers[6], numbers[7], numbers[8]
    for k in range(len(steps)):
        x, dt, last = positions[k], steps[k], state[_LAST]
        if np.isnan(last):
            state[_MASS_X] = x
        elif dt > 0.0:
            raw = (x - last) / dt
            state[_SPEED] = raw if cutoff == np.inf else low_passed(state[_SPEED], state[_RAW], raw, dt, cutoff)
            state[_RAW] = raw
        speed = state[_SPEED]

        side, coupling = 1.0, 0.0
        if mass > 0.0:
            x_mass, v_mass = state[_MASS_X], state[_MASS_V]
            if not np.isnan(last):
                side = side_of(last - x_mass, gap)
                held, drag = (stiffness, damping) if side != 0.0 else (0.0, GAP_DAMPING * damping)
                middle = 0.5 * (last + x) - 0.5 * side * gap
                state[_MASS_X], state[_MASS_V] = mass_step(x_mass, v_mass, dt, mass, middle, held, drag, speed)
            apart = x - state[_MASS_X]
            side = side_of(apart, gap)
            # A difference of positions is the velocity half a step ago, so the mass's is taken there too.
            rate = speed - 0.5 * (v_mass + state[_MASS_V])
            coupling = coupling_force(apart, rate, side, gap, stiffness, damping)
        else:
            state[_MASS_X], state[_MASS_V] = x, speed
        state[_FORCES + int(state[_COUNT]) % WINDOW] = coupling
        state[_COUNT] += 1.0

        friction = 0.0
        if slip > 0.0:
            state[_STUCK], state[_ANCHOR], friction = stick_law(
                last, state[_STUCK], state[_ANCHOR], x, speed, slip, displacement, ratio, stick_velocity
            )
        direct = _clipped(asked[k], limit) + friction
        if len(orders) > 0:
            direct += _cogging(x, orders, amplitudes, phases)
        if side == 0.0:
            direct = 0.0
        if mass > 0.0:
            direct += np.sum(state[_FORCES:]) / WINDOW
        out[k, _FORCE], out[k, _COUPLING], out[k, _SIDE] = direct, coupling, side
        out[k, _X], out[k, _V], out[k, _PROBE_SPEED] = state[_MASS_X], state[_MASS_V], speed
        out[k, _STICKS] = state[_STUCK]
        state[_LAST] = x
