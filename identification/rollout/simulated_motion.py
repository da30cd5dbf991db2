"""Adds the simulated motion of all windows to the samples from which the figures of a report are drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identification.data.log import Log
from identification.diagnosis.evidence import Evidence, SimulatedPositions
from identification.rollout.compare import Rollout


def with_simulated_motion(evidence: Evidence, rollout: Rollout, logs: Sequence[Log]) -> Evidence:
    """Evidence with the simulated motion of the given and of the corrected model; unchanged if no motion was simulated.

    Args:
        evidence: Samples of all recordings, one after the other.
        rollout: Simulated windows of the recordings.
        logs: The recordings.
    """
    if not rollout.motions or len(evidence.t) != sum(len(log.motion.t[log.samples]) for log in logs):
        return evidence
    before, after = np.full(evidence.q.shape, np.nan), np.full(evidence.q.shape, np.nan)
    rows_of = [np.arange(len(log.motion.t))[log.samples] for log in logs]
    firsts = np.cumsum([0, *(len(rows) for rows in rows_of)])
    seconds = 0.0
    for motion in rollout.motions:
        window, rows = motion.window, rows_of[motion.window.log]
        # The first sample equals the recorded one. It is left out, so that adjoining windows are separate curves.
        inside = np.flatnonzero((rows > window.start) & (rows < window.stop))
        at = firsts[window.log] + inside
        for out, q in ((before, motion.given), (after, motion.corrected)):
            here = q[rows[inside] - window.start]
            # For a legged robot a window contains one swinging leg, and all other joints are NaN. As windows of
            # different legs may overlap, NaN must not overwrite other values.
            out[at] = np.where(np.isnan(here), out[at], here)
        t = logs[window.log].motion.t
        seconds = max(seconds, float(t[window.stop - 1] - t[window.start]))
    return replace(evidence, simulated=SimulatedPositions(before, after, seconds, rollout.controlled))
