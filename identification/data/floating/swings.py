"""When the row of a joint may be judged on a base that is not bolted down: while nothing touches what it carries."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from identification.data.floating.base_columns import carriers
from identification.data.log import Log
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot

_MARGIN = 0.02
"""Seconds left out before and after a contact of a foot begins or ends: a threshold of a force is crossed late."""
_IMPACT = 0.01
"""Seconds left out of all rows around a change of any contact: the impact shakes the sensors of the base."""
_PERIODS = 6.0
"""Periods of the band's edge that a usual swing has: the filter of the band takes four of them."""
_SHARE, _LEAST, _MOST = 0.1, 20.0, 50.0
"""The edge is at most this share of the rate; slow swings have the first edge at least, short ones the second [Hz]."""


def touched_rows(recording: Recording, robot: Robot, t: Float[Array, " N"]) -> Bool[Array, "N nv"] | None:
    """True where the row of a joint is not free of contact forces, or may not be; None where nobody knows of contacts.

    Args:
        recording: Says which frames touch something.
        robot: Says which joints carry them.
        t: Times at which it is asked, uniform [s].
    """
    if recording.base is None:
        return None
    rate = (len(t) - 1) / (t[-1] - t[0])
    out = np.zeros((len(t), robot.nv), dtype=bool)
    for frame, values in recording.base.contacts.items():
        # Between two samples anything may have happened.
        touches = np.interp(t, recording.t, values) > 0
        changes = np.diff(touches, prepend=touches[0])
        out |= _about(changes, _IMPACT * rate)[:, None]
        out |= _about(touches, _MARGIN * rate)[:, None] & carriers(robot, frame)
    return out


def _about(true: Bool[Array, " N"], reach: float) -> Bool[Array, " N"]:
    """True within so many samples of a true one."""
    return ndimage.maximum_filter1d(true, 2 * max(1, round(reach)) + 1, axis=0)


def band_of_swings(recordings: Sequence[Recording], robot: Robot, moving_hz: float) -> float | None:
    """Edge [Hz] of a band whose filter fits into the usual swing once and a half; None where nothing ever touches.

    Feet on the ground shake all, so that spectra tell nothing of how fast swings are.

    Args:
        recordings: Say which frames touch something.
        robot: Says which joints carry them.
        moving_hz: Edge of the band that spectra show.
    """
    lengths, rate = [], np.inf
    for recording in recordings:
        step = (recording.t[-1] - recording.t[0]) / (len(recording.t) - 1)
        rate = min(rate, 1 / step)
        touched = touched_rows(recording, robot, np.linspace(recording.t[0], recording.t[-1], len(recording.t)))
        if touched is None or not touched.any():
            continue
        for column in touched.T:
            edges = np.flatnonzero(np.diff(np.concatenate([[True], column, [True]])))
            lengths += (step * np.diff(edges)[::2]).tolist()
    if not lengths:
        return None
    # Each swing counts by its length: a flickering contact leaves many that are of no use.
    ordered = np.sort(lengths)
    usual = ordered[np.searchsorted(np.cumsum(ordered), 0.5 * ordered.sum())]
    return float(min(max(_PERIODS / usual, min(moving_hz, _LEAST)), _SHARE * rate, _MOST))


def require_swings(logs: Sequence[Log]) -> None:
    """Refuse recordings in which something touches what every joint carries, all the time.

    Raises:
        LogError: It says how long swings have to be.
    """
    if any(log.touched is None or (log.untouched_in_band & log.valid_in_band[:, None]).any() for log in logs):
        return
    log = logs[0]
    needed = (2 * log.band.half + 1) / log.band.rate_hz
    raise LogError(
        f"{log.file}: no joint is free of contacts for {needed:.2g} s, which the filter needs at "
        f"{log.band.rate_hz:.0f} Hz: let the robot hang or lift its feet for longer, or record at a higher rate."
    )
