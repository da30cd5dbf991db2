"""The lag of the torque against the motion, to a fraction of a sample, read where friction cannot feign one.

The torque is shifted until a rigid body with free inertial parameters and free friction leaves the smallest residual.
Where a joint turns about or stands, dry friction jumps, and it jumps earlier or later than the velocity changes sign:
the joint sticks, or bends before it slides. Such a jump would be taken for a torque that is late or early. So only
samples count whose filter touches no reversal and no stop, and friction may be any function of the velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.interpolate import CubicSpline, make_interp_spline
from scipy.ndimage import maximum_filter1d

from identification.data.checks.smoothed_copy import Smooth
from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

Array = np.ndarray

_ROWS = 400  # samples in the regression of a lag
_FEWEST = 100  # without which nothing is said
_BLOCKS = 8  # of the record, left out one at a time (jackknife) for the standard error of a lag
# Lags up to this many samples, and up to a quarter of a period at the cut-off, are tried in half samples.
_MOST_SAMPLES = 12
# From this many samples on a lag is worth a sentence, if it stands this many standard errors above zero.
_SMALLEST, _SIGNIFICANT = 0.4, 5.0
# The residual of rigid body and friction must be a small share of the torque's variance, and the shift must have
# removed a good part of it: with a poor model every lag fits a little better than none.
_LARGEST_RESIDUAL, _REMOVED = 0.05, 0.4
# Below this share of its top speed a joint creeps, and so it does this long [s] before and behind a reversal.
_CREEPING, _CREEPING_TIME = 0.05, 0.05
# Half lengths of two filters, in periods of the cut-off. Hann's windows end, so that it is known what a sample has
# touched; half of the amplitude is left at 3.3 and at 1.4 times the cut-off.
_FIRST, _SECOND = 0.15, 0.35
_TAPS = 5  # of the second filter to either side: its samples lie as close as half the length of the first
# Friction of either direction is a broken line in the speed through this many points.
_KNOTS = 4
# Independent samples (two per period of the cut-off) for each column: with fewer, columns that are noise fit any lag.
_PER_COLUMN = 2.0


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


@dataclass(frozen=True)
class _Fitted:
    """The fit of a lag: as in `Lag`, and how many columns it has taken."""

    samples: float
    std: float
    removed: float
    columns: int


def torque_lags(robot: Robot, recording: Recording, smooth: Smooth) -> tuple[Lag, ...]:
    """Lag of each joint's torque against the torque that a rigid body and friction need for the motion.

    The inertial parameters and the friction are free, so that a wrong model does not pass for a lag. The standard error
    is that of a jackknife over blocks of the record. Joints whose lag these samples do not show are left out.

    Args:
        robot: Says how the torque was held.
        recording: Raw samples; its torque holds that of measured forces.
        smooth: Gives the uniform times, the cut-off and which samples count.
    """
    if recording.tau is None:
        return ()
    half, reach = (max(1, round(part / (smooth.cutoff_hz * smooth.step))) for part in (_FIRST, _SECOND))
    motion, tau = _lightly_smoothed(recording, recording.tau, smooth, half)
    offsets = np.unique(np.linspace(-reach, reach, 2 * min(_TAPS, reach) + 1).round().astype(int))
    weights = np.cos(0.5 * np.pi * offsets / (reach + 1)) ** 2
    weights /= weights.sum()
    most = max(2.0, min(_MOST_SAMPLES, np.floor(0.25 / (smooth.cutoff_hz * smooth.step))))
    lags = np.arange(-most, most + 0.25, 0.5)
    # A held torque acts half a sample later than its time stamp says: that is no error, if the robot states it.
    stated = -0.5 if robot.torque_hold == "zoh" else 0.0
    out = []
    for j, joint in enumerate(recording.joint_names):
        at = np.flatnonzero(clear_samples(motion.v[:, j], smooth.inside, half + reach, smooth.step))
        if len(at) < _FEWEST or np.ptp(tau[:, j]) == 0:
            continue
        rows = at[np.linspace(0, len(at) - 1, min(_ROWS, len(at))).astype(int)]
        needed = rows[:, None] + offsets
        columns = _columns(robot, motion, needed.ravel(), j).reshape(*needed.shape, -1)
        measured = CubicSpline(motion.t, tau[:, j])
        shifted = [measured(motion.t[needed] + lag * smooth.step) @ weights for lag in lags + stated]
        found = _fitted(np.einsum("nmk,m->nk", columns, weights), np.column_stack(shifted), lags)
        independent = 2 * smooth.cutoff_hz * smooth.step * len(at)
        if found is not None and independent >= _PER_COLUMN * found.columns:
            out.append(Lag(joint, found.samples, found.std, found.removed))
    return tuple(out)


def _lightly_smoothed(
    recording: Recording, tau: Float[Array, "N nv"], smooth: Smooth, half: int
) -> tuple[Motion, Float[Array, "M nv"]]:
    """Motion and torque by a filter of ``half`` samples to either side, far wider than the band.

    What the regressor makes of a motion that was smoothed to the edge of the band is not its smoothed torque; so the
    regressor is smoothed the second time, together with the torque.
    """
    kernel = np.hanning(2 * half + 3)[1:-1]
    kernel /= kernel.sum()

    def filtered(columns: Float[Array, "N nv"]) -> Float[Array, "M nv"]:
        on_grid = np.column_stack([np.interp(smooth.t, recording.t, column) for column in columns.T])
        padded = np.pad(on_grid, ((half, half), (0, 0)), mode="reflect")
        return np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])

    q, t = filtered(recording.q), smooth.t - smooth.t[0]
    spline = make_interp_spline(t, q, k=5)
    return Motion(t, q, spline(t, 1), spline(t, 2)), filtered(tau)


def _columns(robot: Robot, motion: Motion, rows: Int[Array, " n"], j: int) -> Float[Array, "n k"]:
    """Columns of one joint's torque: rigid bodies, its rotor and its friction."""
    part = Motion(motion.t[rows], motion.q[rows], motion.v[rows], motion.a[rows])
    # Rotors are no part of the regressor: their inertia is that of the joint's own acceleration.
    return np.column_stack([rigid_body_regressor(robot, part)[:, j], part.a[:, j], friction_columns(part.v[:, j])])


