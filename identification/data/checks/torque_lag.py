"""How late or early the recorded torque is against the motion, to a fraction of a sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.data.checks.smoothed_copy import Smooth
from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.model.robot import Robot

Array = np.ndarray

_ROWS = 400
_BLOCKS = 8
# Lags up to this many samples, and up to this share of a period at the cut-off, are tried in half samples.
_MOST_SAMPLES = 12
# From this many samples on a lag is worth a sentence, if it stands this many standard errors above zero.
_SMALLEST, _SIGNIFICANT = 0.4, 5.0
# What neither a rigid body nor friction explains must be a small share of the torque's variance, and the shift must
# have removed a good part of it: on a poor model every lag fits a little better than none.
_LARGEST_REST, _REMOVED = 0.05, 0.4


@dataclass(frozen=True)
class Lag:
    """Lag of one joint's torque beyond what the robot states.

    Attributes:
        joint: Its name.
        samples: Lag in samples, late is positive.
        std: Standard error of it.
        removed: Share of the unexplained squares that the shift removes.
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
    """Lag of each joint's torque against what any rigid body and friction need for the motion.

    The inertial parameters and the friction are free, so that a wrong model does not pass for a lag: the torque is
    shifted until the rest that they leave is smallest, and blocks of the record say how well that is known.
    """
    rows = smooth.rows(_ROWS)
    if smooth.tau is None or len(rows) < 100:
        return ()
    regressor = rigid_body_regressor(robot, smooth.motion(rows))
    most = max(2.0, min(_MOST_SAMPLES, np.floor(0.25 / (smooth.cutoff_hz * smooth.step))))
    lags = np.arange(-most, most + 0.25, 0.5)
    out = []
    # A held torque acts half a sample later than its time stamp says: that is no error, if the robot states it.
    known = -0.5 if robot.torque_hold == "zoh" else 0.0
    for j, joint in enumerate(recording.joint_names):
        columns = np.column_stack([regressor[:, j], smooth.v[rows, j], smooth.sign[rows, j], np.ones(len(rows))])
        found = _one_lag(columns, smooth, rows, j, lags + known)
        if found is not None:
            out.append(Lag(joint, found[0] - known, *found[1:]))
    return tuple(out)


def _one_lag(
    columns: Float[Array, "N k"], smooth: Smooth, rows: Array, j: int, lags: Float[Array, " m"]
) -> tuple[float, float, float] | None:
    from scipy.interpolate import CubicSpline

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
    if np.isnan(lag) or total[best] > _LARGEST_REST * np.sum((shifted[:, best] - shifted[:, best].mean()) ** 2):
        return None
    # Leaving out one block at a time gives the error of the estimate, structured rests included.
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
