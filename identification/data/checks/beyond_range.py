"""Finds positions that a joint cannot have: more than a turn outside the range that the robot's file states."""

from __future__ import annotations

import numpy as np

from identification.data.checks.smoothed_copy import included
from identification.data.readers.map_entries import entries_words
from identification.data.recording import Fault, Recording
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot, position_limits

_TURN = 2 * np.pi  # [rad]
# Positions are wrong only if at least this share of the samples is more than a turn outside. A smaller share may be a
# spike, or a turn that was miscounted for a while.
_LEAST_SHARE = 0.05


def beyond_range(recording: Recording, robot: Robot) -> tuple[Fault, ...]:
    """The fault of positions that are more than a turn outside a joint's range.

    Positions that are inside after whole turns are subtracted are no fault, because an encoder may count turns. The
    check needs no torque.

    Args:
        recording: Raw samples.
        robot: Gives the ranges of the joints.
    """
    lower, upper = position_limits(robot)
    q = recording.q[included(recording)]
    if not len(q):
        return ()
    found = [
        row
        for row in range(robot.nv)
        if not robot.prismatic[row] and np.isfinite([lower[row], upper[row]]).all()
        if _outside(q[:, row], lower[row], upper[row])
    ]
    if not found:
        return ()
    names = [robot.joint_names[row] for row in found]
    row = found[0]
    extreme = float(q[np.argmax(np.abs(q[:, row])), row])
    why = (
        f"q.{names[0]} reaches {extreme:.4g} rad, and its range is {lower[row]:.3g} to {upper[row]:.3g} rad: more than "
        "a turn outside"
    )
    what = f"the positions of {', '.join(names)} are where {'it' if len(names) == 1 else 'they'} cannot be"
    if all(_inside(np.deg2rad(q[:, row]), lower[row], upper[row]) for row in found):
        entries = {f"q.{name}": f"{{from: q.{name}, unit: deg}}" for name in names}
        return (Fault(what, why, entries_words(recording, entries)),)
    return (Fault(what, why, "correct the unit or the zero of the column, or the range in the robot's file"),)


def _outside(q: Float[Array, " N"], lower: float, upper: float) -> bool:
    """True if many positions are more than a turn outside, and subtracting whole turns does not bring them inside."""
    far = (q > upper + _TURN) | (q < lower - _TURN)
    if far.mean() < _LEAST_SHARE:
        return False
    turns = np.round((np.median(q) - 0.5 * (lower + upper)) / _TURN)
    return not _inside(q - turns * _TURN, lower, upper)


def _inside(q: Float[Array, " N"], lower: float, upper: float) -> bool:
    """True if positions are in the range, or outside by less than a twentieth of it."""
    margin = 0.05 * (upper - lower)
    return bool(q.min() >= lower - margin and q.max() <= upper + margin)
