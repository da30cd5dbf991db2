"""Products of the columns of one model with a fitted gain on the measured torque of a row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.engine.fits.problem import LinearProblem
from phantom_dyn.array_types import Float, Int

Array = np.ndarray


@dataclass(frozen=True)
class Scaling:
    """A fitted gain on one row, as of a wrong torque constant: the measured torque is ``gain`` times the true one.

    The row's columns are multiplied by the current gain, and the column of the gain is the torque of the current fit
    instead of the given model's. At convergence the fit is exact in the gain.

    Attributes:
        row: Number of the row.
        column: Column of the gain: the torque of the given model.
        gain: Current estimate.
        theta: Coefficients of the current fit, that of the gain zero, ``(K,)``.
    """

    row: int
    column: int
    gain: float
    theta: Float[Array, " K"]


@dataclass(frozen=True)
class HeldOut:
    """Products of the columns of one model for fits without one fold each, and for their held-out losses.

    Attributes:
        a, b: Of each fold, ``(F, k, k)`` and ``(F, k)``.
        losses: Weighted squared residual of the core of each block, ``(B,)``, for coefficients of its own, ``(B, k)``.
    """

    a: Float[Array, "F k k"]
    b: Float[Array, "F k"]
    losses: Callable[[Float[Array, "B k"]], Float[Array, " B"]]


@dataclass(frozen=True)
class Products:
    """Products of the columns of one model: over all blocks that train, and by fold if they are needed."""

    a: Float[Array, "k k"]
    b: Float[Array, " k"]
    c: float
    held_out: HeldOut | None


def products_of(
    problem: LinearProblem, active: Int[Array, " k"], scalings: tuple[Scaling, ...], held_out: bool
) -> Products:
    """Products of the active columns; rows with a gain are rescaled."""
    grams = problem.grams
    a, b = problem.total_a[active[:, None], active], problem.total_b[active]
    c = float(grams.c[grams.fold >= 0].sum())
    if not scalings:
        return Products(a, b, c, _held_out(problem, active) if held_out else None)
    for scaling in scalings:
        local, at, own, mix = _mixed(problem, active, scaling)
        row, trains = grams.rows[scaling.row], grams.fold >= 0
        row_a = grams.train_a.of_row(scaling.row, local)[0]
        row_b, row_c = row.b[trains][:, local].sum(axis=0), float(row.c[trains].sum())
        new_a, new_b, new_c = _rescale(row_a[None], row_b[None], np.array([row_c]), mix, own, scaling.gain)
        a[at[:, None], at] += new_a[0] - row_a
        b[at] += new_b[0] - row_b
        c += float(new_c[0]) - row_c
    return Products(a, b, c, _held_out_rescaled(problem, active, scalings) if held_out else None)


def _mixed(
    problem: LinearProblem, active: Int[Array, " k"], scaling: Scaling
) -> tuple[Int[Array, " m"], Int[Array, " m"], int, Float[Array, " m"]]:
    """Places of the active columns in a row and among all, place of the gain's column, and factors that make it up."""
    local, at = problem.grams.fold_a.in_row(scaling.row, active)
    own = int(np.searchsorted(active[at], scaling.column))
    mix = scaling.theta[active[at]]
    mix[own] = 1.0
    return local, at, own, mix


def _held_out_rescaled(problem: LinearProblem, active: Int[Array, " k"], scalings: tuple[Scaling, ...]) -> HeldOut:
    """Products by fold, and losses of blocks; rows with a gain are rescaled."""
    grams = problem.grams
    fold_a, fold_b = grams.fold_a.among(active), grams.fold_b[:, active]
    for scaling in scalings:
        row = grams.rows[scaling.row]
        local, at, own, mix = _mixed(problem, active, scaling)
        place = slice(None), at[:, None], at[None, :]
        row_a, row_b = grams.fold_a.of_row(scaling.row, local), grams.by_fold(row.b[:, local])
        new_a, new_b, _ = _rescale(row_a, row_b, grams.by_fold(row.c), mix, own, scaling.gain)
        fold_a[place] += new_a - row_a
        fold_b[:, at] += new_b - row_b

    def losses(x: Float[Array, "B k"]) -> Float[Array, " B"]:
        out = _losses(problem, active, x)
        for scaling in scalings:
            out += _row_losses(problem, active, scaling, x)
        return out

    return HeldOut(fold_a, fold_b, losses)


def _held_out(problem: LinearProblem, active: Int[Array, " k"]) -> HeldOut:
    """Products by fold, and losses of blocks, without any gain."""
    grams = problem.grams
    return HeldOut(grams.fold_a.among(active), grams.fold_b[:, active], lambda x: _losses(problem, active, x))


def _losses(problem: LinearProblem, active: Int[Array, " k"], x: Float[Array, "B k"]) -> Float[Array, " B"]:
    """Weighted squared residual of the core of each block, for coefficients of its own."""
    grams = problem.grams
    return grams.core_c - 2 * np.einsum("bk,bk->b", grams.core_b[:, active], x) + grams.core_a.squares(active, x)


def _row_losses(
    problem: LinearProblem, active: Int[Array, " k"], scaling: Scaling, x: Float[Array, "B k"]
) -> Float[Array, " B"]:
    """Change of the loss of each block by a gain on one row.

    The rescaled columns are sums of the row's own, so that their coefficients are turned into those of its own columns.
    """
    row, core_a = problem.grams.rows[scaling.row], problem.grams.core_a
    local, at, own, mix = _mixed(problem, active, scaling)
    more, given = scaling.gain - 1.0, x[:, at]
    turned = scaling.gain * given + given[:, own : own + 1] * mix
    turned[:, own] = given[:, own]
    line, column = row.core_b[:, local], core_a.column_of_row(scaling.row, local, own)
    square = core_a.squares_of_row(scaling.row, local, turned) - core_a.squares_of_row(scaling.row, local, given)
    cross = np.einsum("bk,bk->b", line - more * column, turned) - np.einsum("bk,bk->b", line, given)
    return square - 2 * cross - 2 * more * line[:, own] + more**2 * column[:, own]


def _rescale(
    a: Float[Array, "B k k"],
    b: Float[Array, "B k"],
    c: Float[Array, " B"],
    mix: Float[Array, " k"],
    own: int,
    gain: float,
) -> tuple[Array, Array, Array]:
    """Products of a row's columns times the gain, its column ``own`` replaced by all columns times ``mix``.

    The residual is less ``gain - 1`` times column ``own``.
    """
    moved = b - (gain - 1.0) * a[:, :, own]
    square = c - 2 * (gain - 1.0) * b[:, own] + (gain - 1.0) ** 2 * a[:, own, own]
    mixed, line, mixed_line = a @ mix, gain * moved, moved @ mix
    line[:, own] = mixed_line
    out = gain**2 * a
    out[:, :, own] = out[:, own, :] = gain * mixed
    out[:, own, own] = mixed @ mix
    return out, line, square
