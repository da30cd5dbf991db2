"""Base parameters: the independent columns of a regressor, and the regrouping of the dependent columns into them.

The choice of columns is deterministic: they are tested in their order, and a column is kept if it is not a linear
combination of the columns that were kept before it. The test uses the triangular factor of the regressor, which does
not depend on the order of the rows. Pivoting is not used, as its order changes with small noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.regression.reduction import Reduction
from identification.regression.regressor import Regressor
from identification.regression.triangular import dependent_columns, r_factor
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.errors import ParameterError

RANK_TOLERANCE = 1e-6
"""A column counts as independent if its part orthogonal to the columns before it exceeds this share of the largest
column of the same unit. Angles in robot files are often rounded to nine digits, which causes columns of relative size
1e-9 that no recording excites. Measured torques are accurate to 1e-3 at best."""

_SHOWN = 1e-8  # smaller terms of a regrouping, relative to the column, are rounding errors (at most about 1e-10)


@dataclass(frozen=True)
class BaseParameters:
    """Independent columns, and the regrouping of the dependent columns into them.

    Attributes:
        names: Names of all ``p`` columns.
        units: Units of all columns.
        independent: The ``r`` independent columns, ascending.
        dependent: All other columns, ascending.
        zero: Dependent columns without torque in any sample.
        grouping: ``W[:, dependent] == W[:, independent] @ grouping``, shape ``(r, p - r)``.
        norms: Norms of all columns.
        singular_values: Singular values of the independent columns, each column divided by its norm; shape ``(r,)``,
            descending.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    independent: tuple[int, ...]
    dependent: tuple[int, ...]
    zero: tuple[int, ...]
    grouping: Float[Array, "r d"]
    norms: Float[Array, " p"]
    singular_values: Float[Array, " r"]

    @property
    def rank(self) -> int:
        """Number ``r`` of base parameters."""
        return len(self.independent)

    @property
    def condition(self) -> float:
        """Condition number of the independent columns, each divided by its norm; nan for rank zero."""
        return float(self.singular_values[0] / self.singular_values[-1]) if self.rank else np.nan

    @property
    def base_names(self) -> tuple[str, ...]:
        """Names of the base parameters, with an ``R`` at the end if other parameters are regrouped into it."""
        regrouped = [bool(row.any()) for row in self.regrouped]
        return tuple(
            f"{self.names[k]}R" if more else self.names[k] for k, more in zip(self.independent, regrouped, strict=True)
        )

    @property
    def base_units(self) -> tuple[str, ...]:
        """Units of the base parameters."""
        return tuple(self.units[k] for k in self.independent)

    @property
    def regrouped(self) -> Bool[Array, "r d"]:
        """True where a dependent column is part of a base parameter, shape ``(r, d)``; rounding errors are left out."""
        size = np.abs(self.grouping) * self.norms[list(self.independent)][:, None]
        # A column of rounding errors only could be written as any combination of others.
        torque = np.array([k not in self.zero for k in self.dependent], dtype=bool)
        return (size > _SHOWN * self.norms[list(self.dependent)][None, :]) & torque[None, :]

    def values(self, pi: Float[Array, " p"]) -> Float[Array, " r"]:
        """Base parameters for given values of all ``p`` parameters."""
        if len(pi) != len(self.names):
            raise ParameterError(f"{len(pi)} values were given for {len(self.names)} parameters: give one for each.")
        return pi[list(self.independent)] + self.grouping @ pi[list(self.dependent)]

    def regroupings(self) -> tuple[str, ...]:
        """One equation per base parameter with regrouped parameters, such as ``a.IzzR = a.Izz + 0.25 b.m``."""
        return tuple(f"{self.base_names[row]} = {whole}" for row, whole in self.sums().items())

    def sums(self) -> dict[int, str]:
        """The sum that each base parameter with regrouped parameters stands for, as ``{2: "a.Izz + 0.25 b.m"}``.

        The key is its index among all base parameters.
        """
        shown = self.regrouped
        return {
            row: self.names[self.independent[row]]
            + "".join(_signed(self.grouping[row, k], self.names[self.dependent[k]]) for k in np.flatnonzero(shown[row]))
            for row in range(self.rank)
            if shown[row].any()
        }


def base_parameters(regressor: Regressor) -> BaseParameters:
    """Base parameters of a regressor for its own samples."""
    return base_of_reduction(regressor.reduction)


def base_of_reduction(reduction: Reduction) -> BaseParameters:
    """Base parameters that the equations of one recording, or of several, determine."""
    return base_parameters_of_matrix(reduction.factor()[:, :-1], reduction.names, reduction.units)


def base_parameters_of_matrix(
    W: Float[Array, "m p"],
    names: Sequence[str],
    units: Sequence[str] | None = None,
    *,
    tolerance: float = RANK_TOLERANCE,
) -> BaseParameters:
    """Base parameters of a stacked regressor, or of its triangular factor.

    Args:
        W: Rows of torque, shape ``(m, p)``.
        names: Name of each column.
        units: Unit of each column; columns are compared with columns of the same unit. None to compare all columns.
        tolerance: Smallest relative part of an independent column, see `RANK_TOLERANCE`.

    Raises:
        ParameterError: If the numbers of names, units and columns differ, or a value is not finite.
    """
    p = W.shape[1]
    given = ("",) * p if units is None else tuple(units)
    if len(names) != p or len(given) != p:
        raise ParameterError(f"{p} columns came with {len(names)} names and {len(given)} units: give one for each.")
    if not np.isfinite(W).all():
        raise ParameterError("The regressor holds values that are not finite: give finite motion.")
    factor = r_factor([W])
    norms = np.linalg.norm(factor, axis=0)
    independent, dependent, grouping, scale = dependent_columns(factor, given, tolerance)
    kept = factor[:, independent] / norms[independent]
    return BaseParameters(
        tuple(names),
        given,
        tuple(independent.tolist()),
        tuple(dependent.tolist()),
        tuple(k for k in dependent.tolist() if norms[k] <= tolerance * scale[k]),
        grouping,
        norms,
        np.linalg.svd(kept, compute_uv=False),
    )


def _signed(coefficient: float, name: str) -> str:
    """A term of a sum, such as `` + 0.25 b.m``."""
    size = f"{abs(coefficient):.6g}"
    return f" {'-' if coefficient < 0 else '+'} {'' if size == '1' else size + ' '}{name}"
