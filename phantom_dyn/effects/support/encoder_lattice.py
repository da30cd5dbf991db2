"""Finds the step (resolution) of an encoder: from the model, or from readings that are multiples of a step.

Readings that are an offset plus multiples of a step are said to be on a lattice.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.model.robot import Robot

# Readings are on a lattice if this share of them is near lattice points.
_SHARE = 0.98
# Largest distance of a reading that counts as near a lattice point, in steps; by chance a fifth of all readings are
# near.
_NEAR = 0.1
# Smallest magnitude of the first spectral line of a comb (see `coarse_step`); for an ideal comb the magnitude is one.
_COMB = 0.6
# Largest travel, in stated steps, for which a comb is searched.
_LONGEST = 20_000_000
# Smallest number of levels (distinct readings): fewer levels would fit many lattices by chance.
_LEAST_LEVELS = 8
# Quantiles of the distances between neighbouring levels from which steps are tried. The shortest distance is not
# enough, because a few wrong readings make some distances too short.
_QUANTILES = (0.0, 0.05, 0.2, 0.5)
# Largest number of steps in such a distance; a joint may skip levels between two readings.
_STEPS = 6
# Number of rows before and after a reading over which the speed is measured.
_ROWS = 5
# Smallest distance of the speed, in steps per row, from a whole number. The speed has an error of at most a tenth of a
# step per row, because positions are rounded to a step.
_APART = 0.15


def stated_step(robot: Robot, row: int) -> float | None:
    """Step [rad or m] on the joint side: one turn, or one metre, over the ``encoder_counts`` of the model."""
    counts = robot.actuators[row].encoder_counts
    if counts is None:
        return None
    return (1.0 if robot.prismatic[row] else 2.0 * np.pi) / counts


def reading_step(readings: Float[Array, " N"], stated: float | None) -> float | None:
    """The larger of the steps that `step_of` and `coarse_step` find in readings; None if they find none.

    Args:
        readings: Raw positions of one joint, as recorded.
        stated: Step that the model states, or None.
    """
    lattice = step_of(readings, stated)
    coarse = None if stated is None else coarse_step(readings, stated)
    return max((step for step in (lattice, coarse) if step is not None), default=None)


def step_of(readings: Float[Array, " N"], stated: float | None = None) -> float | None:
    """The largest step such that almost all readings are an offset plus a multiple of it.

    Args:
        readings: Raw positions of one joint, as recorded.
        stated: Step that the model states, which is tried in addition to those that the readings suggest.

    Returns:
        The step; None if the readings are on no lattice, or have too few distinct values.
    """
    levels = _levels(np.asarray(readings, dtype=float))
    if len(levels) < _LEAST_LEVELS:
        return None
    distances = np.diff(levels)
    tried = np.quantile(distances, _QUANTILES, method="lower")
    candidates = {float(distance) / k for distance in tried for k in range(1, _STEPS + 1)}
    if stated is not None:
        candidates |= {stated * k for k in range(1, _STEPS + 1)}
    for step in sorted(candidates, reverse=True):
        sharp = _sharpened(distances, step)
        if np.isfinite(sharp) and _on_lattice(levels, sharp):
            return float(sharp)
    return None


def coarse_step(readings: Float[Array, " N"], stated: float) -> float | None:
    """A step larger than ``stated`` around whose multiples the readings cluster; None if there is none.

    The readings may have noise of a few stated steps. Distinct readings, each counted once, form a comb with one tooth
    per step. At the frequency of the teeth the spectrum of an ideal comb has the magnitude one. The magnitude is near
    zero if readings between the teeth are as frequent as those on them.

    Two further conditions exclude combs with another cause. Readings have to cluster around the teeth along the whole
    travel, and not only around a few positions where the joint creeps. They also have to cluster in rows where the
    joint does not move by one or more whole steps from row to row. A joint that moves by whole steps is read at equal
    distances even if its encoder is fine.

    Args:
        readings: Raw positions of one joint, as recorded.
        stated: Step that the model states.
    """
    places = np.unique(np.round((readings - readings.min()) / stated).astype(int))
    length = int(places[-1]) + 1
    if len(places) < 2 * _LEAST_LEVELS or length > _LONGEST:
        return None
    comb = np.zeros(length)
    comb[places] = 1.0
    # Zero padding interpolates the spectrum, which determines the step to a fraction of a line.
    magnitude = np.abs(np.fft.rfft(comb, 4 * length)) / len(places)
    # Lines below this one would be combs with fewer than eight teeth (four lines per tooth, by the zero padding).
    first = 4 * _LEAST_LEVELS
    lines = np.flatnonzero(magnitude[first:] > _COMB)
    if len(lines) == 0:
        return None
    start = first + int(lines[0])
    # The peak is within eight lines from this one on (two lines without padding).
    peak = start + int(np.argmax(magnitude[start : start + 8]))
    step = 4 * length * stated / peak
    others = np.unique(np.round((readings - readings.min()) / stated)[_at_other_speeds(readings, step)])
    if len(others) < _LEAST_LEVELS or abs(np.mean(np.exp(2j * np.pi * others * stated / step))) < _COMB:
        return None
    return step if _about_every_tooth(places * stated / step) else None


def _at_other_speeds(readings: Float[Array, " N"], step: float) -> Bool[Array, " N"]:
    """True where the speed rounds to zero steps per row, or is not near a whole number of steps per row."""
    rows = np.arange(len(readings))
    first, last = np.maximum(rows - _ROWS, 0), np.minimum(rows + _ROWS, len(readings) - 1)
    speed = np.abs(readings[last] - readings[first]) / (last - first) / step
    whole = np.round(speed)
    return (whole == 0.0) | (np.abs(speed - whole) > _APART)


def _about_every_tooth(phase: Float[Array, " n"]) -> bool:
    """True if levels cluster around the teeth of a comb, where every tooth has the same weight.

    Every tooth and not every level has the same weight, because a joint that creeps has many levels around a few teeth.

    Args:
        phase: Levels, in steps.
    """
    turn = np.exp(2j * np.pi * phase)
    tooth = np.round(phase - np.angle(turn.mean()) / (2.0 * np.pi)).astype(int)
    tooth -= tooth.min()
    count = np.bincount(tooth)
    return bool(abs(np.sum(turn / count[tooth])) > _COMB * np.count_nonzero(count))


def _levels(readings: Array) -> Array:
    """Distinct readings, sorted; values that differ only by floating-point rounding count as one."""
    levels = np.unique(readings)
    if len(levels) < 2:
        return levels
    least = 1e-11 * max(float(np.abs(levels).max()), float(levels[-1] - levels[0]))
    return levels[np.concatenate([[True], np.diff(levels) > least])]


@jit
def _sharpened(distances: Float[Array, " n"], step: float) -> float:
    """``step`` refined by least squares so that distances are multiples of it; NaN if none is nearly a multiple."""
    for _ in range(5):
        squares = product = 0.0
        for distance in distances:
            count = np.rint(distance / step)
            # Distances far from a multiple are left out, because one wrong reading would change the step.
            if abs(distance - count * step) < 2.0 * _NEAR * step:
                squares += count * count
                product += distance * count
        if squares == 0.0:
            return np.nan
        step = product / squares
    return step


def _on_lattice(levels: Array, step: float) -> bool:
    """True if almost all levels are near the points of a lattice with this step, whose offset may drift slowly."""
    phase = (levels - levels[0]) / step
    most = (1.0 - _SHARE) * len(phase)
    # Over many steps the error of the step adds up, so the offset is estimated for each hundred levels.
    missed = 0
    for start in range(0, len(phase), 100):
        part = phase[start : start + 100]
        turn = np.exp(2j * np.pi * part)
        deviation = np.angle(turn / (np.mean(turn) or 1.0)) / (2.0 * np.pi)
        missed += int((np.abs(deviation) >= _NEAR).sum())
        if missed > most:
            return False
    return True
