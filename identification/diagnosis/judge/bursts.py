"""Bursts: short stretches in which the residual is far larger than is expected at that moment.

A push, a contact, a cable that catches: nothing in the state of the robot predicts such an event. The expected size
comes from the noise, the model's error, reversals and standing joints. The error of a model grows with the torque that
it explains, noise does not: a residual that is large where the torque is large is no event.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.motion.standstill import counted_step, near_reversals
from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.gap import measured_in_band, moved_by
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.floors import reading_noise, torque_above_band
from identification.diagnosis.result import Burst, JointGap
from identification.engine import contract_levels
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Bool, Float, Int
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.model.robot import Robot

# Largest distance [s] of two bursts that count as one.
_CLOSE = 0.1
# Time [s] to leave out before and behind a burst, as filters spread it.
_MARGIN = 0.2
# Share of a window that has to be usable.
_FILLED = 0.6
# Usable samples of a joint that a search for bursts needs.
_LEAST_SAMPLES = 50
# Degrees of freedom of Student's law, with which variances are fitted: events have little weight in it.
_FREEDOM = 4.0
_STEPS = 60  # multiplicative steps of the variances
_FEWEST_SAMPLES = 20  # samples of other folds, or of calm moments, without which all samples are taken


def bursts_of(problem: Problem, residual: Series, doubt: Series) -> tuple[Burst, ...]:
    """Bursts in all recordings, in the order of time.

    Args:
        problem: Columns and blocks.
        residual: Residual of each log after the explanation, in the judged band.
        doubt: Variance of each log's residual where joints stand, creep or reverse, in the band.
    """
    session, columns, out = problem.session, problem.columns, []
    answers = np.sqrt(torque_above_band(problem, reading_noise(session)))
    modelled, measured = moved_by(problem, columns.model_torque), measured_in_band(problem)
    for k, log in enumerate(session.logs):
        fold = np.zeros(len(log.samples), dtype=int)
        for block, number in zip(session.blocks, session.folds, strict=True):
            if block.log == k:
                fold[block.start : block.stop] = number
        rate = log.band.output_rate_hz
        reversals = near_reversals(log)
        expected = np.column_stack(
            [
                expected_error(
                    residual[k][:, j],
                    Causes(doubt[k][:, j], moving_torque(torque, rate, session.cutoff_hz), reversals[:, j]),
                    columns.usable[k][:, j],
                    fold,
                )
                if columns.usable[k][:, j].any()
                else np.full(len(fold), np.inf)
                for j, torque in enumerate(modelled[k].T)
            ]
        )
        # Near the ends of a recording filters work on a mirror image of the motion.
        reach = int(rate / session.cutoff_hz) + 1
        outside = np.pad(~log.valid_in_band, reach, constant_values=True)
        inside = np.logical_not(ndimage.maximum_filter1d(outside, 2 * reach + 1, axis=0))[reach:-reach]
        usable = columns.usable[k] & inside[:, None]
        # A push from outside is the torque of the model minus that of the drive.
        found = bursts_in(log.motion.t[log.samples], -residual[k], expected, usable, log.joint_names)
        # Accuracy of derivatives and filters.
        sizes = np.sqrt(np.mean(measured[k] ** 2, axis=0))
        # A controller's answer to its encoder, measured above the band, may alias to one frequency inside it.
        least = np.maximum(rules.MODEL_SHARE * sizes, rules.SENSOR_TIMES * answers)
        for joint, start, stop, torque, ratio in found:
            row = log.joint_names.index(joint)
            if abs(torque) > max(least[row], rounding_torque(session.robot, log, row, start, stop)):
                out.append(Burst(log.file, joint, start, stop, torque, ratio))
    return tuple(out)


def rounding_torque(robot: Robot, log: Log, row: int, start: float, stop: float) -> float:
    """The largest spurious torque that the steps of encoders can make on a joint between two times [N m or N].

    A reading is wrong by half a step at most. At a steady speed the error is a tone that may last, and no noise. Of an
    error of at most ``e`` a mean weighted by a Hann window of length ``T`` leaves an acceleration of at most
    ``8 pi e / T^2``: the integral of the second derivative of the window. Errors of several joints come independently.

    Args:
        robot: Gives the inertias.
        log: Readings and their steps.
        row: Index of the joint.
        start: First time [s].
        stop: Last time [s]; nothing is looked for over less than the shortest window.
    """
    seconds = max(stop - start, rules.BURST_LENGTHS[0])
    errors = 0.5 * np.array([counted_step(robot, log, j) for j in range(robot.nv)])
    at = int(np.searchsorted(log.motion.t, start))
    inertia = mass_matrix(robot, log.motion.q[at : at + 1])[0, row]
    return float(8.0 * np.pi / seconds**2 * np.linalg.norm(inertia * errors))


def distinct_bursts(
    bursts: tuple[Burst, ...], problem: Problem, residual: Series, floor: Float[Array, " nv"]
) -> tuple[Burst, ...]:
    """Bursts far above the other residual of their joint, and above the residual of every joint with a gap.

    Where the residual of a joint is above its noise all the time, its peaks are no events, unless they are many times
    as large as the rest: a push also spoils the fit of the other samples. And an unmodelled torque of that joint may
    act on other joints, with at most its own size.

    Args:
        bursts: In all recordings.
        problem: Columns of these.
        residual: Residual of each log after the explanation, in the judged band.
        floor: Noise floor of each joint.
    """
    if not bursts:
        return ()
    squares, counts = np.zeros(len(floor)), np.zeros(len(floor))
    for log, left, usable in zip(problem.session.logs, residual, problem.columns.usable, strict=True):
        t, use = log.motion.t[log.samples], usable.copy()
        for burst in bursts:
            if burst.file == log.file:
                use[(t > burst.start - _MARGIN) & (t < burst.stop + _MARGIN)] = False
        squares += np.sum(np.where(use, left, 0.0) ** 2, axis=0)
        counts += use.sum(axis=0)
    rest = np.sqrt(squares / np.maximum(counts, 1))
    loud = rest > contract_levels.FLOORS_LEFT * floor
    least = max(rest[loud], default=0.0)
    needed = dict(zip(problem.session.robot.joint_names, np.where(loud, rules.BURST_RATIO * rest, 0.0), strict=True))
    return tuple(one for one in bursts if abs(one.torque) > max(needed[one.joint], least))


def bursts_in(
    t: Float[Array, " n"],
    left: Float[Array, "n nv"],
    expected: Float[Array, "n nv"],
    usable: Bool[Array, "n nv"],
    joints: tuple[str, ...],
) -> tuple[tuple[str, float, float, float, float], ...]:
    """Bursts in one recording, in the order of time: joint, first and last time, torque, and its size as expected.

    Args:
        t: Times [s], evenly spaced.
        left: Unexplained torque of each joint, positive along the joint.
        expected: Standard deviation of it that is expected at each moment.
        usable: False where a joint rests or a sample is excluded.
        joints: Their names.
    """
    found = []
    for j, joint in enumerate(joints):
        use = usable[:, j]
        if np.count_nonzero(use) < _LEAST_SAMPLES:
            continue
        centred = np.where(use, left[:, j] - np.median(left[use, j]), 0.0)
        relative, events = np.where(use, centred / expected[:, j], 0.0), []
        for first, last, ratio in _events_in(relative, use, float(np.median(np.diff(t))), len(joints)):
            peak = first + int(np.argmax(np.abs(centred[first : last + 1])))
            events.append((joint, float(t[first]), float(t[last]), float(centred[peak]), ratio))
        most = max((abs(event[3]) for event in events), default=0.0)
        found += [event for event in events if abs(event[3]) >= rules.BURST_SHARE * most]
    # A push on the last link acts on all joints: it is stated once, for the joint on which it is clearest.
    out: list[tuple[str, float, float, float, float]] = []
    for one in sorted(found, key=lambda burst: -burst[4]):
        if all(one[2] < other[1] - _CLOSE or one[1] > other[2] + _CLOSE for other in out):
            out.append(one)
    return tuple(sorted(out, key=lambda burst: burst[1]))


def _events_in(relative: Array, use: Array, step: float, joints: int) -> list[tuple[int, int, float]]:
    """First and last sample of each event, and its mean over a window in units of the expected deviation.

    The largest is removed with its flanks before the next one is looked for, as a window beside it holds part of it. An
    event has to be far above the largest level at all other times: else the noise itself is loud at some moments, as is
    a controller's answer to the steps of an encoder in a log with a low rate.
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
    """Weighted mean about each sample, zero where too little of the window is usable.

    A push has one sign, so that a mean keeps it; noise of encoders has none, so that a mean removes it.
    """
    window = np.hanning(count + 2)[1:-1]
    filled = np.convolve(use, window, mode="same")[: len(use)]
    total = np.convolve(np.where(use, relative, 0.0), window, mode="same")[: len(use)]
    enough = use & (filled > _FILLED * window.sum())
    return np.where(enough, total / np.maximum(filled, 1e-12), 0.0)


