"""Bursts: short times in which the residual is far larger than its expected standard deviation.

A burst is an event that the state of the robot does not predict: a push, a contact, a cable that catches. The expected
variance is the sum of the noise, the error of the model, which grows with the modelled torque, and the uncertain
friction of joints that stand still, creep or reverse.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.motion.standstill import counted_step, near_reversals
from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.gap import comparison_torque, measured_in_fit_band
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.floors import reading_noise, torque_above_band
from identification.diagnosis.result import Burst, JointGap
from identification.engine import contract_levels
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.model.robot import Robot

# Bursts of different joints count as one unless they are this far apart in time [s].
_APART = 0.1
# Time [s] to exclude before and after a burst, because filters spread it.
_MARGIN = 0.2
# A mean over a window needs at least this share of the window to be usable.
_FILLED = 0.6
# Bursts of a joint are searched for if it has at least this many usable samples.
_LEAST_SAMPLES = 50
# Degrees of freedom of Student's t distribution, with which variances are fitted so that events have little weight.
_DEGREES_OF_FREEDOM = 4.0
_STEPS = 60  # steps of the fit of variances
# A variance is estimated from the samples of other folds, and noise from calm samples. If there are fewer than this,
# all usable samples are taken.
_FEWEST_SAMPLES = 20


class _Event(NamedTuple):
    """A burst in one recording: joint, first and last time [s], torque, and ratio to the expected deviation."""

    joint: str
    start: float
    stop: float
    torque: float
    ratio: float


def bursts_of(problem: Problem, residual: Series, friction_variance: Series) -> tuple[Burst, ...]:
    """Bursts in all recordings, in the order of time.

    Args:
        problem: Columns and blocks.
        residual: Residual of each log with the chosen effects in the model, in the judged band.
        friction_variance: Variance of the friction of each log's joints that stand still, creep or reverse.
    """
    session, columns, out = problem.session, problem.columns, []
    above_band = np.sqrt(torque_above_band(problem, reading_noise(session)))
    modelled, measured = comparison_torque(problem, columns.model_torque), measured_in_fit_band(problem)
    for k, log in enumerate(session.logs):
        expected = _expected_errors(problem, k, residual[k], friction_variance[k], modelled[k])
        # Near invalid samples and the ends of a recording, filters have no measured samples on one side.
        reach = int(log.band.output_rate_hz / session.cutoff_hz) + 1
        outside = np.pad(~log.valid_in_band, reach, constant_values=True)
        inside = np.logical_not(ndimage.maximum_filter1d(outside, 2 * reach + 1, axis=0))[reach:-reach]
        usable = columns.usable[k] & inside[:, None]
        # Drive and push together give the modelled torque, so the push is minus the residual.
        events = bursts_in(log.motion.t[log.samples], -residual[k], expected, usable, log.joint_names)
        # Smaller events may be errors of derivatives and filters, or the response of a controller to its encoder, which
        # is measured above the band and may be aliased to a single frequency in the band.
        sizes = np.sqrt(np.mean(measured[k] ** 2, axis=0))
        least = np.maximum(rules.MODEL_SHARE * sizes, rules.SENSOR_TIMES * above_band)
        for joint, start, stop, torque, ratio in events:
            row = log.joint_names.index(joint)
            if abs(torque) > max(least[row], rounding_torque(session.robot, log, row, start, stop)):
                out.append(Burst(log.file, joint, start, stop, torque, ratio))
    return tuple(out)


def _expected_errors(
    problem: Problem,
    k: int,
    residual: Float[Array, "n nv"],
    friction_variance: Float[Array, "n nv"],
    modelled: Float[Array, "n nv"],
) -> Float[Array, "n nv"]:
    """Expected standard deviation of each sample of one log's residual; infinite on joints without usable samples.

    Args:
        problem: Columns and blocks.
        k: Index of the log.
        residual: Residual of the log.
        friction_variance: Variance of the friction of joints that stand still, creep or reverse.
        modelled: Modelled torque.
    """
    session, usable = problem.session, problem.columns.usable[k]
    fold = np.zeros(len(residual), dtype=int)
    for block, number in zip(session.blocks, session.folds, strict=True):
        if block.log == k:
            fold[block.start : block.stop] = number
    rate, reversals = session.logs[k].band.output_rate_hz, near_reversals(session.logs[k])
    out = np.full(residual.shape, np.inf)
    for j in np.flatnonzero(usable.any(axis=0)):
        torque = moving_torque(modelled[:, j], rate, session.cutoff_hz)
        causes = Causes(friction_variance[:, j], torque, reversals[:, j])
        out[:, j] = expected_error(residual[:, j], causes, usable[:, j], fold)
    return out


def rounding_torque(robot: Robot, log: Log, row: int, start: float, stop: float) -> float:
    """The largest mean torque on a joint between two times that the rounding of encoders can cause [N m or N].

    A reading is wrong by at most half a step, ``e``. At a steady speed this error is periodic, so that it may be in
    phase with a window. The mean of its second derivative, weighted by a Hann window of length ``T``, is at most
    ``8 pi e / T^2``, as ``8 pi / T^2`` is the integral of the absolute second derivative of the normalised window.
    Errors of several joints are independent, so that their squares are added.

    Args:
        robot: Gives the inertias.
        log: Readings of the encoders, with their steps.
        row: Index of the joint.
        start: First time [s].
        stop: Last time [s]; at least the length of the shortest window counts.
    """
    seconds = max(stop - start, rules.BURST_LENGTHS[0])
    errors = 0.5 * np.array([counted_step(robot, log, j) for j in range(robot.nv)])
    at = int(np.searchsorted(log.motion.t, start))
    inertia = mass_matrix(robot, log.motion.q[at : at + 1])[0, row]
    return float(8.0 * np.pi / seconds**2 * np.linalg.norm(inertia * errors))


def distinct_bursts(
    bursts: tuple[Burst, ...], problem: Problem, residual: Series, floor: Float[Array, " nv"]
) -> tuple[Burst, ...]:
    """The bursts that are not just peaks of a gap, which leaves a residual above the noise at other times as well.

    A burst on a joint with a gap has to exceed the root mean square residual at other times by `BURST_RATIO`; that
    residual may be above the noise, because a push also spoils the fit of other samples. A burst on any joint has to
    exceed the residual of each joint with a gap, because the unmodelled torque of one joint may act on others with at
    most its own size.

    Args:
        bursts: Bursts in all recordings.
        problem: Recordings and usable samples.
        residual: Residual of each log with the chosen effects in the model, in the judged band.
        floor: Largest residual of each joint that may be noise, root mean square, ``(nv,)``.
    """
    if not bursts:
        return ()
    squares, counts = np.zeros(len(floor)), np.zeros(len(floor))
    for log, own, usable in zip(problem.session.logs, residual, problem.columns.usable, strict=True):
        t, use = log.motion.t[log.samples], usable.copy()
        for burst in bursts:
            if burst.file == log.file:
                use[(t > burst.start - _MARGIN) & (t < burst.stop + _MARGIN)] = False
        squares += np.sum(np.where(use, own, 0.0) ** 2, axis=0)
        counts += use.sum(axis=0)
    elsewhere = np.sqrt(squares / np.maximum(counts, 1))
    has_gap = elsewhere > contract_levels.FLOORS_LEFT * floor
    least = max(elsewhere[has_gap], default=0.0)
    on_own_joint = np.where(has_gap, rules.BURST_RATIO * elsewhere, 0.0)
    needed = dict(zip(problem.session.robot.joint_names, on_own_joint, strict=True))
    return tuple(one for one in bursts if abs(one.torque) > max(needed[one.joint], least))


def bursts_in(
    t: Float[Array, " n"],
    unexplained: Float[Array, "n nv"],
    expected: Float[Array, "n nv"],
    usable: Bool[Array, "n nv"],
    joints: tuple[str, ...],
) -> tuple[_Event, ...]:
    """Bursts in one recording, in the order of time.

    Args:
        t: Times [s], evenly spaced.
        unexplained: Unexplained torque of each joint [N m or N], positive along the joint.
        expected: Expected standard deviation of that torque at each sample.
        usable: False where a joint rests or a sample is excluded.
        joints: Names of the joints.
    """
    found: list[_Event] = []
    for j, joint in enumerate(joints):
        use = usable[:, j]
        if np.count_nonzero(use) < _LEAST_SAMPLES:
            continue
        centred = np.where(use, unexplained[:, j] - np.median(unexplained[use, j]), 0.0)
        relative, events = np.where(use, centred / expected[:, j], 0.0), list[_Event]()
        for first, last, ratio in _events_in(relative, use, float(np.median(np.diff(t))), len(joints)):
            peak = first + int(np.argmax(np.abs(centred[first : last + 1])))
            events.append(_Event(joint, float(t[first]), float(t[last]), float(centred[peak]), ratio))
        largest = max((abs(event.torque) for event in events), default=0.0)
        found += [event for event in events if abs(event.torque) >= rules.BURST_SHARE * largest]
    # A push on the last link acts on all joints. It is kept once, on the joint with the largest ratio.
    out: list[_Event] = []
    for event in sorted(found, key=lambda one: -one.ratio):
        if all(event.stop < kept.start - _APART or event.start > kept.stop + _APART for kept in out):
            out.append(event)
    return tuple(sorted(out, key=lambda one: one.start))


def _events_in(relative: Array, use: Array, step: float, joints: int) -> list[tuple[int, int, float]]:
    """First and last sample of each event on one joint, and its largest mean over a window.

    Events are found one after the other, the largest first. Each is removed with its flanks before the next search. An
    event counts only if it exceeds the largest level at all other times by `BURST_TIMES`. Otherwise the noise itself
    varies, as does the response of a controller to the steps of its encoder in a log with a low rate.

    Args:
        relative: Unexplained torque, divided by its expected standard deviation, ``(n,)``.
        use: Usable samples, ``(n,)``.
        step: Time between samples [s].
        joints: Number of joints that are searched.
    """
    found, free, reach = [], use.copy(), round(rules.BURST_LENGTHS[0] / step)
    elsewhere = 0.0
    while free.any():
        levels = [_level(relative, free, max(3, round(seconds / step))) for seconds in rules.BURST_LENGTHS]
        thresholds = [
            _threshold(level[free], seconds, step, joints)
            for level, seconds in zip(levels, rules.BURST_LENGTHS, strict=True)
        ]
        excess = np.max([np.abs(level) / least for level, least in zip(levels, thresholds, strict=True)], axis=0)
        peak = int(np.argmax(excess))
        if excess[peak] <= 1.0:
            elsewhere = float(excess[peak])
            break
        # An event lasts as long as its torque keeps its sign.
        inside = free & (levels[0] * levels[0][peak] > rules.BURST_FLANK * levels[0][peak] ** 2)
        first, last = _run_about(inside, peak)
        free[max(first - reach, 0) : last + reach + 1] = False
        ratio = float(np.abs([level[peak] for level in levels]).max())
        found.append((float(excess[peak]), (first, last, ratio)))
    return [event for size, event in found if size >= rules.BURST_TIMES * elsewhere]


def _level(relative: Array, use: Array, count: int) -> Array:
    """Mean about each sample with the weights of a Hann window of ``count`` samples; zero if too few are usable.

    The mean preserves a push, which keeps its sign, and averages out the noise of encoders, which changes sign.
    """
    window = np.hanning(count + 2)[1:-1]
    filled = np.convolve(use, window, mode="same")[: len(use)]
    total = np.convolve(np.where(use, relative, 0.0), window, mode="same")[: len(use)]
    enough = use & (filled > _FILLED * window.sum())
    return np.where(enough, total / np.maximum(filled, 1e-12), 0.0)


def _threshold(level: Array, seconds: float, step: float, joints: int) -> float:
    """Level that 99 of 100 recordings without an event do not exceed on any joint, at any time, in any window.

    The standard deviation is estimated from the median of the level itself, because it depends on the spectrum of the
    residual. The number of independent values is that of windows, times joints, times window lengths.
    """
    from scipy.special import ndtri

    deviation = 1.4826 * float(np.median(np.abs(level)))
    values = max(len(level) * step / seconds, 1.0) * joints * len(rules.BURST_LENGTHS)
    return max(rules.BURST_RATIO, deviation * -float(ndtri(0.5 * rules.BURST_LEVEL / values)))


def _run_about(inside: Array, at: int) -> tuple[int, int]:
    """Index of the first and the last sample of the run of true samples that contains the sample ``at``."""
    outside = np.flatnonzero(~inside)
    before, after = outside[outside < at], outside[outside > at]
    return (int(before[-1]) + 1 if len(before) else 0, int(after[0]) - 1 if len(after) else len(inside) - 1)


def burst_notes(bursts: tuple[Burst, ...], joints: tuple[JointGap, ...]) -> tuple[Note, ...]:
    """A note on each burst, with the time to exclude from the recording.

    Args:
        bursts: Bursts of a judgement.
        joints: Gaps of the joints, which state the units of torque.
    """
    units, out = {joint.joint: joint.unit for joint in joints}, []
    for burst in bursts:
        numbers = {"file": burst.file, "start": burst.start, "stop": burst.stop, "torque": burst.torque}
        numbers |= {"unit": units[burst.joint], "exclude": (burst.start - _MARGIN, burst.stop + _MARGIN)}
        out.append(Note(Code.EVENT, burst.joint, numbers))
    return tuple(out)


@dataclass(frozen=True)
class Causes:
    """Quantities on which the variance of one joint's residual depends at each sample.

    Attributes:
        known: Variance of the uncertain friction while joints stand still, creep or reverse [torque^2], ``(n,)``. It is
            known before the fit of variances.
        torque: Squared variation of the modelled torque, as `moving_torque` returns it, ``(n,)``.
        reversals: True near reversals of the velocity, ``(n,)``.
    """

    known: Float[Array, " n"]
    torque: Float[Array, " n"]
    reversals: Bool[Array, " n"]


def moving_torque(torque: Float[Array, " n"], rate_hz: float, cutoff_hz: float) -> Float[Array, " n"]:
    """Squared variation of a joint's torque at each sample: its largest value within the reach of the filter.

    The variation is the torque minus its median, plus (in squares) its rate of change divided by ``pi cutoff_hz``. The
    fit compensates errors of a constant torque, while errors of inertia, timing and derivatives grow with changes of
    the torque.

    Args:
        torque: Modelled torque in the band.
        rate_hz: Sampling rate [Hz].
        cutoff_hz: Cutoff of the band [Hz]. Its filter spreads a peak by a period of this frequency to both sides.
    """
    change = np.gradient(torque) * rate_hz / (np.pi * cutoff_hz)
    reach = 2 * int(np.ceil(rate_hz / cutoff_hz)) + 1
    return ndimage.maximum_filter1d((torque - np.median(torque)) ** 2 + change**2, reach, axis=0)


def expected_error(
    residual: Float[Array, " n"], causes: Causes, use: Bool[Array, " n"], fold: Int[Array, " n"]
) -> Float[Array, " n"]:
    """Expected standard deviation of a joint's residual at each sample, estimated from the samples of other folds.

    The variance is the sum of that of the noise, that of uncertain friction, a share of the squared torque and a part
    near reversals. The noise is estimated from the median of samples with a small torque. The last two parts are fitted
    with a distribution with heavy tails and a further part for events, so that events do not increase them.

    Args:
        residual: Residual with the chosen effects in the model.
        causes: Quantities on which the variance depends.
        use: Usable samples.
        fold: Fold of each sample.
    """
    out = np.full(len(residual), np.nan)
    for number in np.unique(fold):
        train, here = use & (fold != number), fold == number
        if np.count_nonzero(train) < _FEWEST_SAMPLES:
            train = use
        out[here] = np.sqrt(_variance(residual, causes, train)[here])
    return out


def _variance(residual: Array, causes: Causes, use: Array) -> Array:
    """Expected variance of the residual at each sample, fitted to the samples ``use``, ``(n,)``."""
    median_torque = float(np.median(causes.torque[use]))
    calm = use & (causes.torque <= median_torque) & (causes.known <= np.median(causes.known[use]))
    calm = calm if np.count_nonzero(calm) >= _FEWEST_SAMPLES else use
    noise = max((1.4826 * float(np.median(np.abs(residual[calm])))) ** 2, 1e-300)
    known = noise + causes.known
    # The noise as estimated includes the error of the model at the median torque, so only larger torques add to it.
    excess = np.maximum(causes.torque - median_torque, 0.0)
    # Events occur at any torque. The constant last part absorbs them in the fit, and is then left out of the variance.
    parts = np.column_stack([excess, noise * causes.reversals, np.full(len(residual), noise)])
    least = np.array([rules.MODEL_SHARE**2, 0.0, 0.0])
    coefficients = _variance_coefficients(residual[use], known[use], parts[use], least)
    return known + parts[:, :2] @ coefficients[:2]


def _variance_coefficients(
    residual: Float[Array, " n"], known: Float[Array, " n"], parts: Float[Array, "n k"], least: Float[Array, " k"]
) -> Float[Array, " k"]:
    """Coefficients of the parts of a variance, by maximum likelihood with Student's t distribution.

    The variance of a sample is ``known + parts @ coefficients``. Each step multiplies a coefficient by the square root
    of the ratio of the two terms of the likelihood's derivative, so that no coefficient becomes negative.

    Args:
        residual: Residual.
        known: Known part of the variance.
        parts: Further parts, without their coefficients.
        least: Least value of each coefficient.
    """
    largest = np.maximum(parts.max(axis=0), 1e-300)
    out = np.maximum(least, 0.01 * known.min() / largest)
    for _ in range(_STEPS):
        variance = known + parts @ out
        weight = (_DEGREES_OF_FREEDOM + 1.0) / (_DEGREES_OF_FREEDOM + residual**2 / variance)
        increasing = (weight * residual**2 / variance**2) @ parts
        decreasing = np.maximum((1.0 / variance) @ parts, 1e-300)
        out = np.maximum(out * np.sqrt(increasing / decreasing), least)
    return out
