"""An axis whose friction is compensated at samples, simulated: dry friction that rises over a displacement (Dahl)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Float
from phantom_dyn.haptics.device.axis import RigidAxis
from phantom_dyn.haptics.stability.friction_compensation import FrictionCompensation

_SUBSTEPS = 50
"""Steps per sample: the spring of the friction swings at some 50 Hz, and a sample is a millisecond."""


@dataclass(frozen=True)
class DryFriction:
    """True friction of an axis; it rises over a displacement before the device slips (Dahl).

    Attributes:
        torque: Friction in slip [N or N m].
        displacement: Displacement over which it rises [m or rad].
    """

    torque: float
    displacement: float


@dataclass(frozen=True)
class Sampling:
    """Sampling of an axis.

    Attributes:
        period: Sampling period [s].
        delay: Delay of the force [samples].
        window: Number of samples over which positions are differenced.
        step: Step of the encoder [m or rad], 0 for none.
    """

    period: float = 1e-3
    delay: int = 0
    window: int = 1
    step: float = 0.0


@dataclass(frozen=True)
class CompensatedMotion:
    """Motion of a compensated axis.

    Attributes:
        t: Times of the samples [s], shape ``(N,)``.
        position: Position [m or rad], shape ``(N,)``.
        velocity: True velocity [m/s or rad/s], shape ``(N,)``.
        force: Force of the compensation [N or N m], shape ``(N,)``.
    """

    t: Float[Array, " N"]
    position: Float[Array, " N"]
    velocity: Float[Array, " N"]
    force: Float[Array, " N"]

    @property
    def swing(self) -> float:
        """Half the range of the position in the last third, when the start has died out [m or rad]."""
        return 0.5 * float(np.ptp(self.position[-(len(self.t) // 3) :]))


def simulate_compensation(
    axis: RigidAxis,
    friction: DryFriction,
    compensation: FrictionCompensation,
    modelled: tuple[float, float],
    sampling: Sampling,
    hand: Float[Array, " N"],
    *,
    speed: float = 0.0,
) -> CompensatedMotion:
    """Simulation of an axis whose friction is compensated at samples.

    Args:
        axis: Mass, viscous friction, and the spring of a hand.
        friction: True dry friction of the axis.
        compensation: Share and dead zone.
        modelled: Dry friction and viscous coefficient of the model.
        sampling: Period, delay, encoder and window.
        hand: Force of the hand, held over each sample [N or N m], shape ``(N,)``.
        speed: Speed at the start, at position zero [m/s or rad/s].
    """
    out = np.zeros((3, len(hand)))
    numbers = np.array(
        [
            *(axis.mass, axis.damping, axis.stiffness, friction.torque, friction.displacement),
            *(compensation.share * modelled[0], compensation.share * modelled[1]),
            *(compensation.dead_zone, compensation.ramp, sampling.period, sampling.step, speed),
        ]
    )
    _run(numbers, sampling.delay, sampling.window, np.ascontiguousarray(hand, dtype=float), out)
    return CompensatedMotion(np.arange(len(hand)) * sampling.period, *out)


@jit
def _run(numbers: Array, delay: int, window: int, hand: Array, out: Array) -> None:
    """Write position, velocity and force of each sample."""
    mass, damping, stiffness, torque, displacement = numbers[:5]
    dry, viscous, dead, ramp, period, step, v = numbers[5:]
    N, dt = len(hand), period / _SUBSTEPS
    x, bristle, reading = 0.0, 0.0, np.zeros(N)
    asked = np.zeros(N)
    for k in range(N):
        reading[k] = np.round(x / step) * step if step > 0 else x
        # The device stood still before the first sample: a window that is not full underestimates the speed.
        rate = (reading[k] - (reading[k - window] if k >= window else 0.0)) / (window * period)
        beyond = abs(rate) - dead
        risen = min(max(beyond / ramp, 0.0), 1.0) if ramp > 0 else (1.0 if beyond > 0 else 0.0)
        asked[k] = risen * (dry * np.sign(rate) + viscous * rate)
        force = asked[k - delay] if k >= delay else 0.0
        out[0, k], out[1, k], out[2, k] = x, v, force
        for _ in range(_SUBSTEPS):
            v += dt / mass * (force + hand[k] - damping * v - stiffness * x - torque * bristle)
            x += dt * v
            end = np.sign(v)
            bristle = end + (bristle - end) * np.exp(-abs(v) * dt / displacement)
