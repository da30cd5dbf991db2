"""Detects diverged simulations, in which motion or torque grows without bound.

In a diverged simulation, speed and distance far exceed those of the rest of the recording, or double again and again. A
joint that only spins freely keeps its speed.
"""

from __future__ import annotations

import numpy as np

from identification.data.checks.smoothed_copy import included
from identification.data.readers.contract_columns import LARGEST
from identification.data.recording import Fault, Recording, time_text
from phantom_dyn.array_types import Array, Float

# Number of pieces into which a recording is cut; the usual size of a motion is the median over them.
_PIECES = 24
# Smallest speed of a diverged motion [rad/s or m/s], and its smallest ratio to the usual speed.
_LEAST_SPEED, _TIMES_SPEED = 100.0, 100.0
# Smallest distance from the start of a diverged motion [rad or m], and its smallest ratio to the usual distance.
_LEAST_DISTANCE, _TIMES_DISTANCE = 30.0, 20.0
# Speed and distance double again and again if, in this number of consecutive pieces, each exceeds the piece before by
# this factor.
_DOUBLING, _GROWS = 4, 2.0
# No machine has such a torque, in whatever unit, and no sensor gives such a position. After a simulation diverged, the
# reader of the file clips larger values to these limits.
_NO_TORQUE, _NO_POSITION = LARGEST["tau"], LARGEST["q"]
# Samples count as diverged if their speed is more than the first number times the usual speed. A diverged motion has at
# least the second number of them.
_BEYOND, _LEAST_ROWS = 5.0, 6


def diverged(recording: Recording) -> Fault | None:
    """The fault of a recording in which the motion of a joint grows without bound; None without such a joint.

    Args:
        recording: Raw samples; excluded intervals are ignored.
    """
    kept = included(recording)
    t, q = recording.t[kept], recording.q[kept]
    tau = None if recording.tau is None else recording.tau[kept]
    if len(t) < 2 * _PIECES:
        return None
    earliest: tuple[float, int, str] | None = None
    for j, joint in enumerate(recording.joint_names):
        row = _first_row(t, q[:, j], None if tau is None else tau[:, j])
        if row is not None and (earliest is None or t[row] < earliest[0]):
            size = f"q of {joint} reaches {np.abs(q[:, j]).max():.2g}"
            size += "" if tau is None else f", its torque {np.abs(tau[:, j]).max():.2g}"
            earliest = (float(t[row]), row, size)
    if earliest is None:
        return None
    start, row, size = earliest
    advice = "run it again with a smaller step or lower gains"
    if row >= len(t) // 8:
        advice = f"leave it out with --exclude {time_text(start)}:{time_text(t[-1])}, or {advice}"
    return Fault(
        f"the simulation or its controller is unstable: the motion grows without bound from about "
        f"t = {time_text(start)} s on",
        size,
        advice,
    )


def _first_row(t: Float[Array, " N"], q: Float[Array, " N"], tau: Float[Array, " N"] | None) -> int | None:
    """First diverged row of one joint; None without any."""
    for x, limit in ((tau, _NO_TORQUE), (q, _NO_POSITION)):
        if x is not None and np.abs(x).max() >= limit:
            # The motion diverged before the value reached the limit, so the first row is the one beyond the square root
            # of the limit.
            return int(np.argmax(np.abs(x) > np.sqrt(limit)))
    with np.errstate(over="ignore", invalid="ignore"):
        speed = np.abs(np.diff(q) / np.diff(t))
        distance = np.abs(q - np.median(q[: len(q) // _PIECES + 1]))
    speeds, distances = _by_piece(speed), _by_piece(distance)
    usual, usual_distance = float(np.median(speeds)), float(np.median(distances))
    far_larger = (
        speeds.max() > max(_LEAST_SPEED, _TIMES_SPEED * usual)
        and distances.max() > max(_LEAST_DISTANCE, _TIMES_DISTANCE * usual_distance)
        # A jump of an encoder is that fast for a few rows only.
        and np.count_nonzero(speed > _BEYOND * usual) >= _LEAST_ROWS
    )
    if not far_larger and not _doubles(speeds, distances):
        return None
    beyond = speed > _BEYOND * (usual if far_larger else float(speeds[: _first_doubling(speeds)].max()))
    return int(np.argmax(beyond))


def _by_piece(x: Float[Array, " N"]) -> Float[Array, " n"]:
    """Largest value in each of the `_PIECES` pieces of ``x``."""
    return np.array([piece.max() for piece in np.array_split(x, _PIECES)])


def _doubles(speeds: Float[Array, " n"], distances: Float[Array, " n"]) -> bool:
    """True if speed and distance double from piece to piece, up to values that no robot reaches."""
    large = bool(speeds.max() >= 10 * _LEAST_SPEED and distances.max() >= 10 * _LEAST_DISTANCE)
    return large and _first_doubling(speeds) < len(speeds) and _first_doubling(distances) < len(distances)


def _first_doubling(sizes: Float[Array, " n"]) -> int:
    """Index of the first of `_DOUBLING` consecutive pieces that each double the one before.

    The number of pieces if there are none.
    """
    grows = sizes[1:] > _GROWS * sizes[:-1]
    for k in range(len(grows) - _DOUBLING + 1):
        if sizes[k] > 0 and grows[k : k + _DOUBLING].all():
            return k + 1
    return len(sizes)