def _threshold(level: Array, seconds: float, step: float, joints: int) -> float:
    """Level that 99 of 100 recordings without an event do not exceed, on any joint, at any time, in any window.

    The spread is the median deviation of the level itself, so that the spectrum of the residual counts.
    """
    from scipy.special import ndtri

    spread = 1.4826 * float(np.median(np.abs(level)))
    looks = max(len(level) * step / seconds, 1.0) * joints * len(rules.BURST_LENGTHS)
    return max(rules.BURST_RATIO, spread * -float(ndtri(0.5 * rules.BURST_LEVEL / looks)))


def _run_about(inside: Array, at: int) -> tuple[int, int]:
    """First and last sample of the run of true samples about one."""
    outside = np.flatnonzero(~inside)
    before, after = outside[outside < at], outside[outside > at]
    return (int(before[-1]) + 1 if len(before) else 0, int(after[0]) - 1 if len(after) else len(inside) - 1)


def burst_notes(bursts: tuple[Burst, ...], joints: tuple[JointGap, ...]) -> tuple[Note, ...]:
    """A note on every burst, with what to leave out.

    Args:
        bursts: Bursts of a judgement.
        joints: Their units.
    """
    units, out = {joint.joint: joint.unit for joint in joints}, []
    for burst in bursts:
        numbers = {"file": burst.file, "start": burst.start, "stop": burst.stop, "torque": burst.torque}
        numbers |= {"unit": units[burst.joint], "exclude": (burst.start - _MARGIN, burst.stop + _MARGIN)}
        out.append(Note(Code.EVENT, burst.joint, numbers))
    return tuple(out)


