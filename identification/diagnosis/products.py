"""Products of the columns of one model, with the torques of wrong torque constants rescaled."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from identification.diagnosis.problem import Problem

Array = np.ndarray


@dataclass(frozen=True)
class Scaling:
    """A wrong torque constant on one row: measured torque is ``gain`` times what the joint truly got.

    The row's columns are then seen times the gain, and the column of the torque constant is the true torque of the
    current fit instead of the given model's: a fit about this point is exact in the gain.

    Attributes:
        row: Which joint.
        column: The torque constant's column, which is the given model's torque.
        gain: Current estimate.
        theta: Coefficients of the current fit, that of the torque constant zero, ``(K,)``.
    """

    row: int
    column: int
    gain: float
    theta: Float[Array, " K"]


@dataclass(frozen=True)
class Products:
    """Products of the columns of one model: over all blocks that train, and block by block if they are needed."""

    a: Float[Array, "k k"]
    b: Float[Array, " k"]
    c: float
    blocks: tuple[Array, ...] | None


def products_of(problem: Problem, active: Int[Array, " k"], scalings: tuple[Scaling, ...], held_out: bool) -> Products:
    """Products of the active columns, with rows of wrong torque constants rescaled."""
    grams, grid = problem.grams, np.ix_(active, active)
    a, b = problem.total_a[grid], problem.total_b[active]
    if scalings:
        a, b = a.copy(), b.copy()
    blocks = None
    if held_out:
        blocks = (
            grams.a.among(active),
            grams.b[:, active],
            grams.core_a.among(active),
            grams.core_b[:, active],
            grams.core_c.copy(),
        )
    train = grams.fold >= 0
    c = float(grams.c[train].sum())
    for scaling in scalings:
        row = grams.rows[scaling.row]
        local = np.flatnonzero(np.isin(row.index, active))
        at = np.searchsorted(active, row.index[local])
        own = int(np.searchsorted(row.index[local], scaling.column))
        mix = scaling.gain * np.eye(len(local))
        mix[:, own] = scaling.theta[row.index[local]]
        mix[own, own] = 1.0
        square = (slice(None), local[:, None], local[None, :])
        place = (slice(None), at[:, None], at[None, :])
        row_a, row_b = row.a[square], row.b[:, local]
        new_a, new_b, new_c = _rescale(row_a, row_b, row.c, mix, own, scaling.gain)
        c += float((new_c - row.c)[train].sum())
        a[place[1:]] += (new_a - row_a)[train].sum(axis=0)
        b[at] += (new_b - row_b)[train].sum(axis=0)
        if blocks is not None:
            blocks[0][place] += new_a - row_a
            blocks[1][:, at] += new_b - row_b
            core_a, core_b = row.core_a[square], row.core_b[:, local]
            new_a, new_b, new_c = _rescale(core_a, core_b, row.core_c, mix, own, scaling.gain)
            blocks[2][place] += new_a - core_a
            blocks[3][:, at] += new_b - core_b
            blocks[4][:] += new_c - row.core_c
    return Products(a, b, c, blocks)


def _rescale(
    a: Float[Array, "B k k"],
    b: Float[Array, "B k"],
    c: Float[Array, " B"],
    mix: Float[Array, "k k"],
    own: int,
    gain: float,
) -> tuple[Array, Array, Array]:
    """Products of a row's columns mixed by ``mix`` with the residual less ``gain - 1`` times column ``own``."""
    moved = b - (gain - 1.0) * a[:, :, own]
    square = c - 2 * (gain - 1.0) * b[:, own] + (gain - 1.0) ** 2 * a[:, own, own]
    return mix.T @ a @ mix, moved @ mix, square


def reduced(
    a: Float[Array, "B n n"],
    b: Float[Array, "B n"],
    c: Float[Array, " B"],
    expand: Float[Array, "n k"],
    shift: Float[Array, " n"],
) -> tuple[Array, Array, Array]:
    """Products for ``x`` when the coefficients are ``expand @ x + shift``."""
    moved = b - a @ shift
    return expand.T @ a @ expand, moved @ expand, c - 2 * b @ shift + a @ shift @ shift
