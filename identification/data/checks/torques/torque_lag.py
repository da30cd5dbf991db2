"""The lag of the torque against the motion, a shift or a low pass of first order, read where friction cannot feign one.

The torque is shifted, or the low pass taken back, until a rigid body with free inertial parameters and free friction
leaves the smallest residual; in a recording that is too short for these, the given model with any scale.
Where a joint turns about or stands, dry friction jumps, and it jumps earlier or later than the velocity changes sign:
the joint sticks, or bends before it slides. Such a jump would be taken for a torque that is late or early. So only
samples count whose filter touches no reversal and no stop, and friction may be any function of the velocity.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.interpolate import CubicSpline

from identification.data.checks.smoothed_copy import Smooth
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.splines import interpolated, quintic_derivatives

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
# A low pass is what is between where it leaves half of the squares that the best shift leaves, and a shift where it is
# the other way round; a slow motion tells neither.
_CLEARLY = 0.5
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
_SAME = 1e-7  # singular value of columns of length one, from which on they are the same


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
class LowPass:
    """A low pass of first order that the torque of one joint went through and the positions did not.

    Attributes:
        joint: Its name.
        seconds: Time constant [s].
        std: Its standard error.
        removed: Share of the residual's sum of squares that goes when it is taken back.
        beside_shift: What it leaves over what the best shift leaves, both sums of squares.
    """

    joint: str
    seconds: float
    std: float
    removed: float
    beside_shift: float

    @property
    def hertz(self) -> float:
        """Its cut-off [Hz]."""
        return 1 / (2 * np.pi * self.seconds)


@dataclass(frozen=True)
class _Clear:
    """Samples of one joint's torque that touch no reversal and no stop.

    Attributes:
        joint: Its name.
        columns: Columns of its torque.
        shifted: Torque at each lag, ``(n, lags)``.
        tau, slope: Torque without a lag and its derivative [per s].
    """

    joint: str
    columns: Float[Array, "n k"]
    shifted: Float[Array, "n m"]
    tau: Float[Array, " n"]
    slope: Float[Array, " n"]


def lags_and_low_passes(
    robot: Robot, recording: Recording, smooth: Smooth
) -> tuple[tuple[Lag | None, LowPass | None], ...]:
    """Lag of each joint's torque against what a rigid body and friction need, and the low pass that fits it best.

    The inertial parameters and the friction are free, so that a wrong model does not pass for a lag. Standard errors
    are those of a jackknife over blocks of the record. None is what these samples do not show.

    Args:
        robot: Says how the torque was held.
        recording: Raw samples; its torque holds that of measured forces.
        smooth: Gives the uniform times, the cut-off and which samples count.
    """
    lags = _lags(smooth)
    return tuple((_lag(one, lags), _low_pass(one)) for one in _clear_torques(robot, recording, smooth, lags))


def _lags(smooth: Smooth) -> Float[Array, " m"]:
    """Lags that are tried [samples], none in the middle."""
    most = max(2.0, min(_MOST_SAMPLES, np.floor(0.25 / (smooth.cutoff_hz * smooth.step))))
    return np.arange(-most, most + 0.25, 0.5)


def _clear_torques(robot: Robot, recording: Recording, smooth: Smooth, lags: Float[Array, " m"]) -> list[_Clear]:
    """The clear samples of each joint that has enough of them."""
    if recording.tau is None:
        return []
    half, reach = (max(1, round(part / (smooth.cutoff_hz * smooth.step))) for part in (_FIRST, _SECOND))
    motion, tau = _lightly_smoothed(recording, recording.tau, smooth, half)
    offsets = np.unique(np.linspace(-reach, reach, 2 * min(_TAPS, reach) + 1).round().astype(int))
    weights = np.cos(0.5 * np.pi * offsets / (reach + 1)) ** 2
    weights /= weights.sum()
    # A held torque acts half a sample later than its time stamp says: that is no error, if the robot states it.
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
        for columns_of in (_columns, _few_columns):
            columns = columns_of(robot, motion, needed.ravel(), j).reshape(*needed.shape, -1)
            columns = _of_length_one(np.einsum("nmk,m->nk", columns, weights))
            if independent >= _PER_COLUMN * np.linalg.matrix_rank(columns, tol=_SAME):
                out.append(_Clear(joint, columns, shifted, measured(t) @ weights, measured(t, 1) @ weights))
                break
    return out


def _of_length_one(columns: Float[Array, "n k"]) -> Float[Array, "n c"]:
    """Columns that are not zero, each over its length; squares of the smallest floats would be zero."""
    largest = np.max(np.abs(columns), axis=0, initial=0.0)
    scaled = columns[:, largest > 0] / largest[largest > 0]
    return scaled / np.linalg.norm(scaled, axis=0)


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
        on_grid = interpolated(smooth.t, recording.t, columns)
        padded = np.pad(on_grid, ((half, half), (0, 0)), mode="reflect")
        return np.column_stack([np.convolve(column, kernel, mode="valid") for column in padded.T])

    q, t = filtered(recording.q), smooth.t - smooth.t[0]
    return Motion(t, q, *quintic_derivatives(q, 1.0 / smooth.step)), filtered(tau)


def _columns(robot: Robot, motion: Motion, rows: Int[Array, " n"], j: int) -> Float[Array, "n k"]:
    """Columns of one joint's torque: rigid bodies, its rotor and its friction."""
    part = Motion(motion.t[rows], motion.q[rows], motion.v[rows], motion.a[rows])
    # Rotors are no part of the regressor: their inertia is that of the joint's own acceleration.
    return np.column_stack([rigid_body_regressor(robot, part)[:, j], part.a[:, j], friction_columns(part.v[:, j])])


