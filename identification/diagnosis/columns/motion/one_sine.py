"""Joints that move at one frequency alone, whose recordings may not show which law their friction follows.

If a joint moves in one sine, laws of friction differ only in the odd harmonics of the torque. If the band of the
recording ends below the third harmonic, only two numbers remain: the amplitudes in phase with the velocity and with the
position. Every law can produce any values of both. If other recordings show more of the joint, such recordings are not
used: they distinguish no laws, and the search would explain small errors of the model by wrong effects.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.checks.one_line import is_one_sine
from identification.data.log import Log
from identification.diagnosis.columns.motion.standstill import standing_still
from phantom_dyn.array_types import Array, Bool

# Lowest harmonic of a sine that dry friction excites, as a multiple of its frequency. A band that ends below this
# harmonic shows two numbers only.
_HARMONIC = 3.0


def moving(logs: tuple[Log, ...]) -> Bool[Array, "L nv"]:
    """Which joints move in each recording."""
    return np.array([~standing_still(log).all(axis=0) for log in logs])


def in_one_sine(logs: tuple[Log, ...], moves: Bool[Array, "L nv"]) -> frozenset[int]:
    """Joints that move at one frequency alone in every recording in which they move, by their indices."""
    return frozenset(np.flatnonzero(moves.any(axis=0) & (_sines(logs) | ~moves).all(axis=0)).tolist())


def uninformative_sines(logs: tuple[Log, ...], moves: Bool[Array, "L nv"]) -> Bool[Array, "L nv"]:
    """True if a recording shows only two amplitudes of a joint's torque, and another recording shows more of it."""
    few = moves & _sines(logs) & np.array([_without_harmonics(log) for log in logs])
    return few & (moves & ~few).any(axis=0)


def without_motion(log: Log) -> Log:
    """The log with zero velocities and accelerations, for a recording that is not used.

    Grids of shapes depend on the speeds of all recordings, and must not depend on this one.
    """
    still = np.zeros_like(log.motion.v)
    return replace(log, motion=replace(log.motion, v=still, a=still))


def _sines(logs: tuple[Log, ...]) -> Bool[Array, "L nv"]:
    """True for each recording and joint if the joint moves in one sine."""
    return np.array([[is_one_sine(q) for q in log.motion.q[log.valid].T] for log in logs])


def _without_harmonics(log: Log) -> Bool[Array, " nv"]:
    """True for joints for which the band of the recording ends below the third harmonic of their sine."""
    q, v = log.motion.q[log.valid], log.motion.v[log.valid]
    return _HARMONIC * v.std(axis=0) > 2 * np.pi * log.band.cutoff_hz * q.std(axis=0)
