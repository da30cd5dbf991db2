"""Finds the samples of a robot with a floating base at which no contact force acts on a joint.

A joint can be diagnosed only at these samples.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import ndimage

from identification.data.floating.base_columns import carrying_joints
from identification.data.log import Log
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot

_MARGIN = 0.02
"""Time excluded before a contact begins and after it ends [s]: a threshold on the force detects the beginning too late
and the end too early."""
_IMPACT = 0.01
"""Time excluded for all joints around each change of any contact [s]: the impact shakes the sensors of the base."""
_PERIODS = 6.0
"""Number of periods of the band's edge frequency in a typical swing; the band filter is four periods long."""
_RATE_SHARE, _LOWEST, _HIGHEST = 0.1, 20.0, 50.0
"""Limits of the band's edge: largest share of the sample rate, smallest and largest frequency [Hz]."""


def touched_rows(recording: Recording, robot: Robot, t: Float[Array, " N"]) -> Bool[Array, "N nv"] | None:
    """True where contact forces act or may act on a joint, shape ``(N, nv)``; None for a fixed base.

    Args:
        recording: States which frames touch something.
        robot: States which joints carry these frames.
        t: Uniform times [s], shape ``(N,)``.
    """
    if recording.base is None:
        return None
    rate = (len(t) - 1) / (t[-1] - t[0])
    out = np.zeros((len(t), robot.nv), dtype=bool)
    for frame, values in recording.base.contacts.items():
        # A contact may begin or end at any time between two samples.
        touches = np.interp(t, recording.t, values) > 0
        changes = np.diff(touches, prepend=touches[0])
        out |= _extended(changes, _IMPACT * rate)[:, None]
        out |= _extended(touches, _MARGIN * rate)[:, None] & carrying_joints(robot, frame)
    return out


def _extended(flags: Bool[Array, " N"], reach: float) -> Bool[Array, " N"]:
    """True for samples at most ``reach`` samples from a True, and at least for its neighbours."""
    return ndimage.maximum_filter1d(flags, 2 * max(1, round(reach)) + 1, axis=0)


def band_of_swings(recordings: Sequence[Recording], robot: Robot, moving_hz: float) -> float | None:
    """Edge [Hz] of a band whose filter is two thirds as long as a typical swing; None without any contact.

    The spectra cannot show how fast the swings are, because impacts of the feet shake the whole robot.

    Args:
        recordings: State which frames touch something.
        robot: States which joints carry these frames.
        moving_hz: Edge of the band that the spectra suggest [Hz].
    """
    lengths, rate = [], np.inf
    for recording in recordings:
        step = (recording.t[-1] - recording.t[0]) / (len(recording.t) - 1)
        rate = min(rate, 1 / step)
        touched = touched_rows(recording, robot, np.linspace(recording.t[0], recording.t[-1], len(recording.t)))
        if touched is None or not touched.any():
            continue
        for column in touched.T:
            # Edges are in turn the start and the end of a swing.
            edges = np.flatnonzero(np.diff(np.concatenate([[True], column, [True]])))
            lengths += (step * np.diff(edges)[::2]).tolist()
    if not lengths:
        return None
    # Each swing is weighted by its length, because a flickering contact makes many very short ones.
    ordered = np.sort(lengths)
    typical = ordered[np.searchsorted(np.cumsum(ordered), 0.5 * ordered.sum())]
    return float(min(max(_PERIODS / typical, min(moving_hz, _LOWEST)), _RATE_SHARE * rate, _HIGHEST))


def require_swings(logs: Sequence[Log]) -> None:
    """Raise an error if no joint is ever free of contact for long enough.

    Raises:
        LogError: The message says how long a joint has to be free of contact.
    """
    if any(log.touched is None or (log.untouched_in_band & log.valid_in_band[:, None]).any() for log in logs):
        return
    log = logs[0]
    needed = (2 * log.band.half + 1) / log.band.rate_hz
    raise LogError(
        f"{log.file}: no joint is free of contacts for {needed:.2g} s, which the filter needs at "
        f"{log.band.rate_hz:.0f} Hz: let the robot hang or lift its feet for longer, or record at a higher rate."
    )