def _few_columns(robot: Robot, motion: Motion, rows: Int[Array, " n"], j: int) -> Float[Array, "n k"]:
    """The same of the given model: its torque, of any scale, beside a rotor, friction and an offset.

    A slow motion that often turns about has few samples between its reversals.
    """
    part = Motion(motion.t[rows], motion.q[rows], motion.v[rows], motion.a[rows])
    bodies = (rigid_body_regressor(robot, part) @ standard_parameters(robot))[:, j]
    v = part.v[:, j]
    return np.column_stack([bodies, part.a[:, j], v, np.sign(v), np.ones(len(v))])


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
    creeps = ndimage.maximum_filter1d(slow, 2 * int(np.ceil(_CREEPING_TIME / step)) + 1, axis=0)
    return np.logical_not(ndimage.maximum_filter1d(creeps | ~inside, 2 * half + 1, axis=0))


def friction_columns(v: Float[Array, " n"]) -> Float[Array, "n k"]:
    """Columns of a friction that is any broken line in the speed, another one in either direction."""
    columns = []
    # The columns are the same in any unit of speed; over steps of the smallest floats nothing can be interpolated.
    v = v / np.max(np.abs(v), initial=np.finfo(float).tiny)
    for direction in (1.0, -1.0):
        going = direction * v > 0
        knots = np.unique(np.quantile(np.abs(v[going]), np.linspace(0, 1, _KNOTS))) if going.any() else np.zeros(0)
        hats = np.eye(len(knots))
        columns += [np.where(going, np.interp(np.abs(v), knots, hat), 0.0) for hat in hats]
    return np.stack(columns, axis=1) if columns else np.zeros((len(v), 0))


