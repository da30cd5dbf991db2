r"""Inertia that a hand feels although the device lacks it: a mass that exists in a computer, tied to the probe.

Multiplying an acceleration estimate by a mass is unstable, so the mass is integrated and coupled to the probe by a
spring and a damper; the probe's velocity is low-passed, and the force that the hand feels is a mean over the last
samples (Brouwer and MacLean, Simulating Cheap Hardware, section II A). With a stiff coupling it is the rotor inertia
of the catalogue: :math:`-M\ddot x`. All laws take the time step, which may change from sample to sample.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.kernels.jit import jit

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
