r"""One cycle of a cheap axis, compiled: virtual mass, play, sticking friction, cogging and a clipped motor.

**Inertia** that the device lacks is a mass in the computer, tied to the probe. Multiplying an acceleration estimate by
a mass is unstable, so the mass is integrated and coupled to the probe by a spring and a damper; the probe's velocity is
low-passed, and the force that the hand feels is a mean over the last samples (Brouwer and MacLean, Simulating Cheap
Hardware, section II A). With a stiff coupling it is the rotor inertia of the catalogue: :math:`-M\ddot x`. All laws
take the time step, which may change from sample to sample.

**Play** of full width ``gap`` lies between the probe and the virtual mass. Beyond half the gap the coupling is attached
to the wall of the gap, (1) of the same paper; inside there is a little viscous friction between probe and mass, a fifth
of the coupling's. (2) prints the spring's force as ``K (x_vm - x_hi)``, which is not (1) and would jump by half the gap
times the stiffness at contact (0.3 N for 600 N/m and 1 mm): here it is ``K (p_vc - x_hi)``. (2) prints the damping in
the gap as that of the probe alone; the text has it between probe and mass, as here. The switch lets all other forces
through in contact only. The play of the catalogue's `phantom_dyn.effects.transmission.backlash` is another machine: its
link is free, and not held back.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.drive.torque_saturation import held_within
from phantom_dyn.effects.friction.presliding_friction import stick_law
from phantom_dyn.effects.support.position_waves import sum_of_waves
from phantom_dyn.haptics.cheap.cheap_axis import CheapAxis

WINDOW = 25
"""Samples that the force is averaged over, as published."""
GAP_DAMPING = 0.2
"""Damping inside the gap over that of the coupling, as published."""
LAST, RAW, SPEED, MASS_X, MASS_V, STUCK, ANCHOR, COUNT = range(8)
"""Places in the state of an axis."""
FORCES = 8
"""Place in the state from which on the last forces of the coupling are."""
FORCE, COUPLING, SIDE, X, V, PROBE_SPEED, STICKS = range(7)
"""Columns of what is rendered."""
COLUMNS = 7
_clipped, _cogging = jit(held_within), jit(sum_of_waves)


class AxisNumbers(NamedTuple):
    """A `CheapAxis` as numbers for the compiled loop; zeros where nothing is cheap.

    Attributes:
        mass: Of the virtual mass, 0 for none.
        stiffness: Of its coupling.
        damping: Of its coupling.
        gap: Full width of the play.
        limit: Force beyond which the motor is clipped.
        slip: Friction in slip, 0 for none.
        displacement: At which it breaks loose.
        ratio: Force at which it breaks loose over that in slip.
        stick_velocity: It sticks below that speed.
        cutoff_hz: Of the filter of the probe's velocity.
        orders: Of the waves of cogging, ``(w,)``.
        amplitudes: Of the same.
        phases: Of the same.
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
    """An axis as numbers for the compiled loop."""
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
    """State of an axis before its first sample, which it takes to be at rest there."""
    state = np.zeros(FORCES + WINDOW)
    state[LAST] = np.nan
    return state


@jit
def along(axis: AxisNumbers, state: Array, steps: Array, positions: Array, asked: Array, out: Array) -> None:
    """Run one cycle a sample; ``state`` moves on, ``out``, ``(N, COLUMNS)``, is filled."""
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
                held, drag = (stiffness, damping) if side != 0.0 else (0.0, GAP_DAMPING * damping)
                middle = 0.5 * (last + x) - 0.5 * side * gap
                state[MASS_X], state[MASS_V] = mass_step(x_mass, v_mass, dt, mass, middle, held, drag, speed)
            apart = x - state[MASS_X]
            side = side_of(apart, gap)
            # A difference of positions is the velocity half a step ago, so the mass's is taken there too.
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
        direct = _clipped(asked[k], limit) + friction
        if len(orders) > 0:
            direct += _cogging(x, orders, amplitudes, phases)
        if side == 0.0:
            direct = 0.0
        if mass > 0.0:
            direct += np.sum(state[FORCES:]) / WINDOW
        out[k, FORCE], out[k, COUPLING], out[k, SIDE] = direct, coupling, side
        out[k, X], out[k, V], out[k, PROBE_SPEED] = state[MASS_X], state[MASS_V], speed
        out[k, STICKS] = state[STUCK]
        state[LAST] = x


@jit
def mass_step(
    x: float, v: float, dt: float, mass: float, attachment: float, stiffness: float, damping: float, speed: float
) -> tuple[float, float]:
    """Position and velocity of the mass after ``dt`` seconds, by the midpoint rule, which no stiffness makes unstable.

    Args:
        x: Position of the mass before.
        v: Its velocity before.
        dt: Time step [s].
        mass: [kg or kg m^2].
        attachment: Where the coupling holds the mass half a step later, with the spring at rest.
        stiffness: Of the coupling.
        damping: Of the coupling.
        speed: Velocity of the probe.
    """
    bend, drag = 0.25 * dt * dt * stiffness, 0.5 * dt * damping
    pulled = dt * (stiffness * (attachment - x) + damping * speed)
    new = (v * (mass - bend - drag) + pulled) / (mass + bend + drag)
    return x + 0.5 * dt * (v + new), new


@jit
def side_of(apart: float, gap: float) -> float:
    """Wall that the probe, ``apart`` from the mass, presses: 1, -1, or 0 inside the gap; without a gap always one."""
    if apart >= 0.5 * gap:
        return 1.0
    return -1.0 if apart <= -0.5 * gap else 0.0


@jit
def coupling_force(apart: float, rate: float, side: float, gap: float, stiffness: float, damping: float) -> float:
    """Force on the probe that is ``apart`` from the mass and moves away from it at ``rate``, (1) and (2)."""
    if side == 0.0:
        return -GAP_DAMPING * damping * rate
    return -stiffness * (apart - 0.5 * side * gap) - damping * rate


@jit
def low_passed(last_out: float, last_in: float, new_in: float, dt: float, cutoff_hz: float) -> float:
    """The filter's next output; its weights are those of this time step [s]."""
    b, a = butterworth_weights(dt, cutoff_hz)
    return b * (new_in + last_in) - a * last_out


@jit
def butterworth_weights(dt: float, cutoff_hz: float) -> tuple[float, float]:
    """Weights ``b0 = b1`` and ``a1`` of the bilinear first-order Butterworth filter for a time step ``dt`` [s]."""
    k = np.tan(np.pi * cutoff_hz * dt)
    return k / (1.0 + k), (k - 1.0) / (k + 1.0)
