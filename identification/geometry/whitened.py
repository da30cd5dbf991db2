"""Pose equations divided by their noise, and the estimate of the noise.

The noise of each series is the residual of a fit of all terms (the best kinematic model). Poses whose noise is
correlated in time have less weight. Residuals on held-out blocks are computed from products of columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.engine.autocorrelation import integrated_autocorrelation_time, lagged_products, positive_sequence
from identification.engine.numerics.spans import orthogonal_part, orthonormal
from identification.engine.products.block_products import BlockProducts, block_products, held_out_residual
from identification.geometry.equations import Equations
from identification.regression.base_parameters import base_parameters_of_matrix
from phantom_dyn.array_types import Array, Bool, Float, Int

LEAST_INDEPENDENT_SHARE = 1e-5
"""A column counts as a combination of nuisances if less than this share of it is orthogonal to them. Smaller shares are
rounding errors: angles in robot files have nine digits at best."""
BLOCKS = 10
"""Number of blocks of each recording; each block is held out of one fit."""
_ROUNDS = 4  # number of fits in which the noise is estimated; each is weighted with the noise of the fit before
_FEWEST = 8  # least number of poses of a motion from which the correlation time of the noise is estimated


@dataclass(frozen=True)
class Noise:
    """Noise of poses.

    Attributes:
        sigma: Standard deviation of each coordinate, by series [m or rad].
        correlation_time: Number of poses per independent pose, by series; variances of estimates grow by this factor.
        degrees_of_freedom: Degrees of freedom of the estimate of the noise.
    """

    sigma: Float[Array, " s"]
    correlation_time: Float[Array, " s"]
    degrees_of_freedom: float

    @property
    def weights(self) -> Float[Array, " s"]:
        """One over the noise, by series."""
        return 1.0 / self.sigma


@dataclass(frozen=True)
class Whitened:
    """Pose equations in units of the noise.

    Attributes:
        residual: Residual, projected off the nuisances, ``(m,)``.
        columns: Columns of the terms, projected off the nuisances, ``(m, p)``.
        independent: False for terms whose column is a combination of nuisances, ``(p,)``.
        whole: Columns of nuisances and terms, and the residual, not projected, ``(m, k + p + 1)``.
        block: Block of each row.
        rank: Number of base kinematic parameters.
    """

    residual: Float[Array, " m"]
    columns: Float[Array, "m p"]
    independent: Bool[Array, " p"]
    whole: Float[Array, "m w"]
    block: Int[Array, " m"]
    rank: int

    @property
    def nuisances(self) -> int:
        """Number of columns that are always in the fit."""
        return self.whole.shape[1] - self.columns.shape[1] - 1


def base_columns(columns: Float[Array, "m p"], units: Sequence[str], names: Sequence[str]) -> Int[Array, " r"]:
    """Indices of linearly independent columns (base kinematic parameters), found as for base inertial parameters.

    Args:
        columns: Columns of the terms, projected off the nuisances.
        units: Units of the terms.
        names: Names of the terms.
    """
    found = base_parameters_of_matrix(columns, tuple(names), tuple(units), tolerance=LEAST_INDEPENDENT_SHARE)
    return np.array(found.independent, dtype=int)


def noise_of(
    linearised: Equations,
    units: Sequence[str],
    names: Sequence[str],
    moving: Bool[Array, " s"],
    kept: Bool[Array, " m"],
) -> Noise:
    """Noise of each series, from the residual of a fit of all terms.

    Args:
        linearised: Equations linearised at some estimate.
        units: Units of the terms.
        names: Names of the terms.
        moving: True for series of poses of a motion, whose noise may be correlated in time.
        kept: True for rows that are used.
    """
    count = len(moving)
    size = np.array([_rms(linearised.residual[kept & (linearised.series == s)]) for s in range(count)])
    sigma, residual, rank = np.where(size > 0, size, 1.0), linearised.residual, 0
    for _ in range(_ROUNDS):
        scale = kept / sigma[linearised.series]
        basis = orthonormal(linearised.nuisance * scale[:, None], 1e-9)
        own = orthogonal_part(linearised.columns * scale[:, None], basis)
        whole = np.hstack([basis, orthonormal(own[:, base_columns(own, units, names)], LEAST_INDEPENDENT_SHARE)])
        rank = whole.shape[1]
        residual = orthogonal_part(linearised.residual * scale, whole) * sigma[linearised.series]
        free_share = max(1.0 - rank / max(kept.sum(), 1), 1.0 / max(kept.sum(), 1))
        size = np.array([_rms(residual[kept & (linearised.series == s)]) for s in range(count)]) / np.sqrt(free_share)
        sigma = np.where(size > 0, size, 1.0)
    times = np.array([_correlation_time(residual, linearised, s) if moving[s] else 1.0 for s in range(count)])
    return Noise(sigma, times, max(float(kept.sum() - rank), 1.0) / float(times.max(initial=1.0)))


def _rms(values: Array) -> float:
    """RMS of values; zero if there are none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _correlation_time(residual: Array, linearised: Equations, series: int) -> float:
    """Number of poses per independent pose, from the autocorrelation of the residual, summed over the axes."""
    values = residual[linearised.series == series].reshape(-1, 3)
    n = len(values)
    if n < _FEWEST:
        return 1.0
    products = np.sum([lagged_products(axis) for axis in (values - values.mean(axis=0)).T], axis=0)
    return integrated_autocorrelation_time(positive_sequence(products[: n // 2]))


def whitened(
    linearised: Equations,
    values: Float[Array, " p"],
    noise: Noise,
    block: Int[Array, " m"],
    kept: Bool[Array, " m"],
    named: tuple[Sequence[str], Sequence[str]],
) -> Whitened:
    """Equations in units of the noise; their residual is the one without any term.

    Args:
        linearised: Equations linearised at an estimate.
        values: Values of the terms at the estimate. The columns times these values are added to the residual.
        noise: Noise of the poses.
        block: Block of each row.
        kept: True for rows that are used.
        named: Units and names of the terms.
    """
    scale = (kept / (noise.sigma * np.sqrt(noise.correlation_time))[linearised.series])[kept]
    rows = linearised.rows(kept)
    nuisance, columns = rows.nuisance * scale[:, None], rows.columns * scale[:, None]
    residual = rows.residual * scale + columns @ values
    basis = orthonormal(nuisance, 1e-9)
    own = orthogonal_part(columns, basis)
    size = np.linalg.norm(columns, axis=0)
    independent = np.linalg.norm(own, axis=0) > LEAST_INDEPENDENT_SHARE * np.where(size > 0, size, 1.0)
    own = np.where(independent, own, 0.0)
    rank = len(base_columns(own, *named))
    whole = np.hstack([nuisance, columns, residual[:, None]])
    return Whitened(orthogonal_part(residual, basis), own, independent, whole, block[kept], rank)


@dataclass(frozen=True)
class Blocks:
    """Products of nuisances, terms and residual, by block of poses.

    Attributes:
        products: Products in units of the noise, nuisances first.
        rows: Number of rows of each block.
        nuisances: Number of columns that are always in the fit.
    """

    products: BlockProducts
    rows: Float[Array, " B"]
    nuisances: int

    def losses(self, chosen: Sequence[int]) -> Float[Array, " B"]:
        """Squared residual of each block, predicted by a fit to the other blocks, in units of the noise variance."""
        return self.products.losses(self.columns(chosen))

    def columns(self, chosen: Sequence[int]) -> list[int]:
        """Indices of the columns of a fit of some terms: the nuisances, then the terms."""
        return [*range(self.nuisances), *(self.nuisances + k for k in chosen)]


def blocks_of(equations: Whitened) -> Blocks:
    """Products of each block of poses."""
    _, block, rows = np.unique(equations.block, return_inverse=True, return_counts=True)
    products = block_products(equations.whole[:, :-1], equations.whole[:, -1], np.ones(len(block)), block, len(rows))
    return Blocks(products, rows.astype(float), equations.nuisances)


def held_out_residual_of_rows(equations: Whitened, blocks: Blocks, chosen: Sequence[int]) -> Float[Array, " m"]:
    """Residual of each row, predicted by a fit to the other blocks, in units of the noise."""
    at = blocks.columns(chosen)
    place = np.searchsorted(np.unique(equations.block), equations.block)
    return held_out_residual(
        equations.whole[:, at], equations.whole[:, -1], place, blocks.products.fits_without_each(at)
    )
