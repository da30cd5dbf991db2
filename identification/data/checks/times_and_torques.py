"""Checks of sampling times and torques: jitter, gaps, clipping, and the lag of the torque against the motion.

The lag is found to a fraction of a sample: the torque is shifted until a rigid body with free inertial parameters and
friction leaves the smallest residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from identification.data.checks.smoothed_copy import Smooth, included
from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.model.robot import Robot

Array = np.ndarray

# A step that differs from the median by more than this share is irregular; timers of a real-time system keep 1 %.
_JITTER = 0.1
# Share of irregular steps that is worth a warning.
_IRREGULAR_SHARE = 0.01
# A step longer than this many medians is a gap: samples are missing.
_GAP = 2.5

# A torque counts as clipped from this share of the samples, or this many in a row, at its extreme value.
_CLIPPED_SHARE, _CLIPPED_RUN = 0.01, 5
# A smooth peak, however coarsely rounded, has at most 2.4 times as many samples in its top level as in the next.
_TOP_HEAVY = 4

_ROWS = 400  # samples in the regression of a lag
_BLOCKS = 8  # of the record, left out one at a time (jackknife) for the standard error of a lag
# Lags up to this many samples, and up to a quarter of a period at the cut-off, are tried in half samples.
_MOST_SAMPLES = 12
# From this many samples on a lag is worth a sentence, if it stands this many standard errors above zero.
_SMALLEST, _SIGNIFICANT = 0.4, 5.0
# The residual of rigid body and friction must be a small share of the torque's variance, and the shift must have
# removed a good part of it: with a poor model every lag fits a little better than none.
_LARGEST_RESIDUAL, _REMOVED = 0.05, 0.4


def check_timing(recording: Recording) -> tuple[str, ...]:
    """Sentences about irregular sampling and missing samples."""
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
            f"{recording.file}: {int(gap.sum())} {noun} in time; the longest lasts {1e3 * steps[worst]:.3g} ms at "
            f"t = {starts[worst]:.6g} s, where a step is {1e3 * step:.3g} ms."
        )
    return tuple(out)


def _clipped(tau: Float[Array, " N"]) -> tuple[float, float, int] | None:
    """Extreme value, share of samples at it and longest run, if the upper end of ``tau`` is clipped."""
    extent = np.ptp(tau)
    top = float(np.max(tau))
    levels = np.unique(tau[tau > top - 0.1 * extent])
    # Levels closer than the numbers' own rounding are one.
    levels = levels[np.concatenate([[True], np.diff(levels) > 1e-9 * extent])] if len(levels) else levels
    step = max(float(top - levels[-2]) if len(levels) > 1 and len(levels) < 50 else 0.0, 2e-3 * extent)
    at_top = tau >= top - 1e-9 * max(extent, abs(top))
    below = (tau < top) & ~at_top & (tau >= top - 1.5 * step)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at_top, [False]])))
    run = int(np.max(edges[1::2] - edges[::2]))
    share = float(np.mean(at_top))
    if (share >= _CLIPPED_SHARE or run >= _CLIPPED_RUN) and at_top.sum() >= _TOP_HEAVY * max(int(below.sum()), 1):
        return top, share, run
    return None


def check_clipping(recording: Recording) -> tuple[str, ...]:
    """Torques that sit at their extreme value."""
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


@dataclass(frozen=True)
class Lag:
    """Lag of one joint's torque beyond the lag that the robot's configuration states.

    Attributes:
        joint: Its name.
        samples: Lag in samples, late is positive.
        std: Standard error of the lag.
        removed: Share of the residual's sum of squares that the shift removes.
    """

    joint: str
    samples: float
    std: float
    removed: float


def _lowest(costs: Float[Array, " k"], lags: Float[Array, " k"]) -> float:
    """Place of the minimum of ``costs`` over equally spaced ``lags``, refined by a parabola."""
    k = int(np.argmin(costs))
    if k in (0, len(costs) - 1):
        return float("nan")
    left, middle, right = costs[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(lags[k] + (0.5 * (left - right) / bend if bend > 0 else 0.0) * (lags[1] - lags[0]))


def torque_lags(robot: Robot, recording: Recording, smooth: Smooth) -> tuple[Lag, ...]:
    """Lag of each joint's torque against the torque that a rigid body and friction need for the motion.

    The inertial parameters and the friction are free, so that a wrong model does not pass for a lag: the torque is
    shifted until the residual is smallest. The standard error is that of a jackknife over blocks of the record.
    """
    rows = smooth.rows(_ROWS)
    if smooth.tau is None or len(rows) < 100:
        return ()
    regressor = rigid_body_regressor(robot, smooth.motion(rows))
    most = max(2.0, min(_MOST_SAMPLES, np.floor(0.25 / (smooth.cutoff_hz * smooth.step))))
    lags = np.arange(-most, most + 0.25, 0.5)
    out = []
    # A held torque acts half a sample later than its time stamp says: that is no error, if the robot states it.
    stated = -0.5 if robot.torque_hold == "zoh" else 0.0
    for j, joint in enumerate(recording.joint_names):
        columns = np.column_stack([regressor[:, j], smooth.v[rows, j], smooth.sign[rows, j], np.ones(len(rows))])
        found = _one_lag(columns, smooth, rows, j, lags + stated)
        if found is not None:
            out.append(Lag(joint, found[0] - stated, *found[1:]))
    return tuple(out)


def _one_lag(
    columns: Float[Array, "N k"], smooth: Smooth, rows: Array, j: int, lags: Float[Array, " m"]
) -> tuple[float, float, float] | None:
    """Lag, its standard error and the share of squares that it removes; None where no lag fits clearly best."""
    assert smooth.tau is not None
    if np.ptp(smooth.tau[:, j]) == 0:
        return None
    spline = CubicSpline(smooth.t, smooth.tau[:, j])
    shifted = np.column_stack([spline(smooth.t[rows] + lag * smooth.step) for lag in lags])
    left, values, _ = np.linalg.svd(columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), full_matrices=False)
    basis = left[:, values > 1e-7 * values[0]]
    squares = (shifted - basis @ (basis.T @ shifted)) ** 2
    total = squares.sum(axis=0)
    best = int(np.argmin(total))
    lag = _lowest(total, lags)
    if np.isnan(lag) or total[best] > _LARGEST_RESIDUAL * np.sum((shifted[:, best] - shifted[:, best].mean()) ** 2):
        return None
    # Leaving out one block at a time gives the error of the estimate, that of a structured residual included.
    blocks = np.array_split(np.arange(len(rows)), _BLOCKS)
    without = np.array([_lowest(squares.sum(axis=0) - squares[block].sum(axis=0), lags) for block in blocks])
    if np.isnan(without).any():
        return None
    # The parabola through the lowest three costs says what is left at a lag between two of the grid.
    lowest = np.polyval(np.polyfit(lags[best - 1 : best + 2], total[best - 1 : best + 2], 2), lag)
    removed = 1 - max(float(lowest), 0.0) / float(total[len(lags) // 2])
    return lag, float(np.sqrt((_BLOCKS - 1) * np.mean((without - without.mean()) ** 2))), removed


def check_lag(recording: Recording, robot: Robot, smooth: Smooth) -> tuple[str, ...]:
    """Sentences about torques that are late or early by about half a sample or more."""
    out = []
    for lag in torque_lags(robot, recording, smooth):
        samples = lag.samples
        if abs(samples) < max(_SMALLEST, _SIGNIFICANT * lag.std) or lag.removed < _REMOVED:
            continue
        word = "late" if samples > 0 else "early"
        hint = "shift it, or expect it to show as a delay"
        if robot.torque_hold == "instant" and abs(samples + 0.5) < max(0.25, 3 * lag.std):
            hint = "torque_hold: zoh in robot.yaml explains half a sample"
        out.append(
            f"{recording.file}: the torque of {lag.joint} is {word} against its motion by "
            f"{1e3 * abs(samples) * smooth.step:.3g} ms ({abs(samples):.2g} samples): {hint}."
        )
    return tuple(out)