def _lag(clear: _Clear, lags: Float[Array, " m"]) -> Lag | None:
    """The lag at which columns explain the torque best; None where no lag does so clearly."""
    total = _costs(clear.columns, clear.shifted)
    best = int(np.argmin(total))
    lag, fitted = _lowest(total, lags), clear.shifted[:, best]
    if np.isnan(lag) or total[best] > _LARGEST_RESIDUAL * np.sum((fitted - fitted.mean()) ** 2):
        return None
    without = np.array([_lowest(_costs(clear.columns[kept], clear.shifted[kept]), lags) for kept in _without(clear)])
    if np.isnan(without).any():
        return None
    return Lag(clear.joint, lag, jackknife_error(without), 1 - _least(total, lags) / float(total[len(lags) // 2]))


def _low_pass(clear: _Clear) -> LowPass | None:
    r"""The time constant T at which columns explain :math:`\tau + T \dot\tau` best; None where it is not positive.

    A low pass of first order gives :math:`\tau` for what it is fed, so that this is what it was fed.
    """

    def constant(kept: Int[Array, " n"]) -> tuple[float, float, float]:
        """Time constant, and the sums of squares that are left with and without it."""
        tau, slope = _left(clear.columns[kept], np.column_stack([clear.tau, clear.slope])[kept]).T
        seconds = -float(tau @ slope) / max(float(slope @ slope), 1e-300)
        return seconds, float(np.sum((tau + seconds * slope) ** 2)), float(tau @ tau)

    seconds, left, before = constant(np.arange(len(clear.tau)))
    fed = clear.tau + seconds * clear.slope
    if seconds <= 0 or left > _LARGEST_RESIDUAL * np.sum((fed - fed.mean()) ** 2):
        return None
    std = jackknife_error(np.array([constant(kept)[0] for kept in _without(clear)]))
    shift = max(float(_costs(clear.columns, clear.shifted).min()), 1e-300)
    return LowPass(clear.joint, seconds, std, 1 - left / before, left / shift)


def _without(clear: _Clear) -> list[Int[Array, " n"]]:
    """The samples without one block of them, for each block."""
    every = np.arange(len(clear.tau))
    return [np.setdiff1d(every, block) for block in np.array_split(every, _BLOCKS)]


def jackknife_error(without: Float[Array, " b"]) -> float:
    """Standard error of an estimate from those without one block each; that of a structured residual is in it."""
    return float(np.sqrt((len(without) - 1) * np.mean((without - without.mean()) ** 2)))


def _left(columns: Float[Array, "n k"], series: Float[Array, "n m"]) -> Float[Array, "n m"]:
    """Residuals of several series after a least squares fit of the columns."""
    basis, values, _ = np.linalg.svd(columns, full_matrices=False)
    basis = basis[:, values > _SAME]
    return series - basis @ (basis.T @ series)


def _costs(columns: Float[Array, "n k"], shifted: Float[Array, "n m"]) -> Float[Array, " m"]:
    """Sum of squares that columns leave of each shifted torque."""
    return np.sum(_left(columns, shifted) ** 2, axis=0)


def _least(costs: Float[Array, " k"], lags: Float[Array, " k"]) -> float:
    """Smallest cost between the lags of a grid, by the parabola through the lowest three."""
    k = int(np.argmin(costs))
    near = slice(k - 1, k + 2)
    return max(float(np.polyval(np.polyfit(lags[near], costs[near], 2), _lowest(costs, lags))), 0.0)


def _lowest(costs: Float[Array, " k"], lags: Float[Array, " k"]) -> float:
    """Place of the minimum of ``costs`` over equally spaced ``lags``, refined by a parabola; NaN at either end."""
    k = int(np.argmin(costs))
    if k in (0, len(costs) - 1):
        return float("nan")
    left, middle, right = costs[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(lags[k] + (0.5 * (left - right) / bend if bend > 0 else 0.0) * (lags[1] - lags[0]))


class LagSentence(str):
    """A sentence on a torque that is late or early.

    Attributes:
        joint: Its name.
        early: True if the torque comes before its motion, as what a drive is asked for does where the drive is slow.
    """

    joint: str
    early: bool

    def __new__(cls, sentence: str, joint: str, *, early: bool) -> LagSentence:
        """The sentence, and what it is about."""
        out = super().__new__(cls, sentence)
        out.joint, out.early = joint, early
        return out


def check_lag(
    recording: Recording,
    robot: Robot,
    smooth: Smooth,
    found: tuple[tuple[Lag | None, LowPass | None], ...],
    *,
    steep: tuple[str, ...] = (),
) -> tuple[str, ...]:
    """Sentences about torques that are late or early by about half a sample or more.

    Args:
        recording: Raw samples.
        robot: Says how the torque was held.
        smooth: The smoothed copy.
        found: Result of `lags_and_low_passes`.
        steep: Joints whose torque went through a low pass of higher order: one of first order would not take it back.
    """
    out = []
    for each, filtered in found:
        lag = each if each is not None and worth_a_sentence(each) else None
        if filtered is not None and (
            filtered.joint in steep
            or not _worth_a_sentence(filtered.seconds / smooth.step, filtered.std / smooth.step, filtered.removed)
        ):
            filtered = None
        if filtered is not None and (filtered.beside_shift < _CLEARLY or lag is None):
            out.append(
                f"{recording.file}: the torque of {filtered.joint} went through a low pass of first order at "
                f"{filtered.hertz:.3g} Hz that the positions did not go through: {_entry(filtered)}."
            )
        elif lag is not None:
            out.append(_lag_sentence(recording.file, robot, smooth, lag, filtered))
    return tuple(out)


def worth_a_sentence(lag: Lag) -> bool:
    """True for a lag of half a sample or more, far beyond its error, without which much less is left."""
    return _worth_a_sentence(lag.samples, lag.std, lag.removed)


def _worth_a_sentence(samples: float, std: float, removed: float) -> bool:
    return abs(samples) >= max(_SMALLEST, _SIGNIFICANT * std) and removed >= _REMOVED


def _entry(filtered: LowPass) -> str:
    """What takes a low pass back."""
    return (
        f"write tau.{filtered.joint}: {{low_pass: {filtered.hertz:.3g}}} into a column map and give it with --columns"
    )


def _lag_sentence(file: str, robot: Robot, smooth: Smooth, lag: Lag, filtered: LowPass | None) -> str:
    """The sentence on a torque that is late or early; a low pass may be the reason why it is late."""
    hint = "shift it, or expect it to show as a delay"
    if filtered is not None and filtered.beside_shift < 1 / _CLEARLY:
        hint = f"shift it, or, if it went through a low pass of first order, {_entry(filtered)}"
    if robot.torque_hold == "instant" and abs(lag.samples + 0.5) < max(0.25, 3 * lag.std):
        hint = "torque_hold: zoh in robot.yaml explains half a sample"
    word = "late" if lag.samples > 0 else "early"
    sentence = (
        f"{file}: the torque of {lag.joint} is {word} against its motion by "
        f"{1e3 * abs(lag.samples) * smooth.step:.3g} ms ({abs(lag.samples):.2g} samples): {hint}."
    )
    return LagSentence(sentence, lag.joint, early=lag.samples < 0)
