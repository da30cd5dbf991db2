"""Estimates the delay of a torque relative to the motion, as a shift in time or as a first-order low pass.

The torque is shifted, or a low pass is inverted, until rigid bodies with free inertial parameters and free friction fit
best. A recording that is too short for so many parameters is fitted by the model torque times a free factor.

At reversals and stops, dry friction jumps somewhat earlier or later than the velocity changes sign, because the joint
sticks, or bends before it slides. Such a jump would look like a lag. So a sample is used only if its filter covers no
reversal and no stop. Between these, friction may be any function of the velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.interpolate import CubicSpline

from identification.data.checks.smoothed_copy import SmoothedRecording
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.splines import interpolated, quintic_derivatives

_ROWS = 400  # largest number of samples in the regression
_FEWEST = 100  # smallest number of samples with which a lag is estimated
_BLOCKS = 8  # blocks of the record, each left out once (jackknife) for the standard error
_LARGEST_LAG = 12  # largest lag that is tried [samples], unless a quarter of a period at the cut-off is shorter
SMALLEST = 0.4
"""Smallest lag that is reported [samples]."""
_SIGNIFICANT = 5.0  # smallest lag that is reported, in standard errors
# Largest unexplained share of the torque's variance after the shift, and smallest share of the squared residual that
# the shift has to remove. If the model is poor, some lag always fits a little better than none.
_LARGEST_RESIDUAL, _REMOVED = 0.05, 0.4
CLEARLY = 0.5
"""A low pass fits clearly better than a shift if the ratio of their squared residuals is below this number, and a shift
fits clearly better if the inverse ratio is. A slow motion does not distinguish the two."""
# Samples below the first share of a joint's top speed are not used, nor those within the second time [s] of such a
# sample or of a reversal.
_CREEPING, _CREEPING_TIME = 0.05, 0.05
# Half lengths of two filters, in periods of the cut-off. They are Hann windows: as these are finite, it is known on
# which samples a filtered sample depends. Their gain is one half at 3.3 and at 1.4 times the cut-off.
_FIRST, _SECOND = 0.15, 0.35
_TAPS = 5  # samples of the second filter to either side, no farther apart than half the length of the first filter
_KNOTS = 4  # number of points of the piecewise linear friction in each direction of motion
# Smallest number of independent samples (two per period of the cut-off) per column: with fewer samples, the columns fit
# the noise at any lag.
_PER_COLUMN = 2.0
_DEPENDENT = 1e-7  # columns of length one are linearly dependent if a singular value is at most this number


@dataclass(frozen=True)
class Lag:
    """Lag of one joint's torque, not counting the hold of the torque that robot.yaml states.

    Attributes:
        joint: Name of the joint.
        samples: Lag in samples; positive if the torque is late.
        std: Standard error of the lag in samples.
        removed: Share of the residual's sum of squares that the shift removes.
    """

    joint: str
    samples: float
    std: float
    removed: float


@dataclass(frozen=True)
class LowPass:
    """A first-order low pass of one joint's torque, through which the positions did not go.

    Attributes:
        joint: Name of the joint.
        seconds: Time constant [s].
        std: Standard error of the time constant [s].
        removed: Share of the residual's sum of squares that is removed if the low pass is inverted.
        beside_shift: Squared residual with the low pass inverted, divided by that of the best shift.
    """

    joint: str
    seconds: float
    std: float
    removed: float
    beside_shift: float

    @property
    def hertz(self) -> float:
        """Cut-off frequency [Hz]."""
        return 1 / (2 * np.pi * self.seconds)


@dataclass(frozen=True)
class _ClearSamples:
    """Filtered samples of one joint's torque that do not depend on a reversal or stop.

    Attributes:
        joint: Name of the joint.
        columns: Regressor columns of the joint's torque, each of length one.
        shifted: Torque after correction of each lag that is tried, ``(n, m)``.
        tau, slope: Recorded torque, and its time derivative [N m/s or N/s].
    """

    joint: str
    columns: Float[Array, "n k"]
    shifted: Float[Array, "n m"]
    tau: Float[Array, " n"]
    slope: Float[Array, " n"]


def lags_and_low_passes(
    robot: Robot, recording: Recording, smooth: SmoothedRecording
) -> tuple[tuple[Lag | None, LowPass | None], ...]:
    """Lag of each joint's torque relative to that of rigid bodies and friction, and the low pass that fits best.

    The inertial parameters and the friction are free, so that a wrong model is not taken for a lag. Standard errors are
    estimated by a jackknife over blocks of the record.

    Args:
        robot: States whether a drive holds its torque between two samples.
        recording: Raw samples; the torque includes that of measured forces.
        smooth: Gives the uniform times, the cut-off and the samples that are used.

    Returns:
        One pair for each joint that has enough samples. A lag or low pass that the samples do not determine is None.
    """
    most = max(2.0, min(_LARGEST_LAG, np.floor(0.25 / (smooth.cutoff_hz * smooth.step))))
    lags = np.arange(-most, most + 0.25, 0.5)  # in samples, with zero in the middle
    clear = _samples_without_reversals(robot, recording, smooth, lags)
    return tuple((_lag(samples, lags), _low_pass(samples)) for samples in clear)


def _samples_without_reversals(
    robot: Robot, recording: Recording, smooth: SmoothedRecording, lags: Float[Array, " m"]
) -> list[_ClearSamples]:
    """The samples away from reversals and stops, for each joint that has enough such samples.

    Args:
        robot: States whether a drive holds its torque between two samples.
        recording: Raw samples.
        smooth: Gives the uniform times, the cut-off and the samples that are used.
        lags: Lags that are tried, in samples.
    """
    if recording.tau is None:
        return []
    half, reach = (max(1, round(part / (smooth.cutoff_hz * smooth.step))) for part in (_FIRST, _SECOND))
    motion, tau = _lightly_smoothed(recording, recording.tau, smooth, half)
    offsets = np.unique(np.linspace(-reach, reach, 2 * min(_TAPS, reach) + 1).round().astype(int))
    weights = np.cos(0.5 * np.pi * offsets / (reach + 1)) ** 2
    weights /= weights.sum()
    # A held torque acts half a sample later than its time stamp; that is no lag if robot.yaml states the hold.
    stated = -0.5 if robot.torque_hold == "zoh" else 0.0
    out = []
    for j, joint in enumerate(recording.joint_names):
        at = np.flatnonzero(clear_samples(motion.v[:, j], smooth.inside, half + reach, smooth.step))
        if len(at) < _FEWEST or np.ptp(tau[:, j]) == 0:
            continue
        rows = at[np.linspace(0, len(at) - 1, min(_ROWS, len(at))).astype(int)]
        needed = rows[:, None] + offsets
        measured, t = CubicSpline(motion.t, tau[:, j]), motion.t[needed] + stated * smooth.step
        shifted = np.column_stack([measured(t + lag * smooth.step) @ weights for lag in lags])
        independent = 2 * smooth.cutoff_hz * smooth.step * len(at)
        # With too few samples for the columns of a free model, those of the given model are used.
        for columns_of in (_columns, _few_columns):
            columns = columns_of(robot, motion.at(needed.ravel()), j).reshape(*needed.shape, -1)
            columns = _normalised(np.einsum("nmk,m->nk", columns, weights))
            if independent >= _PER_COLUMN * np.linalg.matrix_rank(columns, tol=_DEPENDENT):
                out.append(_ClearSamples(joint, columns, shifted, measured(t) @ weights, measured(t, 1) @ weights))
                break
    return out


def _normalised(columns: Float[Array, "n k"]) -> Float[Array, "n c"]:
    """Columns divided by their lengths, without columns of zero.

    Each column is first divided by its largest value, because the square of a very small float is zero.
    """
    largest = np.max(np.abs(columns), axis=0, initial=0.0)
    scaled = columns[:, largest > 0] / largest[largest > 0]
    return scaled / np.linalg.norm(scaled, axis=0)


def _lightly_smoothed(
    recording: Recording, tau: Float[Array, "N nv"], smooth: SmoothedRecording, half: int
) -> tuple[Motion, Float[Array, "M nv"]]:
    """Motion and torque after a filter of ``half`` samples to either side, whose cut-off is far above the band.

    The regressor is not linear in the motion, so that a strongly smoothed motion does not give the smoothed regressor.
    Therefore the motion is smoothed lightly here, and regressor and torque are later smoothed alike, down to the band.
    """
    kernel = np.hanning(2 * half + 3)[1:-1]
    kernel /= kernel.sum()

    def filtered(columns: Float[Array, "N nv"]) -> Float[Array, "M nv"]:
        on_grid = interpolated(smooth.t, recording.t, columns)
        padded = np.pad(on_grid, ((half, half), (0, 0)), mode="reflect")
        return np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])

    q, t = filtered(recording.q), smooth.t - smooth.t[0]
    return Motion(t, q, *quintic_derivatives(q, 1.0 / smooth.step)), filtered(tau)


def _columns(robot: Robot, motion: Motion, j: int) -> Float[Array, "n k"]:
    """Columns of one joint's torque: rigid bodies, its rotor and its friction."""
    v, a = motion.v[:, j], motion.a[:, j]
    # The regressor does not contain rotors: their torque is proportional to the joint's own acceleration.
    return np.column_stack([rigid_body_regressor(robot, motion)[:, j], a, friction_columns(v)])


