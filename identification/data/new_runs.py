"""Finds where a recording goes on with another run, so that nothing is computed across that row.

Where a user puts two runs into one file, the time goes on and the joints are elsewhere from one row to the next. An
encoder that loses counts or starts anew is that of one joint: several joints jump in one row only where a run begins or
rows are missing. Both are a break of the recording, as one in time is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.recording import Recording, when
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import listed

# A joint jumps if its step is this many times as large as the way that it could have gone at the largest speed of so
# many rows before and after it.
_JUMP, _BESIDE = 6.0, 5
# Smallest jump of an angle [rad] and of a length [m].
_LEAST_ANGLE, _LEAST_LENGTH = 0.02, 0.002
# Smallest number of joints that jump in one row where a run begins.
_FEWEST_JOINTS = 2
# Share of rows with a single large step from which on such steps are motions between two samples, or held readings.
_LARGEST_SHARE = 0.01


def parted(recording: Recording, prismatic: Bool[Array, " nv"]) -> Recording:
    """The recording with its rows at the beginnings of other runs excluded; a warning says where they are.

    Args:
        recording: Raw samples, without turns of encoders.
        prismatic: True for linear joints, shape ``(nv,)``.
    """
    t = recording.t
    jumping = _jumping(t, recording.q, np.where(prismatic, _LEAST_LENGTH, _LEAST_ANGLE))
    for start, stop in recording.excluded:
        jumping[(t >= start) & (t <= stop)] = False
    starts = np.flatnonzero(np.count_nonzero(jumping, axis=1) >= _FEWEST_JOINTS)
    if not len(starts):
        return recording
    joints = listed([joint for j, joint in enumerate(recording.joint_names) if jumping[starts, j].any()])
    warning = (
        f"{recording.file}: {joints} jump in one row ({when(t[starts])}): another run begins there, or rows are "
        "missing. Nothing is computed across it, as across a gap in time."
    )
    return replace(
        recording,
        excluded=(*recording.excluded, *((float(t[k - 1]), float(t[k])) for k in starts)),
        warnings=(*recording.warnings, warning),
    )


def _jumping(t: Float[Array, " N"], q: Float[Array, "N nv"], least: Float[Array, " nv"]) -> Bool[Array, "N nv"]:
    """True for joints that jump from the row before.

    Positions that repeat before a step may be readings that stalled: then the joint had the time of all these rows for
    its way, at the speed with which it moves on.

    Args:
        t: Time [s].
        q: Positions [rad or m].
        least: Smallest jump of each joint [rad or m].
    """
    out = np.zeros(q.shape, dtype=bool)
    steps = np.abs(np.diff(q, axis=0))
    durations = np.diff(t)
    speeds = steps / durations[:, None]
    # The last step before each one with which some joint moves.
    moved = np.maximum.accumulate(np.where((steps > 0).any(axis=1), np.arange(len(steps)), -1))
    alone = (steps[1:-1] > least) & (speeds[1:-1] > _JUMP * np.maximum(speeds[:-2], speeds[2:]))
    candidates = np.flatnonzero(np.count_nonzero(alone, axis=1) >= _FEWEST_JOINTS) + 1
    if len(candidates) > _LARGEST_SHARE * len(t):
        return out
    for k in candidates:
        last = int(moved[k - 1])
        before, after = speeds[max(last + 1 - _BESIDE, 0) : last + 1], speeds[k + 1 : k + 1 + _BESIDE]
        if len(before) < _BESIDE or len(after) < _BESIDE:
            continue
        way = np.maximum(durations[k] * before.max(axis=0), (t[k + 1] - t[last + 1]) * after.max(axis=0))
        out[k + 1] = steps[k] > np.maximum(_JUMP * way, least)
    return out
