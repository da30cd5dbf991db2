r"""Inertia and backlash as a hand feels them although the device lacks them: a mass in a computer, tied to the probe.

Inertia that a hand feels although the device lacks it: a mass that exists in a computer, tied to the probe.

Multiplying an acceleration estimate by a mass is unstable, so the mass is integrated and coupled to the probe by a
spring and a damper; the probe's velocity is low-passed, and the force that the hand feels is a mean over the last
samples (Brouwer and MacLean, Simulating Cheap Hardware, section II A). With a stiff coupling it is the rotor inertia
of the catalogue: :math:`-M\ddot x`. All laws take the time step, which may change from sample to sample.

Backlash as a hand feels it: a play of full width ``gap`` between the probe and a virtual mass, with a switch.

Beyond half the gap the coupling is attached to the wall of the gap, (1) of Brouwer and MacLean, Simulating Cheap
Hardware; inside there is a little viscous friction between probe and mass, a fifth of the coupling's. (2) prints the
spring's force as ``K (x_vm - x_hi)``, which is not (1) and would jump by half the gap times the stiffness at contact
(0.3 N for 600 N/m and 1 mm): here it is ``K (p_vc - x_hi)``. (2) prints the damping in the gap as that of the probe
alone; the text has it between probe and mass, as here. The switch lets all other forces through in contact only.
The play of the catalogue's `phantom_dyn.effects.transmission.backlash` is another machine: its link is free, and not
held back.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import jit

# Published: samples that the force is averaged over, and cut-off of the velocity's first-order Butterworth filter [Hz].
WINDOW = 25
CUTOFF_HZ = 70.0


@jit
def butterworth_weights(dt: float, cutoff_hz: float) -> tuple[float, float]:
    """Weights ``b0 = b1`` and ``a1`` of the bilinear first-order Butterworth filter for a time step ``dt`` [s]."""
    k = np.tan(np.pi * cutoff_hz * dt)
    return k / (1.0 + k), (k - 1.0) / (k + 1.0)


@jit
def low_passed(last_out: float, last_in: float, new_in: float, dt: float, cutoff_hz: float) -> float:
    """The filter's next output; its weights are those of this time step [s]."""
    b, a = butterworth_weights(dt, cutoff_hz)
    return b * (new_in + last_in) - a * last_out


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


# Published: damping inside the gap over that of the coupling.
GAP_DAMPING = 0.2


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