def _few_columns(robot: Robot, motion: Motion, j: int) -> Float[Array, "n k"]:
    """Columns of one joint's torque with fewer parameters: model torque, rotor, two friction columns, and an offset.

    They are for slow motions with many reversals, which have few samples between the reversals.
    """
    bodies = (rigid_body_regressor(robot, motion) @ standard_parameters(robot))[:, j]
    v, a = motion.v[:, j], motion.a[:, j]
    return np.column_stack([bodies, a, v, np.sign(v), np.ones(len(v))])


def clear_samples(v: Float[Array, " N"], inside: Bool[Array, " N"], half: int, step: float) -> Bool[Array, " N"]:
    """True for samples around which the filter covers no reversal, no stop and no unused sample of the joint.

    Args:
        v: Velocity of the joint [rad/s or m/s].
        inside: False for samples that are not used.
        half: Number of samples to either side that the filter covers.
        step: Time between two samples [s].
    """
    slow = np.abs(v) <= _CREEPING * np.percentile(np.abs(v), 99)
    slow[1:] |= np.sign(v[1:]) != np.sign(v[:-1])
    creeps = ndimage.maximum_filter1d(slow, 2 * int(np.ceil(_CREEPING_TIME / step)) + 1, axis=0)
    return np.logical_not(ndimage.maximum_filter1d(creeps | ~inside, 2 * half + 1, axis=0))


