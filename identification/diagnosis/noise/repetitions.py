"""Estimates noise from repetitions of a motion, between which the torque residual differs by noise alone."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement

import numpy as np
from scipy import ndimage
from scipy.fft import next_fast_len

from identification.data.log import Log
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.one_recording_effects import NO_DIFFERENCES
from identification.diagnosis.columns.session import Series, Session
from identification.engine.autocorrelation import autocorrelation_time
from phantom_dyn.array_types import Array, Bool, Float

_MOST_REPETITIONS = 6  # largest number of repetitions compared for a pair of recordings
# Two stretches are different motions if the sum of squares of their velocity difference exceeds this share of the sum
# of squares of both velocities.
_DIFFERENT_MOTION = 0.5
# Smallest sum of squares of the velocities in two overlapping stretches, as a share of that of the weaker recording.
_LEAST_OVERLAP = 0.1
_WINDOW = 0.5  # time [s] over which two stretches have to agree
_SLOW_JOINT = 0.01  # a joint whose usual velocity is below this share of the fastest joint's is not compared
# Smallest number of independent differences. With fewer the noise is uncertain by more than a sixth, and not estimated.
_FEWEST_DIFFERENCES = 20.0
# A drive with a loose controller repeats its motion to some per cent only. Two such motions are compared if their
# velocities differ by at most the share `_LOOSE_DIFFERENCE`. The error of the model differs between them, too. So the
# comparison is used only if this difference is less than the share `_MODEL_ERROR_SHARE` of the estimated noise.
_LOOSE_DIFFERENCE, _MODEL_ERROR_SHARE = 0.1, 1.0 / 3.0
_SHIFTS = 41  # number of shifts between -1 and 1 sample that are tried


@dataclass(frozen=True)
class RepetitionNoise:
    """Estimated noise of one joint's torque: root mean square of the part that does not repeat.

    Attributes:
        value: The estimate [N m or N].
        error: One standard deviation of its logarithm.
    """

    value: float
    error: float


def repetition_noise(
    session: Session, residual: Series, usable: tuple[Bool[Array, "n nv"], ...], counts: Series | None = None
) -> tuple[RepetitionNoise | None, ...]:
    """Noise of each joint's torque in the judged band; None for a joint whose motion does not repeat.

    Half the mean square of the difference between two repetitions is the variance of the noise. The error of a model
    repeats with the motion and cancels, noise of the sensors does not. Recordings with known differences in load,
    controller or surroundings are not compared with each other.

    Args:
        session: Recordings and their judged band.
        residual: Torque residual of each log in the judged band [N m or N].
        usable: True for samples that are used, for each log.
        counts: Weight of each sample for motions that repeat only loosely; None if such motions are not compared.
    """
    rows = len(session.robot.joint_names)
    differences: list[list[tuple[Array, Array]]] = [[] for _ in range(rows)]
    for first, second, lag in repetitions(session):
        part, other = _overlap(len(residual[first]), len(residual[second]), lag)
        agree = _same_motion(session.logs[first], part, session.logs[second], other)
        for j in range(rows):
            use = agree & usable[first][part, j] & usable[second][other, j]
            differences[j].append((residual[first][part, j] - residual[second][other, j], use.astype(float)))
    strictly = [_noise_of_differences(parts) for parts in differences]
    if counts is None or all(one is not None for one in strictly):
        return tuple(strictly)
    loosely = _noise_of_loose_repetitions(session, residual, counts)
    return tuple(other if one is None else one for one, other in zip(strictly, loosely, strict=True))


def _noise_of_loose_repetitions(session: Session, residual: Series, counts: Series) -> list[RepetitionNoise | None]:
    """Noise of each joint from recordings whose motions agree to some per cent; None for a joint with too few."""
    rows, logs = len(session.robot.joint_names), session.logs
    if session.differences != NO_DIFFERENCES:
        return [None] * rows
    differences: list[list[tuple[Array, Array]]] = [[] for _ in range(rows)]
    of_model = np.zeros(rows)
    residual_rms = np.sqrt(np.mean(np.concatenate(residual) ** 2, axis=0))
    for first, second in combinations(range(len(logs)), 2):
        found = _aligned(logs[first], logs[second])
        if found is None:
            continue
        samples, places, agree, unlike = found
        other = _interpolated(residual[second], places)
        weight = agree[:, None] * counts[first][samples] * _interpolated(counts[second], places)
        # The error of the model is part of the residual, and differs by about the same share as the motions.
        of_model = np.maximum(of_model, unlike * residual_rms)
        for j in range(rows):
            differences[j].append((residual[first][samples, j] - other[:, j], weight[:, j]))
    out = [_noise_of_differences(parts) for parts in differences]
    return [
        one if one is not None and most < _MODEL_ERROR_SHARE * one.value else None
        for one, most in zip(out, of_model, strict=True)
    ]


def _aligned(first: Log, second: Log) -> tuple[Array, Array, Array, float] | None:
    """Alignment of two logs that begin at about the same time; None if their motions differ.

    The samples of the second log are at times between those of the first, and its rate may be different.

    Returns:
        Indices of samples of the first log; their places in the second log, as fractional indices; True where both
        motions agree; and the relative difference of the velocities, as a root mean square.
    """
    rates = first.band.output_rate_hz, second.band.output_rate_hz
    v, w = _velocity(first), _velocity(second)
    usual = _usual_velocity(v, w)
    moves = usual > _SLOW_JOINT * usual.max()
    # Smallest relative difference of the velocities, and its shift in samples of the second log.
    best = (np.inf, 0.0)
    places = np.arange(len(v)) * rates[1] / rates[0]
    for shift in np.linspace(-1.0, 1.0, _SHIFTS):
        inside = (places + shift >= 0) & (places + shift <= len(w) - 1)
        other = _interpolated(w, (places + shift)[inside])
        unlike = float(np.sqrt(np.mean(((v[inside] - other)[:, moves] / usual[moves]) ** 2)))
        best = min(best, (unlike, float(shift)))
    if best[0] > _LOOSE_DIFFERENCE:
        return None
    inside = (places + best[1] >= 0) & (places + best[1] <= len(w) - 1)
    samples, places = np.flatnonzero(inside), (places + best[1])[inside]
    q, p = first.motion.q[first.samples][samples], _interpolated(second.motion.q[second.samples], places)
    difference = _difference(q, p, v[samples] - _interpolated(w, places), usual, rates[0])
    return samples, places, difference < _LOOSE_DIFFERENCE**2, best[0]


def _interpolated(x: Float[Array, "n k"], at: Float[Array, " m"]) -> Float[Array, "m k"]:
    """A series at fractional indices, by the cubic polynomial through the four nearest samples."""
    k = np.clip(np.floor(at).astype(int), 1, len(x) - 3)
    u = (at - k)[:, None]
    a, b, c, d = (x[k + shift] for shift in (-1, 0, 1, 2))
    return (
        -u * (u - 1) * (u - 2) / 6 * a
        + (u + 1) * (u - 1) * (u - 2) / 2 * b
        - (u + 1) * u * (u - 2) / 2 * c
        + (u + 1) * u * (u - 1) / 6 * d
    )


def _noise_of_differences(parts: list[tuple[Array, Array]]) -> RepetitionNoise | None:
    """Noise of a torque, from weighted differences of repetitions; None with too few independent differences."""
    independent, squares, count = 0.0, 0.0, 0.0
    for difference, weight in parts:
        used = weight > 0
        if used.sum() > 1:
            own = weight[used]
            # Unequal weights and autocorrelation both reduce the number of independent differences.
            independent += float(own.sum() ** 2 / np.sum(own**2)) / autocorrelation_time(difference[used])
            squares, count = squares + float(own @ difference[used] ** 2), count + float(own.sum())
    if independent < _FEWEST_DIFFERENCES:
        return None
    return RepetitionNoise(float(np.sqrt(0.5 * squares / count)), float(np.sqrt(0.5 / independent)))


def repetitions(session: Session) -> list[tuple[int, int, int]]:
    """Repeated motions: indices of two logs (or of one log twice), and the lag of the second motion in samples."""
    found = []
    for (first, log), (second, other) in combinations_with_replacement(enumerate(session.logs), 2):
        same_rate = np.isclose(log.band.output_rate_hz, other.band.output_rate_hz)
        if first == second or (session.differences == NO_DIFFERENCES and same_rate):
            found += [(first, second, lag) for lag in _lags(log, other, same_recording=first == second)]
    return found


def _velocity(log: Log) -> Float[Array, "n nv"]:
    """Joint velocities at the in-band samples of a log [rad/s or m/s]."""
    return log.motion.v[log.samples]


def _usual_velocity(v: Float[Array, "n nv"], w: Float[Array, "m nv"]) -> Float[Array, " nv"]:
    """Root mean square of the velocity of each joint over two motions."""
    return np.sqrt(np.mean(np.concatenate([v, w]) ** 2, axis=0))


def _lags(first: Log, second: Log, *, same_recording: bool) -> list[int]:
    """Shifts in samples at which a motion repeats, the best matches first."""
    v, w = _velocity(first), _velocity(second)
    scale = np.maximum(_usual_velocity(v, w), 1e-12)
    v, w = v / scale, w / scale
    # For each lag, `unlike` is sum |v - w|^2 / sum (|v|^2 + |w|^2) over the overlap: 0 for equal motions, about 1 for
    # unrelated ones.
    products = np.sum([_correlation(w[:, j], v[:, j]) for j in range(v.shape[1])], axis=0)
    lags = np.arange(-(len(v) - 1), len(w))
    cumulated = [np.concatenate([[0.0], np.cumsum(np.sum(x**2, axis=1))]) for x in (v, w)]
    starts = np.maximum(0, -lags), np.maximum(0, lags)
    length = np.minimum(len(v) - starts[0], len(w) - starts[1])
    squares = np.sum([total[s + length] - total[s] for total, s in zip(cumulated, starts, strict=True)], axis=0)
    enough = squares > 2.0 * _LEAST_OVERLAP * min(total[-1] for total in cumulated)
    unlike = np.where(enough, 1.0 - 2.0 * products / np.maximum(squares, 1e-300), 1.0)
    if same_recording:
        # A recording resembles itself at small lags without a repetition. So only lags beyond the first one at which it
        # is unlike itself are used.
        far = np.flatnonzero((lags > 0) & (unlike > _DIFFERENT_MOTION))
        unlike = np.where(lags < (lags[far[0]] if len(far) else np.inf), 1.0, unlike)
    # The lags at local minima of `unlike`.
    around = np.pad(unlike, 1, constant_values=1.0)
    best = np.flatnonzero((unlike < around[:-2]) & (unlike <= around[2:]) & (unlike <= _DIFFERENT_MOTION))
    best = sorted(best, key=lambda k: unlike[k])[:_MOST_REPETITIONS]
    return [int(lags[k]) for k in best]


def _correlation(w: Float[Array, " m"], v: Float[Array, " n"]) -> Float[Array, " m+n-1"]:
    """Sums of products of ``w`` with ``v`` delayed by -(n - 1) to m - 1 samples."""
    length = int(next_fast_len(len(w) + len(v) - 1, real=True))  # type: ignore[arg-type]
    circular = np.fft.irfft(np.fft.rfft(w, length) * np.fft.rfft(v[::-1], length), length)
    return circular[: len(w) + len(v) - 1]


def _overlap(first: int, second: int, lag: int) -> tuple[slice, slice]:
    """Samples of the first and of the second log that overlap if the second motion is later by ``lag`` samples."""
    start = max(0, -lag)
    length = min(first - start, second - start - lag)
    return slice(start, start + length), slice(start + lag, start + lag + length)


def _same_motion(first: Log, part: slice, second: Log, other: slice) -> Bool[Array, " n"]:
    """True where two stretches are the same motion: every joint has the same position and velocity."""
    v, w = _velocity(first), _velocity(second)
    q, p = first.motion.q[first.samples][part], second.motion.q[second.samples][other]
    return _difference(q, p, v[part] - w[other], _usual_velocity(v, w), first.band.output_rate_hz) < rules.REPEATED**2


def _difference(
    q: Float[Array, "n nv"], p: Float[Array, "n nv"], dv: Float[Array, "n nv"], usual: Float[Array, " nv"], rate: float
) -> Float[Array, " n"]:
    """Squared relative difference of two stretches in the joint that differs most, averaged over a window.

    Args:
        q: Positions of the first stretch [rad or m]. Differences of positions are relative to the travel in it.
        p: Positions of the second stretch [rad or m].
        dv: Difference of the velocities [rad/s or m/s].
        usual: Usual velocity of each joint, to which ``dv`` is relative. Joints that are nearly still are not compared.
        rate: Samples per second [Hz].
    """
    moves = usual > _SLOW_JOINT * usual.max()
    q, p, dv = q[:, moves], p[:, moves], dv[:, moves] / usual[moves]
    travel = np.maximum(np.ptp(q, axis=0), 1e-12)
    largest = np.maximum(dv**2, ((q - p) / travel) ** 2).max(axis=1)
    return ndimage.uniform_filter1d(largest, max(1, round(_WINDOW * rate)), mode="nearest")
