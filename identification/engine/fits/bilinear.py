"""Gram matrices of a model in which a factor (gain) of a row's measured torque is fitted, too.

A row holds the samples of one joint. A gain multiplies the other coefficients of its row. The fit is therefore
bilinear, and is iterated: with the gain of the last iteration the columns of the row are rescaled, and the problem is
linear again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.engine.fits.problem import LinearProblem
from phantom_dyn.array_types import Float, Int

Array = np.ndarray


@dataclass(frozen=True)
class Scaling:
    """A fitted gain on one row, for a wrong torque constant: the measured torque is ``gain`` times the true one.

    All columns of the row are multiplied by the current gain. The column of the gain holds the torque of the given
    model; the torque of the current fit replaces it. At convergence the linear fit is also the bilinear one.

    Attributes:
        row: Index of the row.
        column: Index of the column of the gain: the torque of the given model.
        gain: Current estimate.
        theta: Coefficients of the current fit, with zero for the gain, ``(K,)``.
    """

    row: int
    column: int
    gain: float
    theta: Float[Array, " K"]


@dataclass(frozen=True)
class HeldOut:
    """Products for the fits without one fold each, and the held-out losses.

    Attributes:
        a: Columns times columns over the blocks of each fold, ``(F, k, k)``. A fit without the fold subtracts them.
        b: Columns times residual over the blocks of each fold, ``(F, k)``.
        losses: Function from the coefficients for each block, ``(B, k)``, to the weighted squared residual of each
            block's core, ``(B,)``.
    """

    a: Float[Array, "F k k"]
    b: Float[Array, "F k"]
    losses: Callable[[Float[Array, "B k"]], Float[Array, " B"]]


@dataclass(frozen=True)
class Products:
    """Products over all training blocks, and by fold.

    Attributes:
        a: Columns times columns, ``(k, k)``.
        b: Columns times residual, ``(k,)``.
        c: Residual times residual.
        held_out: Products by fold; None if nothing is held out.
    """

    a: Float[Array, "k k"]
    b: Float[Array, " k"]
    c: float
    held_out: HeldOut | None


def products_of(
    problem: LinearProblem, active: Int[Array, " k"], scalings: tuple[Scaling, ...], held_out: bool
) -> Products:
    """Products of the columns of one fit; rows with a gain are rescaled.

    Args:
        problem: Products of all columns.
        active: Indices of the columns of the fit.
        scalings: The fitted gains, at most one for each row.
        held_out: True if the products by fold are needed.
    """
    grams = problem.grams
    a, b = problem.total_a[active[:, None], active], problem.total_b[active]
    c = float(grams.c[grams.fold >= 0].sum())
    if not scalings:
        return Products(a, b, c, _held_out(problem, active) if held_out else None)
    for scaling in scalings:
        in_row, places, gain_place, coefficients = _gain_parts(problem, active, scaling)
        row, trains = grams.rows[scaling.row], grams.fold >= 0
        row_a = grams.train_a.of_row(scaling.row, in_row)[0]
        row_b, row_c = row.b[trains][:, in_row].sum(axis=0), float(row.c[trains].sum())
        new_a, new_b, new_c = _rescale(
            row_a[None], row_b[None], np.array([row_c]), coefficients, gain_place, scaling.gain
        )
        a[places[:, None], places] += new_a[0] - row_a
        b[places] += new_b[0] - row_b
        c += float(new_c[0]) - row_c
    return Products(a, b, c, _held_out_rescaled(problem, active, scalings) if held_out else None)


def _gain_parts(
    problem: LinearProblem, active: Int[Array, " k"], scaling: Scaling
) -> tuple[Int[Array, " m"], Int[Array, " m"], int, Float[Array, " m"]]:
    """Columns and coefficients of one row for `_rescale`.

    Returns:
        in_row: Positions of the row's active columns among the columns of the row, ``(m,)``.
        places: Positions of the same columns in ``active``, ``(m,)``.
        gain_place: Position of the gain's column in these two arrays.
        coefficients: Coefficients of these columns whose sum is the torque of the current fit, ``(m,)``.
    """
    in_row, places = problem.grams.fold_a.in_row(scaling.row, active)
    gain_place = int(np.searchsorted(active[places], scaling.column))
    coefficients = scaling.theta[active[places]]
    coefficients[gain_place] = 1.0
    return in_row, places, gain_place, coefficients


def _held_out_rescaled(problem: LinearProblem, active: Int[Array, " k"], scalings: tuple[Scaling, ...]) -> HeldOut:
    """Products by fold, and held-out losses, with rescaled rows."""
    grams = problem.grams
    fold_a, fold_b = grams.fold_a.among(active), grams.fold_b[:, active]
    for scaling in scalings:
        row = grams.rows[scaling.row]
        in_row, places, gain_place, coefficients = _gain_parts(problem, active, scaling)
        place = slice(None), places[:, None], places[None, :]
        row_a, row_b = grams.fold_a.of_row(scaling.row, in_row), grams.by_fold(row.b[:, in_row])
        new_a, new_b, _ = _rescale(row_a, row_b, grams.by_fold(row.c), coefficients, gain_place, scaling.gain)
        fold_a[place] += new_a - row_a
        fold_b[:, places] += new_b - row_b

    def losses(x: Float[Array, "B k"]) -> Float[Array, " B"]:
        out = _losses(problem, active, x)
        for scaling in scalings:
            out += _row_losses(problem, active, scaling, x)
        return out

    return HeldOut(fold_a, fold_b, losses)


def _held_out(problem: LinearProblem, active: Int[Array, " k"]) -> HeldOut:
    """Products by fold, and held-out losses, without any gain."""
    grams = problem.grams
    return HeldOut(grams.fold_a.among(active), grams.fold_b[:, active], lambda x: _losses(problem, active, x))


def _losses(problem: LinearProblem, active: Int[Array, " k"], x: Float[Array, "B k"]) -> Float[Array, " B"]:
    """Weighted squared residual of the core of each block, with its own coefficients for each block."""
    grams = problem.grams
    return grams.core_c - 2 * np.einsum("bk,bk->b", grams.core_b[:, active], x) + grams.core_a.squares(active, x)


def _row_losses(
    problem: LinearProblem, active: Int[Array, " k"], scaling: Scaling, x: Float[Array, "B k"]
) -> Float[Array, " B"]:
    """Change of the loss of each block by a gain on one row.

    Each rescaled column is a linear combination of the given columns. The coefficients ``x`` of the rescaled columns
    are therefore converted to coefficients of the given columns.
    """
    row, core_a = problem.grams.rows[scaling.row], problem.grams.core_a
    in_row, places, gain_place, coefficients = _gain_parts(problem, active, scaling)
    excess, own = scaling.gain - 1.0, x[:, places]
    converted = scaling.gain * own + own[:, gain_place : gain_place + 1] * coefficients
    converted[:, gain_place] = own[:, gain_place]
    line, column = row.core_b[:, in_row], core_a.column_of_row(scaling.row, in_row, gain_place)
    square = core_a.squares_of_row(scaling.row, in_row, converted) - core_a.squares_of_row(scaling.row, in_row, own)
    cross = np.einsum("bk,bk->b", line - excess * column, converted) - np.einsum("bk,bk->b", line, own)
    return square - 2 * cross - 2 * excess * line[:, gain_place] + excess**2 * column[:, gain_place]


def _rescale(
    a: Float[Array, "B k k"],
    b: Float[Array, "B k"],
    c: Float[Array, " B"],
    coefficients: Float[Array, " k"],
    gain_place: int,
    gain: float,
) -> tuple[Array, Array, Array]:
    """Products ``a``, ``b`` and ``c`` of a row after its columns and residual are rescaled.

    The columns are multiplied by the gain, the gain's column is replaced by the sum of all columns times
    ``coefficients``, and ``gain - 1`` times the old gain's column is subtracted from the residual.
    """
    with_residual = b - (gain - 1.0) * a[:, :, gain_place]
    new_c = c - 2 * (gain - 1.0) * b[:, gain_place] + (gain - 1.0) ** 2 * a[:, gain_place, gain_place]
    with_sum = a @ coefficients
    new_b = gain * with_residual
    new_b[:, gain_place] = with_residual @ coefficients
    new_a = gain**2 * a
    new_a[:, :, gain_place] = new_a[:, gain_place, :] = gain * with_sum
    new_a[:, gain_place, gain_place] = with_sum @ coefficients
    return new_a, new_b, new_c
