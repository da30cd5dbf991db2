"""Reduces a recording to a small triangular factor per joint, from which least-squares fits are computed.

Each joint has its own factor of ``[W y]`` (QR decomposition), with the columns on which its torque can depend. Joints
can therefore be weighted later. Reductions of several recordings can be combined (`combined`), so that a recording is
added, removed or weighted without being read again.

`reduce_blocks` adds equations block by block. Many columns are linear combinations of others for any motion, and are
left out to save time:

1. The first rows determine the linear relations between the columns.
2. Then only the independent columns are added. Random combinations of the columns test whether the relations hold in
   every row.
3. If the relations do not hold in a block of rows, the factor is extended to all columns by the relations, and the
   block is added with all columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.regression.triangular import ROWS, absorb, dependent_columns, one_blas_thread, triangular
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.random_streams import random_stream

_DEPENDENCE = 1e-10
"""A column is left out if a combination of others equals it up to this share of the largest column of its unit. The
share is ten thousand times smaller than `RANK_TOLERANCE`, and ten thousand times larger than rounding errors."""

_LARGEST_PROBE = 1e-9
"""The relations are violated if a random combination that is zero by the relations exceeds this share of a random
combination that is not."""

_PROBES = 4  # number of combinations that are zero: all of them miss a violation of 1e-6 with a probability of 1e-12
_ATTEMPTS = 4  # the relations are determined at most this often; after that all columns are added


@dataclass(frozen=True)
class Reduction:
    """Triangular factors of the equations of one recording, or of several.

    Attributes:
        names: Names of all ``p`` columns.
        units: Units of all columns.
        joint_names: Names of the joints.
        columns: For each joint, the columns on which its torque can depend, ascending; others are zero in its rows.
        factors: For each joint, the upper triangular ``R`` with ``R^T R = [W_j y_j]^T [W_j y_j]``, where ``W_j`` are
            these columns and ``y_j`` is the torque, shape ``(c + 1, c + 1)``.
        samples: Number of rows of each joint.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    joint_names: tuple[str, ...]
    columns: tuple[tuple[int, ...], ...]
    factors: tuple[Float[Array, "_ _"], ...]
    samples: int

    def __post_init__(self):
        for factor in self.factors:
            factor.flags.writeable = False

    def rows(self, columns: Sequence[int]) -> list[Float[Array, "_ _"]]:
        """For each joint, few rows with the same Gram matrix as its equations: the chosen columns, then the torque.

        Args:
            columns: Some of the ``p`` columns, in any order.
        """
        return [self.rows_of_joint(joint, columns) for joint in range(len(self.factors))]

    def rows_of_joint(self, joint: int, columns: Sequence[int]) -> Float[Array, "_ _"]:
        """The rows of one joint, see `rows`; columns on which its torque does not depend are zero."""
        factor = self.factors[joint]
        place = {column: k for k, column in enumerate(self.columns[joint])}
        out = np.zeros((len(factor), len(columns) + 1))
        present = [k for k, column in enumerate(columns) if column in place]
        out[:, present] = factor[:, [place[columns[k]] for k in present]]
        out[:, -1] = factor[:, -1]
        return out

    def factor(self) -> Float[Array, "q q"]:
        """Triangular factor of ``[W y]`` of all joints, ``(p + 1, p + 1)``."""
        return triangular(np.concatenate(self.rows(range(len(self.names)))))

    def weighted(self, weights: float | Float[Array, " nv"]) -> Reduction:
        """The equations of each joint, multiplied by a weight.

        Args:
            weights: One weight for all joints, or one per joint, such as one over its noise.

        Raises:
            ParameterError: If a weight is negative or not finite, or the number of weights is wrong.
        """
        each = np.asarray(weights, dtype=float)
        if each.ndim > 1 or (each.ndim and len(each) != len(self.factors)):
            raise ParameterError(f"{each.shape} weights were given for {len(self.factors)} joints: give one for each.")
        if not np.isfinite(each).all() or (each < 0).any():
            raise ParameterError(f"A weight of {weights} was given: give finite ones that are not negative.")
        given = np.broadcast_to(each, len(self.factors))
        return replace(self, factors=tuple(w * factor for w, factor in zip(given, self.factors, strict=True)))


def combined(reductions: Sequence[Reduction]) -> Reduction:
    """The equations of several recordings of one robot as one reduction.

    To remove a recording, combine the others: a subtraction would lose digits. To weight a recording, use
    ``combined([a, b.weighted(0.5)])``.

    Args:
        reductions: One reduction or more, with the same columns and joints.

    Raises:
        ParameterError: If no reduction is given, or columns or joints differ.
    """
    if not reductions:
        raise ParameterError("No reduction was given: give at least one.")
    first = reductions[0]
    for k, other in enumerate(reductions):
        for what, mine, theirs in (
            ("columns", first.names, other.names),
            ("units", first.units, other.units),
            ("joints", first.joint_names, other.joint_names),
        ):
            if mine != theirs:
                lone = sorted(set(mine) ^ set(theirs))
                raise ParameterError(
                    f"Reduction number {k} has other {what} than the first ({', '.join(lone) or 'in another order'}): "
                    "reduce all recordings with the same robot and the same effects."
                )
    if len(reductions) == 1:
        return first
    columns, factors = [], []
    for joint in range(len(first.factors)):
        union = sorted({column for one in reductions for column in one.columns[joint]})
        columns.append(tuple(union))
        factors.append(triangular(np.concatenate([one.rows_of_joint(joint, union) for one in reductions])))
    samples = sum(one.samples for one in reductions)
    return Reduction(first.names, first.units, first.joint_names, tuple(columns), tuple(factors), samples)


