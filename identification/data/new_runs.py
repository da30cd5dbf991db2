"""Finds the rows of a recording at which another run begins, and excludes the jump to each of them.

If a user joins two runs in one file, the time continues without a gap, but the joints jump from one row to the next. An
encoder that loses counts or restarts makes only one joint jump. So a jump of several joints in one row means that
another run begins there, or that rows are missing. Such a jump is excluded like a gap in time.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.data.recording import Recording, when
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import listed

# A step of a joint is a jump if it is longer than `_JUMP` times the distance that the joint travels in the same time at
# the largest speed of the `_BESIDE` rows before and after the step.
_JUMP, _BESIDE = 6.0, 5
# Smallest jump of an angle [rad] and of a length [m].
_LEAST_ANGLE, _LEAST_LENGTH = 0.02, 0.002
# Smallest number of joints that jump in one row where a run begins.
_FEWEST_JOINTS = 2
# If a larger share of rows has single large steps, these are fast motions or held readings, and no run begins there.
_LARGEST_SHARE = 0.01


def with_jumps_excluded(recording: Recording, prismatic: Bool[Array, " nv"]) -> Recording:
    """The recording with each jump to another run excluded from fits; a warning says where these jumps are.

    Args:
        recording: Raw samples, with whole turns of encoders unwrapped.
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
    """True where a joint jumps from the row before, shape ``(N, nv)``.

    If positions repeat before a step, the readings may have stalled while the joint moved. So the speed after the step
    is multiplied by the whole time since the last change of a position.

    Args:
        t: Time [s].
        q: Positions [rad or m].
        least: Smallest jump of each joint [rad or m].
    """
    out = np.zeros(q.shape, dtype=bool)
    steps = np.abs(np.diff(q, axis=0))
    durations = np.diff(t)
    speeds = steps / durations[:, None]
    # For each step, the index of the last step, up to this one, in which some joint moves.
    last_moving = np.maximum.accumulate(np.where((steps > 0).any(axis=1), np.arange(len(steps)), -1))
    # Steps much faster than the step before and the step after.
    single = (steps[1:-1] > least) & (speeds[1:-1] > _JUMP * np.maximum(speeds[:-2], speeds[2:]))
    candidates = np.flatnonzero(np.count_nonzero(single, axis=1) >= _FEWEST_JOINTS) + 1
    if len(candidates) > _LARGEST_SHARE * len(t):
        return out
    for k in candidates:
        last = int(last_moving[k - 1])
        before, after = speeds[max(last + 1 - _BESIDE, 0) : last + 1], speeds[k + 1 : k + 1 + _BESIDE]
        if len(before) < _BESIDE or len(after) < _BESIDE:
            continue
        distance = np.maximum(durations[k] * before.max(axis=0), (t[k + 1] - t[last + 1]) * after.max(axis=0))
        out[k + 1] = steps[k] > np.maximum(_JUMP * distance, least)
    return out
