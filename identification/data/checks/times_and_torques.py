"""Checks of sampling times and torques: jitter, gaps, clipped, constant and zero torques."""

from __future__ import annotations

import numpy as np

from identification.data.checks.smoothed_copy import included
from identification.data.recording import Recording, time_text
from phantom_dyn.array_types import Array, Float

# A time step is irregular if it differs from the median by more than this share; real-time systems keep 1 %.
_JITTER = 0.1
# Smallest share of irregular steps for a warning.
_IRREGULAR_SHARE = 0.01
# A time step of more than this number of medians is a gap: samples are missing.
_GAP = 2.5

# A torque is clipped if at least this share of its samples, or this number of samples in a row, have its extreme value.
# If every torque is held for some rows, these rows count as one sample.
_CLIPPED_SHARE, _CLIPPED_RUN = 0.01, 5
# Torques of zero are checked if they make the first share of the rows, in at least the second number of intervals. In
# the third number of intervals or more, they cannot be caused by a drive that was switched off.
_MOSTLY, _FEW, _OFTEN = 0.5, 4, 20
# A joint that passes this often from one end of its range to the other needs a torque that changes.
_PASSAGES = 4
# Ratio of the smallest to the largest torque: above the first number small torques are missing, above the second all
# torques have the same size.
_GAP_BELOW, _ALIKE = 0.1, 0.9
# Fewer samples in a row at the extreme value may be the peak of a repeated motion without noise.
_SHORTEST_RUN = 2
# A clipped torque has at least this ratio of samples at its extreme value to samples at the next level; a smooth peak,
# however coarsely rounded, has at most 2.4.
_TOP_HEAVY = 4


def check_timing(recording: Recording) -> tuple[str, ...]:
    """Warnings on irregular sampling and missing samples."""
    kept = included(recording)
    steps = np.diff(recording.t)[kept[1:] & kept[:-1]]
    starts = recording.t[:-1][kept[1:] & kept[:-1]]
    if not len(steps):
        return ()
    step = float(np.median(steps))
    gap = steps > _GAP * step
    out = []
    irregular = np.abs(steps - step) > _JITTER * step
    share = float(np.mean(irregular & ~gap))
    if share > _IRREGULAR_SHARE:
        low, high = np.percentile(steps[~gap], [1, 99])
        out.append(
            f"{recording.file}: sampling is irregular: {100 * share:.0f} % of the steps differ from the median of "
            f"{1e3 * step:.3g} ms by more than {100 * _JITTER:.0f} % (1st to 99th percentile {1e3 * low:.3g} to "
            f"{1e3 * high:.3g} ms)."
        )
    if gap.any():
        worst = int(np.argmax(steps))
        noun = "gap" if gap.sum() == 1 else "gaps"
        out.append(
            f"{recording.file}: {int(gap.sum())} {noun} in time; the longest lasts {steps[worst]:.3g} s at "
            f"t = {time_text(starts[worst])} s, where a step is {step:.3g} s."
        )
    return tuple(out)


def _clipped(tau: Float[Array, " N"]) -> tuple[float, float, int] | None:
    """Extreme value, share of samples at it and longest run, if the upper end of ``tau`` is clipped."""
    extent = np.ptp(tau)
    top = float(np.max(tau))
    levels = np.unique(tau[tau >= top - 0.1 * extent])
    # Levels that differ by rounding only are one level.
    levels = levels[np.concatenate([[True], np.diff(levels) > 1e-9 * extent])]
    step = max(float(top - levels[-2]) if len(levels) > 1 and len(levels) < 50 else 0.0, 2e-3 * extent)
    at_top = tau >= top - 1e-9 * max(extent, abs(top))
    below = (tau < top) & ~at_top & (tau >= top - 1.5 * step)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at_top, [False]])))
    run = int(np.max(edges[1::2] - edges[::2]))
    share = float(np.mean(at_top))
    read = run / _rows_held(tau)
    often = share >= _CLIPPED_SHARE and read >= _SHORTEST_RUN
    if (often or read >= _CLIPPED_RUN) and at_top.sum() >= _TOP_HEAVY * max(int(below.sum()), 1):
        return top, share, run
    return None


