"""Criteria of optimal experiment design: functions of the information matrix, with exact derivatives.

The information matrix of the base parameters is :math:`G = W^T W / N` for N samples, plus that of earlier recordings.
Each column of the regressor W is divided by its size in an ordinary motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.number_checks import require_not_negative, require_positive

_SMALLEST_NORM = 1e-200  # smaller squared norms of a column are replaced, so that the inverse does not overflow
_ROUNDING = 1e-15
"""Smaller eigenvalues of a correlation matrix are rounding errors. Condition numbers above 3e7 are therefore not
distinguished."""


@runtime_checkable
class Criterion(Protocol):
    """A cost that is lower for a better experiment."""

    def cost(self, G: Float[Array, "r r"]) -> tuple[float, Float[Array, "r r"]]:
        """Cost, and its symmetric derivative by the entries of the information matrix."""
        ...


@dataclass(frozen=True)
class DOptimality:
    """Mean logarithm of the parameters' standard deviations, ``-log det(G + regularisation) / (2 r)``.

    ``regularisation`` is prior information, relative to the information of an ordinary motion. It keeps the cost and
    its derivative finite for a motion that does not excite all parameters.
    """

    regularisation: float = 1e-6

    def __post_init__(self):
        require_positive(regularisation=self.regularisation)

    def cost(self, G: Float[Array, "r r"]) -> tuple[float, Float[Array, "r r"]]:
        """Cost and its derivative."""
        r = len(G)
        regular = G + self.regularisation * np.eye(r)
        return float(-0.5 / r * np.linalg.slogdet(regular)[1]), -0.5 / r * np.linalg.inv(regular)


@dataclass(frozen=True)
class ConditionNumber:
    """Logarithm of the condition number of the regressor, each column divided by its norm.

    The largest and the smallest eigenvalue are replaced by power means of order ``sharpness``, because the condition
    number has no derivative if eigenvalues are equal. D-optimality with the weight ``information`` is added, because
    the condition number may be constant, as for a robot with one parameter.
    """

    sharpness: float = 6.0
    information: float = 0.01

    def __post_init__(self):
        require_positive(sharpness=self.sharpness)
        require_not_negative(weight_of_information=self.information)

    def cost(self, G: Float[Array, "r r"]) -> tuple[float, Float[Array, "r r"]]:
        """Cost and its derivative."""
        from scipy.special import logsumexp

        size = np.sqrt(np.maximum(np.diag(G), _SMALLEST_NORM))
        C = G / np.outer(size, size)
        eigenvalues, vectors = np.linalg.eigh(C)
        logs, k = np.log(np.maximum(eigenvalues, _ROUNDING)), self.sharpness
        high, low = logsumexp(k * logs), logsumexp(-k * logs)
        weights = 0.5 * (np.exp((k - 1) * logs - high) - np.exp((-k - 1) * logs - low))
        of_C = (vectors * weights) @ vectors.T
        of_G = of_C / np.outer(size, size) - np.diag(np.einsum("ij,ji->i", of_C, C) / size**2)
        cost, slope = DOptimality().cost(G) if self.information else (0.0, 0.0)
        return float(0.5 * (high + low) / k + self.information * cost), of_G + self.information * slope


def condition_number(G: Float[Array, "r r"]) -> float:
    """Condition number of the regressor whose information matrix is G, each column divided by its norm.

    It is infinite if a column is zero or a combination of the others, and NaN if there is no column.
    """
    if not len(G):
        return float("nan")
    size = np.sqrt(np.diag(G))
    if not (size > 0).all():
        return float("inf")
    eigenvalues = np.linalg.eigvalsh(G / np.outer(size, size))
    return float(np.sqrt(eigenvalues[-1] / eigenvalues[0])) if eigenvalues[0] > _ROUNDING else float("inf")
