r"""Ordinary least squares for given columns, with the statistics of equations (3) to (7) of the CEA paper.

The paper has two misprints: in (4) the noise has :math:`E(\rho \rho^T) = \sigma^2 I_r`, not :math:`E(\rho^T \rho)`,
which is a number; and (5) is :math:`\hat\sigma^2 = \|Y - W \hat X\|^2 / (r - b)`, with a square that the paper lacks.
`identification.estimators` has estimators for any robot and for autocorrelated noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import IdentifiabilityError, ParameterError

# Columns of norm one are dependent if a singular value is below this share of the largest one.
_SINGULAR = 1e-10


@dataclass(frozen=True)
class LinearFit:
    """Least-squares estimate of the unknowns of a linear model.

    Attributes:
        names: Names of the unknowns.
        units: Units of the unknowns.
        theta: Estimates, shape ``(b,)``.
        cov: Covariance if the noise of all rows has the same variance, (6), shape ``(b, b)``.
        sigma: Standard deviation of the noise of the rows, (5) corrected.
        condition: Condition number of W in SI units, as in the paper.
        scaled_condition: Condition number of W with columns of norm one, which does not depend on units.
        rows: Number of equations r.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    theta: Float[Array, " b"]
    cov: Float[Array, "b b"]
    sigma: float
    condition: float
    scaled_condition: float
    rows: int

    def std(self) -> Float[Array, " b"]:
        """Standard deviations, shape ``(b,)``."""
        return np.sqrt(np.diag(self.cov))

    def relative_std(self) -> Float[Array, " b"]:
        """Standard deviations divided by the sizes of the values, (7) [%]; infinite for a value of zero."""
        with np.errstate(divide="ignore"):
            return 100 * self.std() / np.abs(self.theta)

    def value(self, name: str) -> tuple[float, float]:
        """Estimate and standard deviation of one unknown.

        Raises:
            ParameterError: If the fit has no unknown with this name.
        """
        if name not in self.names:
            raise ParameterError(f"The fit has no unknown {name!r}: its unknowns are {', '.join(self.names)}.")
        k = self.names.index(name)
        return float(self.theta[k]), float(self.std()[k])


def fit_linear(
    W: Float[Array, "r b"], y: Float[Array, " r"], names: Sequence[str], units: Sequence[str], *, memory: float = 1.0
) -> LinearFit:
    """Least-squares solution of ``W X = y``.

    Args:
        W: One column per unknown.
        y: Right-hand side.
        names: Names of the unknowns.
        units: Units of the unknowns.
        memory: Number of rows per independent row, more than one if the noise is filtered.

    Raises:
        IdentifiabilityError: If there are no more equations than unknowns, or columns depend on each other.
    """
    r, b = W.shape
    if r <= b:
        raise IdentifiabilityError(f"{r} equations are too few for {b} unknowns and their deviations: record more.")
    norms = np.linalg.norm(W, axis=0)
    factor = np.asarray(np.linalg.qr(np.column_stack([W, y]), mode="r"))
    scaled = np.linalg.svd(factor[:b, :b] / np.where(norms > 0, norms, 1.0), compute_uv=False)
    if scaled[-1] <= _SINGULAR * scaled[0]:
        raise IdentifiabilityError(
            f"The motion does not part the unknowns {', '.join(names)}: one column is a combination of the others, or "
            "zero; record a motion that excites each."
        )
    inverse = np.linalg.inv(factor[:b, :b])
    sigma = float(np.abs(factor[b, b])) / np.sqrt(r - b)
    plain = np.linalg.svd(factor[:b, :b], compute_uv=False)
    return LinearFit(
        tuple(names),
        tuple(units),
        inverse @ factor[:b, b],
        memory * sigma**2 * inverse @ inverse.T,
        sigma,
        float(plain[0] / plain[-1]),
        float(scaled[0] / scaled[-1]),
        r,
    )


def without_nuisance(columns: Float[Array, "r b"], nuisance: Float[Array, "r k"]) -> Float[Array, "r b"]:
    """The residual of ``columns`` after a least-squares fit of ``nuisance`` columns.

    Args:
        columns: Columns or right-hand sides.
        nuisance: Columns whose coefficients are not of interest; they may be linearly dependent.
    """
    return columns - nuisance @ np.linalg.lstsq(nuisance, columns, rcond=None)[0]