@dataclass(frozen=True)
class Causes:
    """Squared torques of one joint with which its residual grows.

    Attributes:
        known: Variance that is known beforehand [torque^2], ``(n,)``: where joints stand or reverse.
        torque: Square of the moving part of the modelled torque and of its change, at its largest nearby, ``(n,)``.
        reversals: True near reversals of the velocity, ``(n,)``.
    """

    known: Float[Array, " n"]
    torque: Float[Array, " n"]
    reversals: Bool[Array, " n"]


def moving_torque(torque: Float[Array, " n"], rate_hz: float, cutoff_hz: float) -> Float[Array, " n"]:
    """Square of a joint's torque about its median, and of its change within the band, at its largest nearby.

    The fit compensates a steady torque; errors of inertia, timing and derivatives grow with a changing torque.

    Args:
        torque: Modelled torque in the band.
        rate_hz: Rate of its samples [Hz].
        cutoff_hz: Edge of the band, whose filter carries a peak that far.
    """
    change = np.gradient(torque) * rate_hz / (np.pi * cutoff_hz)
    reach = 2 * int(np.ceil(rate_hz / cutoff_hz)) + 1
    return ndimage.maximum_filter1d((torque - np.median(torque)) ** 2 + change**2, reach, axis=0)


def expected_error(
    residual: Float[Array, " n"], causes: Causes, use: Bool[Array, " n"], fold: Int[Array, " n"]
) -> Float[Array, " n"]:
    """Standard deviation of a residual at each sample, estimated without the fold of the sample.

    The variance is that of the noise, the known one, a share of the squared torque and a part near reversals. The noise
    is the median of the calmer half; the rest is fitted with a heavy-tailed law beside a part for events, so that these
    do not raise it.

    Args:
        residual: Residual after the explanation.
        causes: Squared torques with which it may grow.
        use: Samples that count.
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
    usual = float(np.median(causes.torque[use]))
    calm = use & (causes.torque <= usual) & (causes.known <= np.median(causes.known[use]))
    calm = calm if np.count_nonzero(calm) >= _FEWEST_SAMPLES else use
    noise = max((1.4826 * float(np.median(np.abs(residual[calm])))) ** 2, 1e-300)
    known = noise + causes.known
    # The error of the model at the usual torque is contained in the noise.
    more = np.maximum(causes.torque - usual, 0.0)
    # Events occur at any torque: a constant part absorbs them, and is no part of the expected error.
    parts = np.column_stack([more, noise * causes.reversals, np.full(len(residual), noise)])
    least = np.array([rules.MODEL_SHARE**2, 0.0, 0.0])
    return known + parts[:, :2] @ _variance_coefficients(residual[use], known[use], parts[use], least)[:2]


def _variance_coefficients(
    residual: Float[Array, " n"], known: Float[Array, " n"], parts: Float[Array, "n k"], least: Float[Array, " k"]
) -> Float[Array, " k"]:
    """Coefficients of variances beside a known one: the likeliest by Student's law, by multiplicative steps."""
    largest = np.maximum(parts.max(axis=0), 1e-300)
    out = np.maximum(least, 0.01 * known.min() / largest)
    for _ in range(_STEPS):
        variance = known + parts @ out
        weight = (_FREEDOM + 1.0) / (_FREEDOM + residual**2 / variance)
        seen = (weight * residual**2 / variance**2) @ parts
        due = np.maximum((1.0 / variance) @ parts, 1e-300)
        out = np.maximum(out * np.sqrt(seen / due), least)
    return out
