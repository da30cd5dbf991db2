"""Lattices of encoder readings: the step that is stated, and the one on whose multiples the readings lie."""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot

# A lattice is believed if this share of the readings lies within a tenth of a step of it; a fifth would by chance.
_SHARE = 0.98
_NEAR = 0.1
# Height of the first line of a comb that is believed, of one at most.
_COMB = 0.6
# Stated steps over the whole travel beyond which a comb is not looked for.
_LONGEST = 20_000_000
# Fewer levels than this may lie on any lattice.
_LEAST_LEVELS = 8
# Places among the sorted distances of neighbouring levels to begin with: a few wrong readings make some too short.
_PLACES = (0.0, 0.05, 0.2, 0.5)
# A distance may be some steps, where the joint passes levels without being read there.
_STEPS = 6


def stated_step(robot: Robot, row: int) -> float | None:
    """Step [rad or m] that ``encoder_counts`` states: one turn (or metre) over the counts, on the joint side."""
    counts = robot.actuators[row].encoder_counts
    if counts is None:
        return None
    return (1.0 if robot.prismatic[row] else 2.0 * np.pi) / counts


def reading_step(readings: Float[Array, " N"], stated: float | None) -> float | None:
    """The coarser of the step of the lattice of readings and the step about which they gather; None without either.

    Args:
        readings: Raw positions of one joint, as recorded.
        stated: Step that they should have, or None.
    """
    lattice = step_of(readings, stated)
    gathered = None if stated is None else coarse_step(readings, stated)
    return max((step for step in (lattice, gathered) if step is not None), default=None)


def step_of(readings: Float[Array, " N"], stated: float | None = None) -> float | None:
    """The largest step such that almost all readings are multiples of it, whatever their zero.

    Args:
        readings: Raw positions of one joint, as recorded, rounded by a text file or not.
        stated: Step that they should have, tried besides those that the readings suggest.

    Returns:
        The step, or None where the readings are on no lattice or take too few values to tell.
    """
    levels = _levels(np.asarray(readings, dtype=float))
    if len(levels) < _LEAST_LEVELS:
        return None
    distances = np.diff(levels)
    near = np.quantile(distances, _PLACES, method="lower")
    candidates = {float(distance) / k for distance in near for k in range(1, _STEPS + 1)}
    if stated is not None:
        candidates |= {stated * k for k in range(1, _STEPS + 1)}
    for step in sorted(candidates, reverse=True):
        sharp = _sharpened(distances, step)
        if np.isfinite(sharp) and _on_lattice(levels, sharp):
            return float(sharp)
    return None


def coarse_step(readings: Float[Array, " N"], stated: float) -> float | None:
    """A step coarser than ``stated`` about whose multiples the readings gather, noise of a few stated steps allowed.

    The levels that were read, each counted once, are seen as a comb: its spectrum is near one at the frequency of its
    teeth, and near zero where every level in between was read. Every tooth has to hold its
    levels alike: most levels of a joint that creeps about a few places lie there.

    Args:
        readings: Raw positions of one joint, as recorded.
        stated: Step that they should have.
    """
    places = np.unique(np.round((readings - readings.min()) / stated).astype(int))
    length = int(places[-1]) + 1
    if len(places) < 2 * _LEAST_LEVELS or length > _LONGEST:
        return None
    comb = np.zeros(length)
    comb[places] = 1.0
    # Four times as long with zeros: the step is wanted to a fraction of a line.
    height = np.abs(np.fft.rfft(comb, 4 * length)) / len(places)
    first = 4 * _LEAST_LEVELS
    teeth = np.flatnonzero(height[first:] > _COMB)
    if len(teeth) == 0:
        return None
    start = first + int(teeth[0])
    peak = start + int(np.argmax(height[start : start + 8]))
    step = 4 * length * stated / peak
    return step if _about_every_tooth(places * stated / step) else None


def _about_every_tooth(phase: Float[Array, " n"]) -> bool:
    """True if levels, in steps, gather where each tooth counts alike, and not about a few teeth that hold most levels.

    A joint that creeps about a few places leaves most of its levels there.
    """
    turn = np.exp(2j * np.pi * phase)
    tooth = np.round(phase - np.angle(turn.mean()) / (2.0 * np.pi)).astype(int)
    tooth -= tooth.min()
    held = np.bincount(tooth)
    return bool(abs(np.sum(turn / held[tooth])) > _COMB * np.count_nonzero(held))


def _levels(readings: Array) -> Array:
    """Distinct readings in order; what differs by rounding of floating-point numbers only is the same."""
    levels = np.unique(readings)
    if len(levels) < 2:
        return levels
    least = 1e-11 * max(float(np.abs(levels).max()), float(levels[-1] - levels[0]))
    return levels[np.concatenate([[True], np.diff(levels) > least])]


@jit
def _sharpened(distances: Float[Array, " n"], step: float) -> float:
    """``step`` by least squares over all distances, in which it may be many times; NaN if it comes to nothing."""
    for _ in range(5):
        squares = product = 0.0
        for distance in distances:
            count = np.rint(distance / step)
            # Distances that are no multiple are left out, or one wrong reading would pull the step.
            if abs(distance - count * step) < 2.0 * _NEAR * step:
                squares += count * count
                product += distance * count
        if squares == 0.0:
            return np.nan
        step = product / squares
    return step


def _on_lattice(levels: Array, step: float) -> bool:
    """True if almost all levels lie near a multiple of ``step`` from where most lie, followed from level to level."""
    phase = (levels - levels[0]) / step
    most = (1.0 - _SHARE) * len(phase)
    # Over many steps the error of the step adds up: the lattice is followed over stretches of a hundred levels.
    missed = 0
    for start in range(0, len(phase), 100):
        part = phase[start : start + 100]
        turn = np.exp(2j * np.pi * part)
        off = np.angle(turn / (np.mean(turn) or 1.0)) / (2.0 * np.pi)
        missed += int((np.abs(off) >= _NEAR).sum())
        if missed > most:
            return False
    return True
