r"""Force that a hand feels on a simulated cheap device, from the motion of a good device and the commanded force.

Each motor has one model of one degree of freedom, as in Figure 7 of Brouwer and MacLean, Simulating Cheap Hardware:

- the force that the virtual environment commands is clipped at the motor's limit
  (`phantom_dyn.effects.drive.torque_saturation`);
- cogging at the probe's position (`phantom_dyn.effects.drive.cogging`), and friction that sticks, from the probe's
  position and velocity (`phantom_dyn.effects.friction.presliding_friction`), are added directly, not through the
  coupling;
- these forces reach the hand while the probe presses a wall of the gap, and are zero while it is between the walls;
- the averaged force of the virtual mass is added last.

The sampling rate may change from sample to sample: the published one varied between 500 and 2000 Hz. An average over 25
samples delays the inertia by 24, 12 or 6 ms at 500, 1000 or 2000 Hz. At these rates an encoder of 8 um gives speeds in
steps of 4, 8 and 16 mm/s, but the stick velocity is 5 mm/s: without a filter of the velocity, friction would not stick.

**Inertia** in addition to that of the good device is a virtual mass. A force computed as this mass times an estimated
acceleration would make the loop unstable. So the motion of the mass is integrated, and a spring and a damper couple the
mass to the probe. The velocity of the probe is low-passed, and the hand feels a mean over the last samples (section II
A of the paper). With a stiff coupling the force is that of the effect ``rotor_inertia``, :math:`-M\ddot x`.

**Play** of full width ``gap`` lies between the probe and the virtual mass. Beyond half the gap the coupling is attached
to the wall of the gap, (1) of the paper. Inside the gap, viscous friction acts between probe and mass, with a fifth of
the coupling's damping. (2) prints the spring's force as ``K (x_vm - x_hi)``, which contradicts (1) and would jump by
half the gap times the stiffness at contact (0.3 N for 600 N/m and 1 mm): here it is ``K (p_vc - x_hi)``. (2) prints the
damping in the gap as that of the probe alone; in the text and here it acts between probe and mass. Other forces reach
the hand in contact only. The effect `phantom_dyn.effects.transmission.backlash` differs: its link moves freely in the
gap, without friction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.effects.drive.torque_saturation import clipped
from phantom_dyn.effects.friction.presliding_friction import stick_law
from phantom_dyn.effects.support.position_waves import sum_of_waves
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.cheap.cheap_axis import CheapAxis
from phantom_dyn.number_checks import require_columns, require_not_negative, require_numbers

WINDOW = 25
"""Number of samples over which the force is averaged, as published."""
GAP_DAMPING = 0.2
"""Damping inside the gap over that of the coupling, as published."""
LAST, RAW, SPEED, MASS_X, MASS_V, STUCK, ANCHOR, COUNT = range(8)
"""Indices into the state of an axis."""
FORCES = 8
"""Index in the state at which the last `WINDOW` forces of the coupling begin."""
FORCE, COUPLING, SIDE, X, PROBE_SPEED, STICKS = range(6)
"""Columns of the output of `run_axis`."""
COLUMNS = 6
_clipped, _cogging = jit(clipped), jit(sum_of_waves)


class AxisNumbers(NamedTuple):
    """A `CheapAxis` as numbers for the compiled loop, in SI units; zero for each defect that is absent.

    Attributes:
        mass: Virtual mass, 0 for none.
        stiffness: Stiffness of its coupling.
        damping: Damping of its coupling.
        gap: Full width of the play.
        limit: Force at which the motor is clipped.
        slip: Friction in slip, 0 for none.
        displacement: Displacement at which friction breaks loose.
        ratio: Friction at which the axis breaks loose, over friction in slip.
        stick_velocity: Speed below which friction sticks.
        cutoff_hz: Cut-off of the filter of the probe's velocity [Hz].
        orders: Orders of the waves of cogging, shape ``(w,)``.
        amplitudes: Amplitudes of the waves, shape ``(w,)``.
        phases: Phases of the waves, shape ``(w,)``.
    """

    mass: float
    stiffness: float
    damping: float
    gap: float
    limit: float
    slip: float
    displacement: float
    ratio: float
    stick_velocity: float
    cutoff_hz: float
    orders: Array
    amplitudes: Array
    phases: Array


def axis_numbers(axis: CheapAxis) -> AxisNumbers:
    """The numbers of an axis for the compiled loop."""
    mass, friction, waves = axis.mass, axis.friction, axis.cogging
    inertia, stiffness, damping = (0.0, 0.0, 0.0) if mass is None else (mass.inertia, mass.stiffness, mass.damping)
    slip, displacement, ratio, stick_velocity = (0.0, 0.0, 0.0, 0.0)
    if friction is not None:
        slip, displacement = friction.torque, friction.displacement
        ratio, stick_velocity = friction.static_ratio, friction.stick_velocity
    table = ((), (), ()) if waves is None else (waves.order, waves.amplitude, waves.phase)
    orders, amplitudes, phases = (np.array(values, dtype=float) for values in table)
    return AxisNumbers(
        mass=float(inertia),
        stiffness=float(stiffness),
        damping=float(damping or 0.0),
        gap=float(axis.gap),
        limit=float(axis.limit),
        slip=float(slip),
        displacement=float(displacement),
        ratio=float(ratio),
        stick_velocity=float(stick_velocity),
        cutoff_hz=float(axis.cutoff_hz),
        orders=orders,
        amplitudes=amplitudes,
        phases=phases,
    )


def at_rest() -> Float[Array, " s"]:
    """State of an axis before its first sample, shape ``(FORCES + WINDOW,)``. The probe rests at its first position."""
    state = np.zeros(FORCES + WINDOW)
    state[LAST] = np.nan
    return state


@jit
def run_axis(axis: AxisNumbers, state: Array, steps: Array, positions: Array, commands: Array, out: Array) -> None:
    """Run one cycle per sample: update ``state`` and fill ``out``, shape ``(N, COLUMNS)``."""
    mass, stiffness, damping, gap, limit, slip, displacement, ratio = axis[:8]
    stick_velocity, cutoff = axis.stick_velocity, axis.cutoff_hz
    orders, amplitudes, phases = axis.orders, axis.amplitudes, axis.phases
    for k in range(len(steps)):
        x, dt, last = positions[k], steps[k], state[LAST]
        if np.isnan(last):
            state[MASS_X] = x
        elif dt > 0.0:
            raw = (x - last) / dt
            state[SPEED] = raw if cutoff == np.inf else low_passed(state[SPEED], state[RAW], raw, dt, cutoff)
            state[RAW] = raw
        speed = state[SPEED]

        side, coupling = 1.0, 0.0
        if mass > 0.0:
            x_mass, v_mass = state[MASS_X], state[MASS_V]
            if not np.isnan(last):
                side = side_of(last - x_mass, gap)
                spring, drag = (stiffness, damping) if side != 0.0 else (0.0, GAP_DAMPING * damping)
                middle = 0.5 * (last + x) - 0.5 * side * gap
                state[MASS_X], state[MASS_V] = mass_step(x_mass, v_mass, dt, mass, middle, spring, drag, speed)
            apart = x - state[MASS_X]
            side = side_of(apart, gap)
            # The velocity of the probe, a difference of positions, is that of half a step ago. So the velocity of the
            # mass is taken at the same time.
            rate = speed - 0.5 * (v_mass + state[MASS_V])
            coupling = coupling_force(apart, rate, side, gap, stiffness, damping)
        else:
            state[MASS_X], state[MASS_V] = x, speed
        state[FORCES + int(state[COUNT]) % WINDOW] = coupling
        state[COUNT] += 1.0

        friction = 0.0
        if slip > 0.0:
            state[STUCK], state[ANCHOR], friction = stick_law(
                last, state[STUCK], state[ANCHOR], x, speed, slip, displacement, ratio, stick_velocity
            )
        direct = _clipped(commands[k], limit) + friction
        if len(orders) > 0:
            direct += _cogging(x, orders, amplitudes, phases)
        if side == 0.0:
            direct = 0.0
        if mass > 0.0:
            direct += np.sum(state[FORCES:]) / WINDOW
        out[k, FORCE], out[k, COUPLING], out[k, SIDE] = direct, coupling, side
        out[k, X], out[k, PROBE_SPEED] = state[MASS_X], speed
        out[k, STICKS] = state[STUCK]
        state[LAST] = x


@jit
def mass_step(
    x: float, v: float, dt: float, mass: float, attachment: float, stiffness: float, damping: float, speed: float
) -> tuple[float, float]:
    """Position and velocity of the mass after ``dt``, by the midpoint rule, which is stable for any stiffness.

    Args:
        x: Position of the mass before.
        v: Velocity of the mass before.
        dt: Time step [s].
        mass: Virtual mass [kg or kg m^2].
        attachment: Position of the mass half a step later at which the spring is relaxed.
        stiffness: Stiffness of the coupling.
        damping: Damping of the coupling.
        speed: Velocity of the probe.
    """
    bend, drag = 0.25 * dt * dt * stiffness, 0.5 * dt * damping
    pulled = dt * (stiffness * (attachment - x) + damping * speed)
    new = (v * (mass - bend - drag) + pulled) / (mass + bend + drag)
    return x + 0.5 * dt * (v + new), new


@jit
def side_of(apart: float, gap: float) -> float:
    """Wall of the gap that the probe presses (1 or -1, 0 inside the gap); ``apart`` is probe minus mass position."""
    if apart >= 0.5 * gap:
        return 1.0
    return -1.0 if apart <= -0.5 * gap else 0.0


@jit
def coupling_force(apart: float, rate: float, side: float, gap: float, stiffness: float, damping: float) -> float:
    """Force of the coupling, (1) and (2), on a probe that is ``apart`` from the mass and moves away at ``rate``."""
    if side == 0.0:
        return -GAP_DAMPING * damping * rate
    return -stiffness * (apart - 0.5 * side * gap) - damping * rate


@jit
def low_passed(last_out: float, last_in: float, new_in: float, dt: float, cutoff_hz: float) -> float:
    """Next output of the filter, with the weights of this time step [s]."""
    b, a = butterworth_weights(dt, cutoff_hz)
    return b * (new_in + last_in) - a * last_out


@jit
def butterworth_weights(dt: float, cutoff_hz: float) -> tuple[float, float]:
    """Weights ``b0 = b1`` and ``a1`` of the bilinear first-order Butterworth filter for a time step ``dt`` [s]."""
    k = np.tan(np.pi * cutoff_hz * dt)
    return k / (1.0 + k), (k - 1.0) / (k + 1.0)


@dataclass(frozen=True)
class Rendered:
    """Force that a hand feels over ``N`` samples, and the states behind it, each of shape ``(N,)``.

    Attributes:
        force: Force on the hand [N or N m].
        coupling: Force of the virtual mass on the probe, before it is averaged [N or N m].
        mass_position: Position of the virtual mass; without one, that of the probe [m or rad].
        velocity: Filtered velocity of the probe [m/s or rad/s].
        contact: True while the probe presses a wall of the gap.
        stuck: True while the friction sticks.
    """

    force: Float[Array, " N"]
    coupling: Float[Array, " N"]
    mass_position: Float[Array, " N"]
    velocity: Float[Array, " N"]
    contact: Bool[Array, " N"]
    stuck: Bool[Array, " N"]


def run_cycle(
    axis: CheapAxis, state: Float[Array, " s"], dt: float, x: float, force: float
) -> tuple[Float[Array, " s"], float]:
    """Run one cycle of a controller, and return its next state and the force on the hand.

    Args:
        axis: The cheap axis.
        state: State after the cycle before, or `at_rest`; it is not changed.
        dt: Time since the cycle before [s].
        x: Position of the probe [m or rad].
        force: Force that the virtual environment commands [N or N m].

    Raises:
        ParameterError: If a number is not finite, time goes back, or the step is too long for the velocity's filter.
    """
    require_not_negative(time_step=dt)
    require_numbers(position_of_the_probe=x, force=force)
    _require_rate(axis, dt)
    state, out = state.copy(), np.zeros((1, COLUMNS))
    run_axis(axis_numbers(axis), state, np.array([dt]), np.array([x]), np.array([force]), out)
    return state, float(out[0, FORCE])


def rendered(axis: CheapAxis, t: Float[Array, " N"], x: Float[Array, " N"], force: Float[Array, " N"]) -> Rendered:
    """Force that a hand feels when it moves the probe along ``x``.

    Args:
        axis: The cheap axis.
        t: Sample times [s], shape ``(N,)``. The cut-off must be below half the rate (7 ms at 70 Hz).
        x: Positions of the probe [m or rad], shape ``(N,)``.
        force: Force that the virtual environment commands [N or N m], shape ``(N,)``.

    Raises:
        ParameterError: If there is no sample, a column has another length or holds no number, or if times do not
            increase or are too far apart for the velocity's filter.
    """
    if np.ndim(t) != 1 or len(t) == 0:
        raise ParameterError(
            f"Sample times of shape {np.shape(t)} were given: give one for each of one or more samples."
        )
    require_columns(len(t), sample_times=t, position_of_the_probe=x, force=force)
    steps = np.diff(t, prepend=t[:1])
    if not (steps[1:] > 0).all():
        raise ParameterError("The sample times do not increase: give each sample a time later than the last.")
    _require_rate(axis, float(steps.max()))
    out = np.zeros((len(t), COLUMNS))
    x, force = (np.ascontiguousarray(values, dtype=float) for values in (x, force))
    run_axis(axis_numbers(axis), at_rest(), steps, x, force, out)
    return Rendered(
        force=out[:, FORCE],
        coupling=out[:, COUPLING],
        mass_position=out[:, X],
        velocity=out[:, PROBE_SPEED],
        contact=out[:, SIDE] != 0,
        stuck=out[:, STICKS] != 0,
    )


def _require_rate(axis: CheapAxis, longest: float) -> None:
    """Refuse time steps that are too long for the filter of the velocity."""
    if np.isfinite(axis.cutoff_hz) and not longest < 0.5 / axis.cutoff_hz:
        raise ParameterError(
            f"Samples are up to {1e3 * longest:.3g} ms apart and the velocity is filtered at {axis.cutoff_hz:g} "
            f"Hz: give more than {2 * axis.cutoff_hz:g} samples a second."
        )
