"""Noise of position readings, seen in the raw record: differences of neighbouring readings, in which motion cancels.

A reading is the position, with white noise of the sensor, rounded to the lattice of the encoder. Where the joint moves
many steps from sample to sample the rounding is white too; where it moves slowly the error follows the lattice and
reaches down to the frequencies of the motion. So errors are drawn by reading a smooth motion again, not as white noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np

from identification.data.log import Log
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.random_streams import random_stream

_ORDERS = (2, 3, 4, 6)  # of differences: each takes off more of the motion, and the least value counts
_FEWEST = 50  # readings: fewer say little about a joint
_COARSER = 1.5  # times the differences that are seen: a lattice that would make more is none of these readings


@dataclass(frozen=True)
class ReadingNoise:
    """How the position of a joint is read.

    Attributes:
        white: Standard deviation of the noise before rounding [rad or m].
        step: Of the lattice of readings [rad or m]; zero where they lie on none.
    """

    white: float
    step: float

    def errors(self, q: Float[Array, " N"], rng: np.random.Generator) -> Float[Array, " N"]:
        """Errors of one more reading of the positions ``q`` [rad or m], shape ``(N,)``.

        Args:
            q: True positions.
            rng: Draws the noise, and where the lattice starts.
        """
        error = self.white * rng.normal(size=len(q))
        if self.step == 0.0:
            return error
        start = rng.uniform(0.0, self.step)
        return np.round((q + error - start) / self.step) * self.step + start - q


def reading_noise(log: Log, row: int) -> ReadingNoise | None:
    """How the position of a joint is read in a log; None where its raw readings are not at hand.

    The white part is what the differences of the readings hold beyond those of the smooth motion on the same lattice.

    Args:
        log: A recording at its full rate.
        row: Which joint.
    """
    if log.raw_q is None or int(log.valid.sum()) < _FEWEST:
        return None
    seen = white_part(log.raw_q[:, row], log.valid)
    step = (log.reading_steps[row] if log.reading_steps else None) or 0.0
    smooth = log.motion.q[:, row]
    rounding = ReadingNoise(0.0, step).errors(smooth, random_stream("rounding of a smooth motion"))
    rounded = white_part(smooth + rounding, log.valid)
    if rounded > _COARSER * seen:
        # A lattice that the readings do not keep to: few levels of a joint at rest lie on any.
        return ReadingNoise(seen, 0.0)
    return ReadingNoise(float(np.sqrt(max(seen**2 - rounded**2, 0.0))), float(step))


def white_part(readings: Float[Array, " N"], valid: Bool[Array, " N"]) -> float:
    """Standard deviation of the white noise that would make the differences of readings as large.

    Args:
        readings: Smooth but for their noise.
        valid: False where a reading must not be used.
    """
    out = []
    for order in _ORDERS:
        whole = np.convolve(~valid, np.ones(order + 1), mode="valid") == 0
        change = np.diff(readings, order)[whole]
        if len(change):
            out.append(float(np.sqrt(np.mean(change**2) / comb(2 * order, order))))
    return min(out, default=0.0)
