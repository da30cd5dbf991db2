"""A recording reduced to one small triangular factor per joint: all that a least-squares fit needs of it.

The factor of ``[W y]`` of each joint is kept apart, on the columns that its torque can depend on: then joints can be
weighted after the fact, and the standard deviations know which joint tells what. Reductions of several recordings are
stacked (`combined`): one is added or removed, or given another weight, without going back to the recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identification.reduction_factor import triangular
from phantom_dyn.errors import ParameterError

Array = np.ndarray


@dataclass(frozen=True)
class Reduction:
    """Triangular factors of the equations of one recording, or of several.

    Attributes:
        names: Of all ``p`` columns.
        units: Of all columns.
        joint_names: One per row of a sample.
        columns: By joint, the columns that its torque can depend on, ascending; all others are zero in its rows.
        factors: By joint, ``R`` with ``R^T R = [W_j y_j]^T [W_j y_j]`` on these columns and the torque behind them,
            upper triangular, shape ``(c + 1, c + 1)``.
        samples: Rows of each joint.
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
        """Of each joint, rows with the same products as its equations: ``columns``, then the torque.

        Args:
            columns: Some of the ``p`` columns, in the order wanted.
        """
        out = []
        for own, factor in zip(self.columns, self.factors, strict=True):
            place = {column: k for k, column in enumerate(own)}
            wide = np.zeros((len(factor), len(columns) + 1))
            here = [k for k, column in enumerate(columns) if column in place]
            wide[:, here] = factor[:, [place[columns[k]] for k in here]]
            wide[:, -1] = factor[:, -1]
            out.append(wide)
        return out

    def factor(self) -> Float[Array, "q q"]:
        """Triangular factor of ``[W y]`` of all joints, ``(p + 1, p + 1)``."""
        return triangular(np.concatenate(self.rows(range(len(self.names)))))

    def weighted(self, weights: float | Float[Array, " nv"]) -> Reduction:
        """The same equations times a weight: one for all, or one per joint, such as 1 over its noise.

        Args:
            weights: Not negative and finite.

        Raises:
            ParameterError: If a weight is negative or not finite, or there is not one per joint.
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

    A recording is taken out again by combining the others: nothing is subtracted, so nothing is lost to rounding. One
    counts more or less with ``combined([a, b.weighted(0.5)])``.

    Args:
        reductions: At least one, all of the same columns and joints.

    Raises:
        ParameterError: If there is none, or their columns or joints differ.
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
        factors.append(triangular(np.concatenate([_joint_rows(one, joint, union) for one in reductions])))
    samples = sum(one.samples for one in reductions)
    return Reduction(first.names, first.units, first.joint_names, tuple(columns), tuple(factors), samples)


def _joint_rows(reduction: Reduction, joint: int, columns: Sequence[int]) -> Array:
    factor = reduction.factors[joint]
    rows = np.zeros((len(factor), len(columns) + 1))
    rows[:, np.searchsorted(columns, reduction.columns[joint])] = factor[:, :-1]
    rows[:, -1] = factor[:, -1]
    return rows
