"""Blocks of equations -> `Reduction`, with as few columns as the data allow.

The rows of a joint of a serial chain touch the bodies beyond it only, so each joint has its own factor on its own
columns. Of these, many are combinations of others whatever the motion. The first rows tell which; from then on only
the others are taken in, and random combinations of the columns left out watch, in every row, that they stay what the
first rows said. Where they do not, nothing is lost: the factor is widened by the relation that held so far, and the
rows that broke it are taken in with all columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.reduction import Reduction
from identification.reduction_columns import dependent_columns
from identification.reduction_factor import ROWS, absorb, one_blas_thread, triangular

Array = np.ndarray

_EXACT = 1e-10
"""A column is left out if the others make it up to this share of the largest column of its unit: ten thousand times
below what counts as a parameter of its own, ten thousand times above rounding."""

_HOLDS = 1e-9
"""The relation is broken if a random combination that should be zero is above this share of one that should not."""

_PROBES = 4  # a relation that breaks by 1e-6 escapes all of four with a probability of 1e-12
_ATTEMPTS = 4  # relations that broke so often are not looked for any more


@dataclass(frozen=True)
class _Lean:
    """Columns that are taken in, and how the others follow."""

    places: tuple[Array, ...]  # by joint: which of its columns are taken in
    widen: tuple[Array, ...]  # by joint: from the columns taken in and the torque to all and the torque
    probes: Array  # combinations of all columns, all but the last of which are zero, ``(p, 5)``
    samples: int  # that it rests on


def reduce_blocks(
    names: tuple[str, ...],
    units: tuple[str, ...],
    joint_names: tuple[str, ...],
    columns: tuple[tuple[int, ...], ...],
    blocks: Iterable[tuple[Float[Array, "_ nv p"], Float[Array, "_ nv"]]],
) -> Reduction:
    """Triangular factors of equations that come in blocks, which are not kept.

    Args:
        names: Of the ``p`` columns.
        units: Of the columns.
        joint_names: Of the rows of a sample.
        columns: By joint, the columns that its torque can depend on, ascending.
        blocks: Columns ``(n, nv, p)`` and torque ``(n, nv)`` of n samples each.
    """
    own = tuple(np.array(c, dtype=int) for c in columns)
    factors = [np.zeros((len(c) + 1, len(c) + 1), order="F") for c in own]
    lean: _Lean | None = None
    samples = attempts = 0
    with one_blas_thread():
        for block, y in blocks:
            for start in range(0, len(block), ROWS):
                part, torque = block[start : start + ROWS], y[start : start + ROWS]
                if lean is None and 0 < samples and attempts < _ATTEMPTS:
                    lean, attempts = _leaner(factors, own, names, units, samples), attempts + 1
                    factors = _narrow(factors, lean)
                if lean is not None and not _holds(lean, part):
                    factors, lean = _wide(factors, lean), None
                for joint, factor in enumerate(factors):
                    place = slice(None) if lean is None else lean.places[joint]
                    absorb(factor, _rows(part, torque, joint, own[joint][place]))
                samples += len(part)
        if lean is not None:
            factors = _wide(factors, lean)
    return Reduction(names, units, joint_names, columns, tuple(factors), samples)


def _rows(block: Array, torque: Array, joint: int, columns: Array) -> Array:
    rows = np.empty((len(block), len(columns) + 1), order="F")
    rows[:, :-1] = block[:, joint, columns]
    rows[:, -1] = torque[:, joint]
    return rows


def _leaner(factors: Sequence[Array], own: Sequence[Array], names: Sequence[str], units: Sequence[str], samples: int):
    """Columns to go on with, from what has been taken in with all of them."""
    p = len(names)
    stacked = np.zeros((sum(len(factor) for factor in factors), p))
    row = 0
    for columns, factor in zip(own, factors, strict=True):
        stacked[row : row + len(factor), columns] = factor[:, :-1]
        row += len(factor)
    kept, dependent, grouping, scale = dependent_columns(triangular(stacked), units, _EXACT)
    # Everything in terms of all p columns: widening, and what is zero because of it.
    relation = np.zeros((p, p))
    relation[kept, kept] = 1.0
    relation[np.ix_(kept, dependent)] = grouping
    rng = np.random.default_rng(0)
    zero = np.zeros((p, _PROBES))
    draws = rng.standard_normal((len(dependent), _PROBES)) / scale[dependent, None]
    zero[dependent] = draws
    zero[kept] = -grouping @ draws
    probes = np.column_stack([zero, rng.standard_normal(p) / scale])
    places, widen = [], []
    for columns in own:
        place = np.flatnonzero(np.isin(columns, kept))
        places.append(place)
        wide = np.zeros((len(place) + 1, len(columns) + 1))
        wide[:-1, :-1] = relation[np.ix_(columns[place], columns)]
        wide[-1, -1] = 1.0
        widen.append(wide)
    return _Lean(tuple(places), tuple(widen), probes, samples)


def _narrow(factors: Sequence[Array], lean: _Lean) -> list[Array]:
    return [triangular(factor[:, [*place, -1]]) for factor, place in zip(factors, lean.places, strict=True)]


def _wide(factors: Sequence[Array], lean: _Lean) -> list[Array]:
    return [triangular(factor @ wide) for factor, wide in zip(factors, lean.widen, strict=True)]


def _holds(lean: _Lean, block: Array) -> bool:
    """False where a column left out is not, in some row, what the columns taken in say."""
    seen = block.reshape(-1, block.shape[2]) @ lean.probes
    *zero, size = np.einsum("nk,nk->k", seen, seen)
    return bool(max(zero) <= _HOLDS**2 * (size + len(block) / lean.samples))
