"""Selects representative parts of long recordings, so that the cost does not grow with the hours recorded."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from identification.data.floating.base_columns import readings_at
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Float, read_only

LONGEST = 600.0
"""Longest recording [s] that is used as a whole."""
_STRETCH, _COUNT = 20.0, 15  # length [s] and number of the stretches that are taken from a longer recording
# Smallest number of samples of a stretch. The edge of the band is at most 6 % of the rate, so its filter needs 33
# samples (two periods of the edge) at either end, and the smallest fit needs 133 more. A stretch has twice the sum.
_SAMPLES = 400


def stretches(recording: Recording) -> tuple[Recording, ...]:
    """The parts of a recording that are used: all of a short one, fifteen stretches of a long one.

    A long recording is cut into fifteen equal parts, and the stretch of 20 s with the most motion is taken from each. A
    joint's motion is measured relative to its motion in the whole recording, so that joints that seldom move count as
    much as the others.

    Args:
        recording: Raw samples. Its warnings are kept with the first stretch only.
    """
    if not is_long(recording):
        return (recording,)
    windows = _windows(recording)
    moved = _movement(recording, windows)
    groups = np.array_split(np.arange(len(windows)), _COUNT)
    best = [group[np.argmax(moved[group])] for group in groups if len(group)]
    parts = [part_of(recording, slice(*windows[k])) for k in best]
    return (parts[0], *(replace(part, warnings=(), notes=(), wrong=()) for part in parts[1:]))


def busiest(recording: Recording) -> Recording:
    """The recording; if it is long, only the fifteen consecutive stretches in which the joints move most."""
    if not is_long(recording):
        return recording
    windows = _windows(recording)
    together = min(_COUNT, len(windows))
    k = int(np.argmax(np.convolve(_movement(recording, windows), np.ones(together), "valid")))
    return part_of(recording, slice(windows[k][0], windows[k + together - 1][1]))


def is_long(recording: Recording) -> bool:
    """True if the recording is so long that only stretches of it are used."""
    return bool(recording.t[-1] - recording.t[0] > LONGEST) and len(_windows(recording)) > _COUNT


def note_on_length(recording: Recording) -> str:
    """A sentence that says which part of a long recording is used."""
    return (
        f"{recording.file} lasts {recording.t[-1] - recording.t[0]:.0f} s: fits and figures are of {_COUNT} stretches "
        f"of {_length(recording):.3g} s from its beginning to its end, those in which the joints move most."
    )


def part_of(recording: Recording, rows: slice) -> Recording:
    """The recording with only the given rows of all its series."""

    def some(x: Array | None) -> Array | None:
        return None if x is None else read_only(x[rows])

    return replace(
        recording,
        t=read_only(recording.t[rows]),
        q=read_only(recording.q[rows]),
        tau=some(recording.tau),
        v=some(recording.v),
        current=some(recording.current),
        voltage=some(recording.voltage),
        q_ref=some(recording.q_ref),
        v_ref=some(recording.v_ref),
        x=some(recording.x),
        temperature=some(recording.temperature),
        supply=some(recording.supply),
        forces={frame: read_only(force[rows]) for frame, force in recording.forces.items()},
        positions={frame: read_only(position[rows]) for frame, position in recording.positions.items()},
        orientations={frame: read_only(orientation[rows]) for frame, orientation in recording.orientations.items()},
        passive_q={joint: read_only(q[rows]) for joint, q in recording.passive_q.items()},
        base=readings_at(recording.base, rows),
    )


def _length(recording: Recording) -> float:
    """Length of a stretch [s]; longer than `_STRETCH` if it would have fewer than `_SAMPLES` samples."""
    return max(_STRETCH, _SAMPLES * float(np.median(np.diff(recording.t))))


def _windows(recording: Recording) -> list[tuple[int, int]]:
    """First row and end row (exclusive) of each stretch; stretches that are mostly a gap are left out."""
    t, length = recording.t, _length(recording)
    starts = np.append(np.searchsorted(t, np.arange(t[0], t[-1], length)), len(t)).tolist()
    return [(a, b) for a, b in pairwise(starts) if b > a and t[b - 1] - t[a] > 0.5 * length]


def _movement(recording: Recording, windows: list[tuple[int, int]]) -> Float[Array, " w"]:
    """Motion in each window: the share of each joint's total travel in the window, summed over the joints."""
    unused = np.zeros(len(recording.t), dtype=bool)
    for start, stop in recording.excluded:
        unused |= (recording.t >= start) & (recording.t <= stop)
    out = np.zeros(len(windows))
    for column in recording.q.T:
        steps = np.diff(column, append=column[-1])
        np.abs(steps, out=steps)
        steps[unused] = 0.0  # motion in excluded intervals does not count
        travel = np.array([steps[slice(*window)].sum() for window in windows])
        out += travel / max(float(travel.sum()), 1e-300)
    return out