@dataclass(frozen=True)
class _Relation:
    """The independent columns, which are kept, and the other columns as linear combinations of the kept ones.

    Attributes:
        places: For each joint, the positions of the kept columns among its columns.
        to_all: For each joint, the matrix that maps the kept columns and the torque to all columns and the torque.
        probes: Coefficients of random combinations of all columns, ``(p, 5)``. The first four combinations are zero
            where the relations hold; the last one gives the scale.
        samples: Number of samples from which the relations were determined.
    """

    places: tuple[Array, ...]
    to_all: tuple[Array, ...]
    probes: Array
    samples: int


def reduce_blocks(
    names: tuple[str, ...],
    units: tuple[str, ...],
    joint_names: tuple[str, ...],
    columns: tuple[tuple[int, ...], ...],
    blocks: Iterable[tuple[Float[Array, "_ nv p"], Float[Array, "_ nv"]]],
) -> Reduction:
    """Triangular factors of equations that are given block by block; blocks are not kept in memory.

    Args:
        names: Names of the ``p`` columns.
        units: Units of the columns.
        joint_names: Name of the joint of each of the ``nv`` rows of a sample.
        columns: For each joint, the columns on which its torque can depend, ascending.
        blocks: Columns ``(n, nv, p)`` and torque ``(n, nv)`` of n samples each.
    """
    columns_of_joints = tuple(np.array(c, dtype=int) for c in columns)
    factors = [np.zeros((len(c) + 1, len(c) + 1), order="F") for c in columns_of_joints]
    relation: _Relation | None = None
    samples = attempts = 0
    with one_blas_thread():
        for part, torque in _small_blocks(blocks):
            if relation is None and samples > 0 and attempts < _ATTEMPTS:
                attempts += 1
                relation = _relation_of(factors, columns_of_joints, names, units, samples)
                kept = zip(factors, relation.places, strict=True)
                factors = [triangular(factor[:, [*place, -1]]) for factor, place in kept]
            if relation is not None and not _is_satisfied(relation, part):
                factors, relation = _with_all_columns(factors, relation), None
            for joint, factor in enumerate(factors):
                place = slice(None) if relation is None else relation.places[joint]
                absorb(factor, _rows(part, torque, joint, columns_of_joints[joint][place]))
            samples += len(part)
        if relation is not None:
            factors = _with_all_columns(factors, relation)
    return Reduction(names, units, joint_names, columns, tuple(factors), samples)


def _small_blocks(blocks: Iterable[tuple[Array, Array]]) -> Iterator[tuple[Array, Array]]:
    """The blocks, divided into blocks of at most `ROWS` samples."""
    for block, torque in blocks:
        for start in range(0, len(block), ROWS):
            yield block[start : start + ROWS], torque[start : start + ROWS]


def _rows(block: Array, torque: Array, joint: int, columns: Array) -> Array:
    """Some columns of one joint in a block, with the torque in the last column."""
    rows = np.empty((len(block), len(columns) + 1), order="F")
    rows[:, :-1] = block[:, joint, columns]
    rows[:, -1] = torque[:, joint]
    return rows


def _relation_of(
    factors: Sequence[Array],
    columns_of_joints: Sequence[Array],
    names: Sequence[str],
    units: Sequence[str],
    samples: int,
) -> _Relation:
    """Independent columns and relations of the others to them, from the factors so far (with all columns)."""
    p = len(names)
    stacked = np.zeros((sum(len(factor) for factor in factors), p))
    row = 0
    for columns, factor in zip(columns_of_joints, factors, strict=True):
        stacked[row : row + len(factor), columns] = factor[:, :-1]
        row += len(factor)
    kept, dependent, grouping, scale = dependent_columns(triangular(stacked), units, _DEPENDENCE)
    # Matrix that maps the kept columns to all p columns.
    matrix = np.zeros((p, p))
    matrix[kept, kept] = 1.0
    matrix[np.ix_(kept, dependent)] = grouping
    # Random combinations of columns that are zero if the relations hold.
    rng = random_stream("probe of a reduction")
    zero = np.zeros((p, _PROBES))
    draws = rng.standard_normal((len(dependent), _PROBES)) / scale[dependent, None]
    zero[dependent] = draws
    zero[kept] = -grouping @ draws
    probes = np.column_stack([zero, rng.standard_normal(p) / scale])
    places, to_all = [], []
    for columns in columns_of_joints:
        place = np.flatnonzero(np.isin(columns, kept))
        places.append(place)
        of_joint = np.zeros((len(place) + 1, len(columns) + 1))
        of_joint[:-1, :-1] = matrix[np.ix_(columns[place], columns)]
        of_joint[-1, -1] = 1.0
        to_all.append(of_joint)
    return _Relation(tuple(places), tuple(to_all), probes, samples)


def _with_all_columns(factors: Sequence[Array], relation: _Relation) -> list[Array]:
    """Factors extended from the kept columns to all columns."""
    return [triangular(factor @ to_all) for factor, to_all in zip(factors, relation.to_all, strict=True)]


def _is_satisfied(relation: _Relation, block: Array) -> bool:
    """True if the relations hold in every row of a block."""
    combinations = block.reshape(-1, block.shape[2]) @ relation.probes
    *zero, size = np.einsum("nk,nk->k", combinations, combinations)
    # The second term is the mean size of as many samples before: all of those together have a size of order one.
    return bool(max(zero) <= _LARGEST_PROBE**2 * (size + len(block) / relation.samples))
