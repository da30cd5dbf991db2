"""Held-out errors of poses, by blocks, as products for the engine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.engine.products.block_products import BlockProducts, block_products, left_of_each
from identification.geometry.whitened import Whitened
from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class Blocks:
    """Products of nuisances, terms and residual, by block of poses.

    Attributes:
        products: In units of noise, nuisances first.
        rows: Of each block.
        nuisances: Number of columns that are always in the fit.
    """

    products: BlockProducts
    rows: Float[Array, " B"]
    nuisances: int

    def losses(self, chosen: Sequence[int]) -> Float[Array, " B"]:
        """Squared residuals of each block by a fit of the others, in units of noise."""
        return self.products.losses(self.columns(chosen))

    def columns(self, chosen: Sequence[int]) -> list[int]:
        """Columns of a fit of some terms, the nuisances among them."""
        return [*range(self.nuisances), *(self.nuisances + k for k in chosen)]


def blocks_of(found: Whitened) -> Blocks:
    """Products of each block of poses."""
    _, block, rows = np.unique(found.block, return_inverse=True, return_counts=True)
    weight = np.ones(len(block))
    products = block_products(found.whole[:, :-1], found.whole[:, -1], weight, block, len(rows))
    return Blocks(products, rows.astype(float), found.nuisances)


def left_of_rows(found: Whitened, blocks: Blocks, chosen: Sequence[int]) -> Float[Array, " m"]:
    """Residual of each row by fits of the other blocks, in units of noise."""
    at = blocks.columns(chosen)
    place = np.searchsorted(np.unique(found.block), found.block)
    return left_of_each(found.whole[:, at], found.whole[:, -1], place, blocks.products.without_each(at))
