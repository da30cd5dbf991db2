"""Joints that move at one frequency alone, and what their recordings show of the torque.

A law of friction shows in the odd harmonics of one sine. Where the band of a recording ends below the third, nothing is
seen but two numbers, with the velocity and with the position, and every law makes any of them. Beside recordings that
show more they tell nothing of laws, and the search fits small errors of the model by other laws: they are not judged.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.checks.one_line import is_one_sine
from identification.data.log import Log
from identification.diagnosis.columns.motion.standstill import standing_still
from phantom_dyn.array_types import Array, Bool

# Multiple of a sine's frequency that dry friction makes besides: its first harmonic.
_HARMONIC = 3.0


def moving(logs: tuple[Log, ...]) -> Bool[Array, "L nv"]:
    """Which joints move in each recording."""
    return np.array([~standing_still(log).all(axis=0) for log in logs])


def in_one_sine(logs: tuple[Log, ...], moves: Bool[Array, "L nv"]) -> frozenset[int]:
    """Joints that move at one frequency alone in every recording in which they move, by their indices."""
    return frozenset(np.flatnonzero(moves.any(axis=0) & (_sines(logs) | ~moves).all(axis=0)).tolist())


def two_numbers_beside_more(logs: tuple[Log, ...], moves: Bool[Array, "L nv"]) -> Bool[Array, "L nv"]:
    """True where a joint's recording shows two numbers alone, while another one shows more of it."""
    few = moves & _sines(logs) & np.array([_without_harmonics(log) for log in logs])
    return few & (moves & ~few).any(axis=0)


def held(log: Log) -> Log:
    """A recording that is not judged, with its joints held: no grid of speeds is made for it."""
    still = np.zeros_like(log.motion.v)
    return replace(log, motion=replace(log.motion, v=still, a=still))


def _sines(logs: tuple[Log, ...]) -> Bool[Array, "L nv"]:
    return np.array([[is_one_sine(q) for q in log.motion.q[log.valid].T] for log in logs])


def _without_harmonics(log: Log) -> Bool[Array, " nv"]:
    """True for joints of which the band of a recording ends below the third harmonic of one sine."""
    q, v = log.motion.q[log.valid], log.motion.v[log.valid]
    return _HARMONIC * v.std(axis=0) > 2 * np.pi * log.band.cutoff_hz * q.std(axis=0)
