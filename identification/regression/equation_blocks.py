"""Computes the equations of a log in blocks of samples, and the columns on which each joint's torque can depend."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from identification.data.log import Log
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.effects.rival import Signature
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

BandedEffect = tuple[list[int], Float[Array, "n _ _"]]
"""The ``m`` joints on which an effect acts, and its ``k`` columns in the band of the log, shape ``(n, m, k)``."""


def touched_columns(
    robot: Robot, effects: Sequence[tuple[Sequence[int], int]], *, rigid_body: bool
) -> tuple[tuple[int, ...], ...]:
    """For each joint, the columns on which its torque can depend: those of the bodies it carries and of its effects.

    Args:
        robot: The robot with its bodies.
        effects: For each effect, the indices of the joints on which it acts, and its number of columns.
        rigid_body: True if the first columns are those of the bodies.
    """
    out: list[list[int]] = [[] for _ in range(robot.nv)]
    column = 0
    if rigid_body:
        column = 10 * (robot.model.njoints - 1)
        if robot.chain is not None:  # in a closed chain, every torque can depend on every body
            out = [list(range(column)) for _ in range(robot.nv)]
        else:
            for body in range(1, robot.model.njoints):
                for joint in list(robot.model.supports[body])[1:]:  # the joints that carry the body
                    first = robot.model.idx_vs[joint]
                    for row in range(first, first + robot.model.nvs[joint]):
                        out[row].extend(range(10 * (body - 1), 10 * body))
    for rows, count in effects:
        for row in rows:
            out[row].extend(range(column, column + count))
        column += count
    return tuple(tuple(columns) for columns in out)


def banded(log: Log, signatures: Iterable[Signature]) -> tuple[BandedEffect, ...]:
    """Columns of effects in the band of a log, for all its samples.

    Args:
        log: The recording with its band.
        signatures: Columns of the effects, computed for the whole motion of the log, as some effects depend on the
            past.
    """
    return tuple((list(signature.rows), log.band(signature.columns)) for signature in signatures)


def _decimated(motion: Motion, step: int, first: int, last: int) -> Motion:
    """Decimated samples of a motion from ``first`` up to, not including, ``last``, for a band without a filter."""
    return motion.at(slice(first * step, (last - 1) * step + 1, step))


def blocks_of(
    robot: Robot,
    log: Log,
    effects: Sequence[BandedEffect],
    *,
    rigid_body: bool,
    samples: int,
    columns: Sequence[int] | None = None,
) -> Iterator[Float[Array, "n nv p"]]:
    """Blocks of the equations of one log, with its valid samples only.

    Args:
        robot: The robot with its rigid bodies.
        log: The recording.
        effects: Effects from `banded`.
        rigid_body: True if the first columns are those of the bodies.
        samples: Number of samples of the log, at its full rate, per block.
        columns: Columns to compute, ascending; by default all.
    """
    band, valid_rows = log.band, log.valid_in_band
    bodies = 10 * (robot.model.njoints - 1) if rigid_body else 0
    total = bodies + sum(values.shape[2] for _, values in effects)
    chosen_columns = range(total) if columns is None else columns
    rigid = tuple(column for column in chosen_columns if column < bodies)
    chosen = _some_columns(effects, np.array([column - bodies for column in chosen_columns[len(rigid) :]], dtype=int))
    # The filter of a block needs samples of the neighbouring blocks, which are computed twice. They are few, because a
    # block is at least eight half widths of the filter long.
    size = max(1, max(samples, 8 * band.half) // band.step)
    for first in range(0, len(valid_rows), size):
        last = min(first + size, len(valid_rows))
        block = np.zeros((last - first, robot.nv, len(chosen_columns)))
        if rigid and band.half == 0:
            rigid_body_regressor(robot, _decimated(log.motion, band.step, first, last), columns=rigid, out=block)
        elif rigid:
            reach = log.motion.at(slice(first * band.step, (last - 1) * band.step + 2 * band.half + 1))
            block[:, :, : len(rigid)] = band(rigid_body_regressor(robot, reach, columns=rigid))
        column = len(rigid)
        for rows, values in chosen:
            count = values.shape[2]
            for place, row in enumerate(rows):
                block[:, row, column : column + count] = values[first:last, place]
            column += count
        valid = valid_rows[first:last]
        yield block if valid.all() else block[valid]


def _some_columns(effects: Sequence[BandedEffect], columns: Array) -> list[BandedEffect]:
    """Some columns of the effects; number 0 is the first column of the first effect."""
    out, start = [], 0
    for rows, values in effects:
        stop = start + values.shape[2]
        of_effect = columns[(columns >= start) & (columns < stop)] - start
        if len(of_effect):
            out.append((rows, values if len(of_effect) == values.shape[2] else values[:, :, of_effect]))
        start = stop
    return out