def _rows_held(tau: Float[Array, " N"]) -> float:
    """Median number of rows for which a torque is held: more than 1 if it is read more slowly than it is logged."""
    edges = np.flatnonzero(np.diff(tau, prepend=np.nan, append=np.nan) != 0)
    values = tau[edges[:-1]]
    between = (values > np.min(tau)) & (values < np.max(tau))
    return float(np.median(np.diff(edges)[between])) if between.any() else 1.0


def check_zeros(recording: Recording) -> tuple[str, ...]:
    """Warnings on torques that are exactly zero in many intervals, as if the drive does not report small torques."""
    if recording.tau is None:
        return ()
    out, kept = [], included(recording)
    for j, joint in enumerate(recording.joint_names):
        zero = recording.tau[kept, j] == 0
        starts = int(np.count_nonzero(np.diff(zero.astype(int)) == 1))
        if not (_MOSTLY <= zero.mean() < 1 and starts >= _FEW):
            continue
        others = np.abs(recording.tau[kept, j][~zero])
        size = float(others.min())
        # Torques of equal size are pulses of a controller, and a drive that is switched off has few intervals of zero.
        if starts >= _OFTEN or _GAP_BELOW * others.max() < size < _ALIKE * others.max():
            out.append(
                f"{recording.file}: tau.{joint} is exactly 0 in {100 * zero.mean():.0f} % of the rows, {starts} times "
                f"for a while, and never smaller than {size:.2g} otherwise: its drive reports small torques as none. "
                f"What is said of {joint} is not to be relied on: log the torque before it is cut off."
            )
    return tuple(out)


def check_flat(recording: Recording) -> tuple[str, ...]:
    """Warnings on torques that stay constant for a long time while their joint moves to and fro."""
    if recording.tau is None:
        return ()
    out, kept = [], included(recording)
    for j, joint in enumerate(recording.joint_names):
        tau, q = recording.tau[kept, j], recording.q[kept, j]
        if not len(tau) or np.ptp(tau) == 0:
            continue
        edges = np.flatnonzero(np.diff(tau, prepend=np.nan, append=np.nan) != 0)
        longest = int(np.argmax(np.diff(edges)))
        start, stop = int(edges[longest]), int(edges[longest + 1])
        if stop - start < _MOSTLY * len(tau) or _passages(q[start:stop], float(np.ptp(q))) < _PASSAGES:
            continue
        first, last = (time_text(float(recording.t[kept][k])) for k in (start, stop - 1))
        out.append(
            f"{recording.file}: tau.{joint} is {tau[start]:.6g} in every row from {first} to {last} s "
            f"({100 * (stop - start) / len(tau):.0f} % of the rows), while {joint} goes to and fro: if its drive was "
            f"held or off there, nothing is to be done; if its torque was not recorded, leave that out with "
            f"--exclude {first}:{last}."
        )
    return tuple(out)


def _passages(q: Float[Array, " n"], travel: float) -> int:
    """Number of times that a joint goes from the lower to the upper third of its range, or back."""
    thirds = np.digitize(q, q.min() + travel * np.array([1 / 3, 2 / 3]))
    ends = thirds[thirds != 1]
    return int(np.count_nonzero(np.diff(ends)))


def check_clipping(recording: Recording) -> tuple[str, ...]:
    """Warnings on torques that stay at their extreme value, as a clipped signal does."""
    if recording.tau is None:
        return ()
    out = []
    for j, joint in enumerate(recording.joint_names):
        tau = recording.tau[:, j]
        if np.ptp(tau) == 0:
            if tau[0] != 0:
                out.append(f"{recording.file}: the torque of {joint} is {tau[0]:.6g} throughout: was it recorded?")
            continue
        for sign in (1.0, -1.0):
            found = _clipped(sign * tau)
            if found is not None:
                value, share, run = found
                out.append(
                    f"{recording.file}: the torque of {joint} sits at {sign * value:.6g} for {100 * share:.2g} % of "
                    f"the samples, up to {run} in a row: it is clipped there."
                )
    return tuple(out)