def clear_samples(v: Float[Array, " N"], inside: Bool[Array, " N"], half: int, step: float) -> Bool[Array, " N"]:
    """True for samples of a joint whose filter touches no reversal, no stop and nothing that does not count.

    Args:
        v: Velocity of the joint.
        inside: False for samples that do not count.
        half: Samples to either side that the filter reaches.
        step: Between two samples [s].
    """
    slow = np.abs(v) <= _CREEPING * np.percentile(np.abs(v), 99)
    slow[1:] |= np.sign(v[1:]) != np.sign(v[:-1])
    creeps = maximum_filter1d(slow.astype(np.uint8), 2 * int(np.ceil(_CREEPING_TIME / step)) + 1) > 0
    return maximum_filter1d((creeps | ~inside).astype(np.uint8), 2 * half + 1) == 0


def friction_columns(v: Float[Array, " n"]) -> Float[Array, "n k"]:
    """Columns of a friction that is any broken line in the speed, another one in either direction."""
    columns = []
    for direction in (1.0, -1.0):
        going = direction * v > 0
        knots = np.unique(np.quantile(np.abs(v[going]), np.linspace(0, 1, _KNOTS))) if going.any() else np.zeros(0)
        hats = np.eye(len(knots))
        columns += [np.where(going, np.interp(np.abs(v), knots, hat), 0.0) for hat in hats]
    return np.stack(columns, axis=1) if columns else np.zeros((len(v), 0))


def _fitted(columns: Float[Array, "n k"], shifted: Float[Array, "n m"], lags: Float[Array, " m"]) -> _Fitted | None:
    """The lag [samples] at which columns explain the torque best; None where no lag does so clearly.

    Args:
        columns: Of the torque.
        shifted: The measured torque at each lag.
        lags: Equally spaced, none in the middle [samples].
    """
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    total, rank = _costs(columns, shifted)
    best = int(np.argmin(total))
    lag = _lowest(total, lags)
    if np.isnan(lag) or total[best] > _LARGEST_RESIDUAL * np.sum((shifted[:, best] - shifted[:, best].mean()) ** 2):
        return None
    # Leaving out one block at a time gives the error of the estimate, that of a structured residual included.
    without = np.empty(_BLOCKS)
    for k, block in enumerate(np.array_split(np.arange(len(columns)), _BLOCKS)):
        kept = np.setdiff1d(np.arange(len(columns)), block)
        without[k] = _lowest(_costs(columns[kept], shifted[kept])[0], lags)
    if np.isnan(without).any():
        return None
    # The parabola through the lowest three costs says what is left at a lag between two of the grid.
    lowest = np.polyval(np.polyfit(lags[best - 1 : best + 2], total[best - 1 : best + 2], 2), lag)
    removed = 1 - max(float(lowest), 0.0) / float(total[len(lags) // 2])
    return _Fitted(lag, float(np.sqrt((_BLOCKS - 1) * np.mean((without - without.mean()) ** 2))), removed, rank)


def _costs(columns: Float[Array, "n k"], shifted: Float[Array, "n m"]) -> tuple[Float[Array, " m"], int]:
    """Sum of squares that columns leave of each shifted torque, and how many of them are independent."""
    left, values, _ = np.linalg.svd(columns, full_matrices=False)
    basis = left[:, values > 1e-7 * values[0]]
    return np.sum((shifted - basis @ (basis.T @ shifted)) ** 2, axis=0), basis.shape[1]


def _lowest(costs: Float[Array, " k"], lags: Float[Array, " k"]) -> float:
    """Place of the minimum of ``costs`` over equally spaced ``lags``, refined by a parabola; NaN at either end."""
    k = int(np.argmin(costs))
    if k in (0, len(costs) - 1):
        return float("nan")
    left, middle, right = costs[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(lags[k] + (0.5 * (left - right) / bend if bend > 0 else 0.0) * (lags[1] - lags[0]))


def check_lag(recording: Recording, robot: Robot, smooth: Smooth) -> tuple[str, ...]:
    """Sentences about torques that are late or early by about half a sample or more.

    Args:
        recording: Raw samples; its torque holds that of measured forces.
        robot: Says how the torque was held.
        smooth: The smoothed copy.
    """
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
