"""Measures lag, granularity and noise of velocity estimators on known motions."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.sensing.accelerometer import AccelerationObserver, Accelerometer, observe_velocity
from phantom_dyn.haptics.sensing.encoder import Encoder, SinusoidalEncoder, record_motion, record_sinusoidal
from phantom_dyn.haptics.sensing.velocity_estimators import Estimator, estimate_velocity
from phantom_dyn.number_checks import sample_count

# Points of the true motion per sampling period; with this number, times of edges are exact to some nanoseconds.
_POINTS = 20
# Time before measurements start [s]; it is longer than any window.
_SETTLING = 0.6


@dataclass(frozen=True)
class EstimatorFigures:
    """Lag, granularity and noise of an estimator, and the traces on which they were measured.

    Attributes:
        lag: Mean of (true velocity - estimate) / acceleration in a motion of constant acceleration [s].
        granularity: Largest minus smallest estimate in a motion of constant speed [m/s or rad/s].
        noise: Root mean square of the error in the motion of constant speed, including its mean [m/s or rad/s].
        t: Times of the accelerated motion [s], shape ``(N,)``.
        velocity: True velocity of the accelerated motion [m/s or rad/s], shape ``(N,)``.
        estimate: Estimate in the accelerated motion [m/s or rad/s], shape ``(N,)``.
        steady_estimate: Estimate in the motion of constant speed, at the same times, shape ``(N,)``.
    """

    lag: float
    granularity: float
    noise: float
    t: Float[Array, " N"]
    velocity: Float[Array, " N"]
    estimate: Float[Array, " N"]
    steady_estimate: Float[Array, " N"]


def estimator_figures(
    estimator: Estimator | AccelerationObserver,
    encoder: Encoder | SinusoidalEncoder,
    *,
    speed: float,
    acceleration: float,
    period: float = 1e-3,
    duration: float = 1.0,
    accelerometer: Accelerometer | None = None,
    rng: np.random.Generator | None = None,
) -> EstimatorFigures:
    """Lag, granularity and noise of an estimator.

    Args:
        estimator: Any estimator of `velocity_estimators`, or the observer of position and acceleration.
        encoder: The sensor.
        speed: Constant speed for the granularity, and speed at the start of the accelerated motion [m/s or rad/s].
        acceleration: Constant acceleration for the lag [m/s2 or rad/s2].
        period: Sampling period [s].
        duration: Duration of each motion after 0.6 s of settling [s].
        accelerometer: Accelerometer; only the observer needs it.
        rng: Generator of the noise of the accelerometer; only the observer needs it.

    Raises:
        ParameterError: If the acceleration is zero, a value is not finite, the duration is less than a period, or the
            observer has no accelerometer.
    """
    if not (math.isfinite(acceleration) and acceleration != 0 and math.isfinite(speed)):
        raise ParameterError(
            f"A speed of {speed} with an acceleration of {acceleration}: "
            "give numbers, and an acceleration that is not 0."
        )
    sample_count(duration, period)
    fine = np.arange(round((_SETTLING + duration) / period) * _POINTS + 1) * (period / _POINTS)
    t = fine[::_POINTS]
    settled = t >= _SETTLING

    def estimate(position: Float[Array, " n"], felt: Float[Array, " N"]) -> Float[Array, " N"]:
        """Velocity estimate at the samples of a motion with `_POINTS` points per sample and a known acceleration."""
        points = {"interval": period / _POINTS, "samples_apart": _POINTS}
        if isinstance(encoder, Encoder):
            record = record_motion(encoder, position, **points)
        else:
            record = record_sinusoidal(encoder, position, **points)
        if not isinstance(estimator, AccelerationObserver):
            return estimate_velocity(estimator, record)
        if accelerometer is None or rng is None:
            raise ParameterError(
                "The observer of position and acceleration has no accelerometer: give one, and a generator of random "
                "numbers for its noise."
            )
        return observe_velocity(estimator, record, accelerometer.reading(felt, rng))

    # Both motions start between two edges, because a start on an edge is a special case.
    start = 0.1 * encoder.step
    steady = estimate(start + speed * fine, np.zeros(len(t)))
    accelerated_motion = start + speed * fine + acceleration * fine**2 / 2
    accelerated = estimate(accelerated_motion, np.full(len(t), acceleration))
    velocity = speed + acceleration * t
    return EstimatorFigures(
        lag=float(np.mean((velocity - accelerated)[settled]) / acceleration),
        granularity=float(np.ptp(steady[settled])),
        noise=float(np.sqrt(np.mean((steady[settled] - speed) ** 2))),
        t=t,
        velocity=velocity,
        estimate=accelerated,
        steady_estimate=steady,
    )
