"""Noise of position readings, from differences of neighbouring raw readings, in which the motion cancels.

A reading is the position plus white noise of the sensor, rounded to the steps of the encoder. Where the joint moves
many steps from sample to sample the rounding error is white too; where it moves slowly, the error follows the steps and
has frequencies as low as those of the motion. So errors are simulated as new readings of the smooth motion, not as
white noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from identification.data.log import Log
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.random_streams import random_stream

_ORDERS = (2, 3, 4, 6)  # orders of differences: each removes more of the motion; the smallest estimate is taken
_FEWEST = 50  # smallest number of readings: fewer say little about a joint
# If rounding to the supposed step would make differences more than this many times those seen, the step is wrong.
_COARSER = 1.5


@dataclass(frozen=True)
class ReadingNoise:
    """How the position of a joint is read.

    Attributes:
        white: Standard deviation of the noise before rounding [rad or m].
        step: Step of the readings [rad or m]; zero where they have none.
    """

    white: float
    step: float

    def errors(self, q: Float[Array, " N"], rng: np.random.Generator) -> Float[Array, " N"]:
        """Errors of one more reading of the positions ``q`` [rad or m], shape ``(N,)``.

        Args:
            q: True positions.
            rng: Draws the noise, and the start of the lattice.
        """
        error = self.white * rng.normal(size=len(q))
        if self.step == 0.0:
            return error
        start = rng.uniform(0.0, self.step)
        return np.round((q + error - start) / self.step) * self.step + start - q


def reading_noise(log: Log, row: int) -> ReadingNoise | None:
    """Noise of a joint's position readings in a log; None without raw readings.

    The white part is the power of the readings' differences beyond that of the smooth motion rounded to the same steps.

    Args:
        log: A recording at its full rate.
        row: Index of the joint.
    """
    if log.raw_q is None or int(log.valid.sum()) < _FEWEST:
        return None
    seen = white_part(log.raw_q[:, row], log.valid)
    step = (log.reading_steps[row] if log.reading_steps else None) or 0.0
    smooth = log.motion.q[:, row]
    rounding = ReadingNoise(0.0, step).errors(smooth, random_stream("rounding of a smooth motion"))
    rounded = white_part(smooth + rounding, log.valid)
    if rounded > _COARSER * seen:
        # The supposed step is too coarse for these readings: the few levels of a joint at rest fit any step.
        return ReadingNoise(seen, 0.0)
    return ReadingNoise(float(np.sqrt(max(seen**2 - rounded**2, 0.0))), float(step))


def white_part(readings: Float[Array, " N"], valid: Bool[Array, " N"]) -> float:
    """Standard deviation of white noise with differences as large as those of the readings.

    Args:
        readings: Readings of a smooth motion.
        valid: False where a reading must not be used.
    """
    out = []
    for order in _ORDERS:
        whole = np.convolve(~valid, np.ones(order + 1), mode="valid") == 0
        change = np.diff(readings, order)[whole]
        if len(change):
            out.append(float(np.sqrt(np.mean(change**2) / comb(2 * order, order))))
    return min(out, default=0.0)
