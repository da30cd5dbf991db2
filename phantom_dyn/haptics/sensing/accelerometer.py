r"""Estimates velocity from an accelerometer and an encoder, by a stationary Kalman filter.

With the mean :math:`u` of two successive readings of the accelerometer, its bias c and the period T, the prediction is

.. math:: x^+ = x + T v + \tfrac{T^2}{2} (u - c), \qquad v^+ = v + T (u - c), \qquad c^+ = c.

The reading of the encoder corrects the prediction by stationary Kalman gains. The noise of the accelerometer is process
noise of x and v, the bias is a random walk, and the reading has the variance of rounding, :math:`step^2 / 12`. The
velocity has no lag, because it is not averaged, and no bias, because the bias of the accelerometer is estimated.

References:
    Cavusoglu, Feygin and Tendick (2002, section 7) planned an accelerometer that "can easily be integrated and used to
    estimate the velocity more accurately". They give no equations; the equations here are those of a stationary Kalman
    filter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.haptics.sensing.encoder import EncoderRecord
from phantom_dyn.haptics.sensing.velocity_estimators import stationary_gains
from phantom_dyn.number_checks import require_columns, require_not_negative, require_numbers, require_positive


@dataclass(frozen=True)
class Accelerometer:
    """An acceleration sensor on the moving part.

    Attributes:
        noise: Standard deviation of the white noise of a reading [m/s2 or rad/s2].
        bias: Reading at rest [m/s2 or rad/s2].

    Raises:
        ParameterError: If the noise is negative, or a number is not finite.
    """

    noise: float = 0.05
    bias: float = 0.0

    def __post_init__(self) -> None:
        require_not_negative(noise_of_the_accelerometer=self.noise)
        require_numbers(bias_of_the_accelerometer=self.bias)

    def reading(self, acceleration: Float[Array, " N"], rng: np.random.Generator) -> Float[Array, " N"]:
        """Readings at the samples [m/s2 or rad/s2], shape ``(N,)``."""
        return acceleration + self.bias + self.noise * rng.standard_normal(len(acceleration))


@dataclass(frozen=True)
class AccelerationObserver:
    """Settings of an observer of position and acceleration.

    Attributes:
        noise: Assumed standard deviation of the white noise of the accelerometer [m/s2 or rad/s2].
        drift: Assumed standard deviation of the change of the accelerometer's bias in a second [m/s2 or rad/s2].

    Raises:
        ParameterError: If either is not above 0.
    """

    noise: float = 0.05
    drift: float = 0.1

    def __post_init__(self) -> None:
        require_positive(noise_of_the_observer=self.noise, drift_of_the_observer=self.drift)


def observer_gains(observer: AccelerationObserver, *, step: float, period: float) -> tuple[float, float, float]:
    """Stationary Kalman gains from the error of the predicted reading to position [-], velocity [1/s], bias [1/s2].

    Raises:
        ParameterError: If encoder step or period is not above 0.
    """
    require_positive(encoder_step=step, period=period)
    transition = np.array([[1.0, period, -(period**2) / 2], [0.0, 1.0, -period], [0.0, 0.0, 1.0]])
    push = observer.noise * np.array([[period**2 / 2], [period], [0.0]])
    walk = np.diag([0.0, 0.0, observer.drift**2 * period])
    x, v, c = stationary_gains(transition, push @ push.T + walk, step)
    return float(x), float(v), float(c)


def observe_velocity(
    observer: AccelerationObserver, record: EncoderRecord, acceleration: Float[Array, " N"]
) -> Float[Array, " N"]:
    """Velocity [m/s or rad/s] at each sample from the readings up to this sample, shape ``(N,)``.

    Args:
        observer: Assumed noise and drift.
        record: Record of the encoder.
        acceleration: Readings at the samples of the encoder [m/s2 or rad/s2], shape ``(N,)``.

    Raises:
        ParameterError: If there is not one finite acceleration for each reading.
    """
    require_columns(len(record.reading), acceleration=acceleration)
    T = record.period
    for_x, for_v, for_c = observer_gains(observer, step=record.step, period=T)
    x, v, c = float(record.reading[0]), 0.0, 0.0
    out = np.zeros(len(record.reading))
    for k in range(1, len(out)):
        u = 0.5 * (acceleration[k - 1] + acceleration[k]) - c
        x, v = x + T * v + 0.5 * T * T * u, v + T * u
        innovation = record.reading[k] - x
        x, v, c = x + for_x * innovation, v + for_v * innovation, c + for_c * innovation
        out[k] = v
    return out