def friction_columns(v: Float[Array, " n"]) -> Float[Array, "n k"]:
    """Columns of a friction that is piecewise linear in the speed, with separate coefficients for each direction.

    Each column is 1 at one knot of the speed, 0 at the others, and linear in between. Its values are 0 in the other
    direction of motion.
    """
    columns = []
    # The speed is scaled to 1, because interpolation fails between knots that differ by the smallest floats.
    v = v / np.max(np.abs(v), initial=np.finfo(float).tiny)
    for direction in (1.0, -1.0):
        same_way = direction * v > 0
        speeds = np.abs(v[same_way])
        knots = np.unique(np.quantile(speeds, np.linspace(0, 1, _KNOTS))) if same_way.any() else np.zeros(0)
        hats = np.eye(len(knots))
        columns += [np.where(same_way, np.interp(np.abs(v), knots, hat), 0.0) for hat in hats]
    return np.stack(columns, axis=1) if columns else np.zeros((len(v), 0))


def _lag(clear: _ClearSamples, lags: Float[Array, " m"]) -> Lag | None:
    """The lag with the smallest squared residual; None if it is at the end of the range, or the residual is large."""
    total = _squared_residuals(clear.columns, clear.shifted)
    best = int(np.argmin(total))
    lag, fitted = _minimum_place(total, lags), clear.shifted[:, best]
    if np.isnan(lag) or total[best] > _LARGEST_RESIDUAL * np.sum((fitted - fitted.mean()) ** 2):
        return None
    without_block = np.array(
        [
            _minimum_place(_squared_residuals(clear.columns[kept], clear.shifted[kept]), lags)
            for kept in _all_but_one_block(clear)
        ]
    )
    if np.isnan(without_block).any():
        return None
    without_lag = float(total[len(lags) // 2])
    return Lag(clear.joint, lag, jackknife_error(without_block), 1 - _minimum(total, lags) / without_lag)


def _low_pass(clear: _ClearSamples) -> LowPass | None:
    r"""The time constant T with which the columns fit :math:`\tau + T \dot\tau` best.

    A first-order low pass turns :math:`\tau + T \dot\tau` into :math:`\tau`. None if T is not positive, or if the
    residual is large.
    """

    def time_constant(kept: Int[Array, " n"]) -> tuple[float, float, float]:
        """Time constant T, and the sums of squared residuals with T and with a time constant of zero."""
        tau, slope = _residuals(clear.columns[kept], np.column_stack([clear.tau, clear.slope])[kept]).T
        seconds = -float(tau @ slope) / max(float(slope @ slope), 1e-300)
        return seconds, float(np.sum((tau + seconds * slope) ** 2)), float(tau @ tau)

    seconds, after, before = time_constant(np.arange(len(clear.tau)))
    unfiltered = clear.tau + seconds * clear.slope
    if seconds <= 0 or after > _LARGEST_RESIDUAL * np.sum((unfiltered - unfiltered.mean()) ** 2):
        return None
    std = jackknife_error(np.array([time_constant(kept)[0] for kept in _all_but_one_block(clear)]))
    shift = max(float(_squared_residuals(clear.columns, clear.shifted).min()), 1e-300)
    return LowPass(clear.joint, seconds, std, 1 - after / before, after / shift)


def _all_but_one_block(clear: _ClearSamples) -> list[Int[Array, " n"]]:
    """For each block of samples, the indices of all other samples."""
    every = np.arange(len(clear.tau))
    return [np.setdiff1d(every, block) for block in np.array_split(every, _BLOCKS)]


def jackknife_error(without: Float[Array, " b"]) -> float:
    """Standard error of an estimate by the block jackknife; the residual need not be white.

    Args:
        without: One estimate for each block of samples, computed without this block.
    """
    return float(np.sqrt((len(without) - 1) * np.mean((without - without.mean()) ** 2)))


def _residuals(columns: Float[Array, "n k"], series: Float[Array, "n m"]) -> Float[Array, "n m"]:
    """Residual of each column of ``series`` after a least-squares fit of ``columns``."""
    basis, values, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, values > _DEPENDENT]
    return series - basis @ (basis.T @ series)


def _squared_residuals(columns: Float[Array, "n k"], shifted: Float[Array, "n m"]) -> Float[Array, " m"]:
    """Sum of squared residuals of each shifted torque."""
    return np.sum(_residuals(columns, shifted) ** 2, axis=0)


def _minimum(costs: Float[Array, " k"], lags: Float[Array, " k"]) -> float:
    """Smallest cost between the lags of a grid, by the parabola through the lowest point and its two neighbours."""
    k = int(np.argmin(costs))
    near = slice(k - 1, k + 2)
    return max(float(np.polyval(np.polyfit(lags[near], costs[near], 2), _minimum_place(costs, lags))), 0.0)


def _minimum_place(costs: Float[Array, " k"], lags: Float[Array, " k"]) -> float:
    """Lag with the smallest cost, refined by a parabola between equally spaced ``lags``; NaN at either end of them."""
    k = int(np.argmin(costs))
    if k in (0, len(costs) - 1):
        return float("nan")
    left, middle, right = costs[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(lags[k] + (0.5 * (left - right) / bend if bend > 0 else 0.0) * (lags[1] - lags[0]))


def is_reported(lag: Lag) -> bool:
    """True for a significant lag of about half a sample or more that explains much of the residual."""
    return _is_reported(lag.samples, lag.std, lag.removed)


def low_pass_is_reported(low_pass: LowPass, step: float) -> bool:
    """True for a significant time constant of about half a sample or more that explains much of the residual.

    Args:
        low_pass: The low pass.
        step: Time between two samples [s].
    """
    return _is_reported(low_pass.seconds / step, low_pass.std / step, low_pass.removed)


def _is_reported(samples: float, std: float, removed: float) -> bool:
    """True if a lag or time constant in samples is large and significant, and removes enough of the residual."""
    return abs(samples) >= max(SMALLEST, _SIGNIFICANT * std) and removed >= _REMOVED
