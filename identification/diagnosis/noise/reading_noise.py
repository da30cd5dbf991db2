"""Estimates the noise of position readings from differences of neighbouring raw readings, in which the motion cancels.

A reading is the position plus white noise of the sensor, rounded to the steps of the encoder. While the joint moves
many steps from sample to sample, the rounding error is white too. While it moves slowly, the rounding error has
frequencies as low as those of the motion. So errors are simulated as new readings of the smooth motion, not as white
noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from identification.data.log import Log
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.random_streams import random_stream

# Orders of the differences. A higher one removes more of the motion. The smallest of their noise estimates is used.
_ORDERS = (2, 3, 4, 6)
_FEWEST_READINGS = 50  # smallest number of readings from which a noise is estimated; with fewer it is unknown
# A step is wrong if rounding the smooth motion to it makes its differences this many times those of the readings.
_TOO_COARSE = 1.5


@dataclass(frozen=True)
class ReadingNoise:
    """Noise and rounding with which the position of a joint is read.

    Attributes:
        white: Standard deviation of the white noise before rounding [rad or m].
        step: Step of the readings [rad or m]; zero if they are not rounded.
    """

    white: float
    step: float

    def errors(self, q: Float[Array, " N"], rng: np.random.Generator) -> Float[Array, " N"]:
        """Random errors of readings of the positions ``q`` [rad or m], shape ``(N,)``.

        Args:
            q: True positions [rad or m].
            rng: Draws the noise, and the position of the encoder's zero.
        """
        error = self.white * rng.normal(size=len(q))
        if self.step == 0.0:
            return error
        zero = rng.uniform(0.0, self.step)
        return np.round((q + error - zero) / self.step) * self.step + zero - q


def reading_noise(log: Log, row: int) -> ReadingNoise | None:
    """Noise of a joint's position readings in a log; None without raw readings.

    The power of the white noise is that of the readings' differences, minus that of the differences of the smooth
    motion after rounding to the same steps.

    Args:
        log: A recording at its full rate.
        row: Index of the joint.
    """
    if log.raw_q is None or int(log.valid.sum()) < _FEWEST_READINGS:
        return None
    seen = white_part(log.raw_q[:, row], log.valid)
    step = (log.reading_steps[row] if log.reading_steps else None) or 0.0
    smooth = log.motion.q[:, row]
    rounding = ReadingNoise(0.0, step).errors(smooth, random_stream("rounding of a smooth motion"))
    rounded = white_part(smooth + rounding, log.valid)
    if rounded > _TOO_COARSE * seen:
        # The step is too coarse for these readings. A joint at rest has few different readings, which fit many steps.
        return ReadingNoise(seen, 0.0)
    return ReadingNoise(float(np.sqrt(max(seen**2 - rounded**2, 0.0))), float(step))


def white_part(readings: Float[Array, " N"], valid: Bool[Array, " N"]) -> float:
    """Standard deviation [rad or m] of white noise whose differences are as large as those of the readings.

    Args:
        readings: Readings of a smooth motion [rad or m].
        valid: False where a reading must not be used.
    """
    out = []
    for order in _ORDERS:
        all_valid = np.convolve(~valid, np.ones(order + 1), mode="valid") == 0
        change = np.diff(readings, order)[all_valid]
        if len(change):
            # The difference of order n of white noise has comb(2 n, n) times its variance.
            out.append(float(np.sqrt(np.mean(change**2) / comb(2 * order, order))))
    return min(out, default=0.0)
