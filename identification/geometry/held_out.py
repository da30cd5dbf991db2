"""Errors of poses that no fit has seen, by blocks, and how probable sets of terms are when blocks are drawn again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.geometry.whitened import Whitened
from phantom_dyn.array_types import Float, Int
from phantom_dyn.random_streams import random_stream

Array = np.ndarray

_REPLICATES = 400
_RANK = 1e-12  # of products, whose columns have the size of one


@dataclass(frozen=True)
class Blocks:
    """Products of all columns and what is left, by block of poses.

    Attributes:
        products: Shape ``(B, w, w)``; the last column is what is left.
        rows: Of each block.
        nuisances: Number of columns that are always in the fit.
    """

    products: Float[Array, "B w w"]
    rows: Float[Array, " B"]
    nuisances: int

    def fits(self, chosen: Sequence[int]) -> Float[Array, "B c"]:
        """Numbers that fits without one block each give nuisances and terms."""
        at, total = self._columns(chosen), self.products.sum(axis=0)
        out = np.empty((len(self.products), len(at)))
        for b, own in enumerate(self.products):
            rest = total - own
            matrix, right = rest[np.ix_(at, at)], rest[at, -1]
            size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
            out[b] = np.linalg.lstsq(matrix / np.outer(size, size), right / size, rcond=_RANK)[0] / size
        return out

    def losses(self, chosen: Sequence[int]) -> Float[Array, " B"]:
        """Squares of each block that a fit of the others leaves, in units of noise."""
        at = self._columns(chosen)
        out = np.empty(len(self.products))
        for b, (own, values) in enumerate(zip(self.products, self.fits(chosen), strict=True)):
            out[b] = own[-1, -1] - 2 * values @ own[at, -1] + values @ own[np.ix_(at, at)] @ values
        return np.maximum(out, 0.0)

    def _columns(self, chosen: Sequence[int]) -> list[int]:
        return [*range(self.nuisances), *(self.nuisances + k for k in chosen)]


def blocks_of(found: Whitened) -> Blocks:
    """Products of each block of poses."""
    numbers = np.unique(found.block)
    parts = [found.whole[found.block == number] for number in numbers]
    return Blocks(
        np.array([part.T @ part for part in parts]), np.array([float(len(part)) for part in parts]), found.nuisances
    )


def left_of_each(found: Whitened, blocks: Blocks, chosen: Sequence[int]) -> Float[Array, " m"]:
    """What fits of the other blocks leave of each row, in units of noise."""
    at = [*range(blocks.nuisances), *(blocks.nuisances + k for k in chosen)]
    values = blocks.fits(chosen)
    place: Int[Array, " m"] = np.searchsorted(np.unique(found.block), found.block)
    return found.whole[:, -1] - np.einsum("mk,mk->m", found.whole[:, at], values[place])


def draws(count: int, use: str) -> Float[Array, "R B"]:
    """How often each block is drawn, in each replicate of a bootstrap."""
    rng = random_stream(use)
    return np.array([np.bincount(rng.integers(0, count, count), minlength=count) for _ in range(_REPLICATES)], float)


def wins(losses: Float[Array, "A B"]) -> Float[Array, " A"]:
    """Share of the replicates that each alternative wins; those that fit almost alike share each by likelihood.

    Args:
        losses: Of alternatives, by block, in units of noise.
    """
    from scipy.special import softmax

    drawn = draws(losses.shape[1], "bootstrap of rivals in poses") @ losses.T
    # Won by the lowest alone, a difference that lasts over the blocks would be certain though chance makes larger ones.
    return softmax(-0.5 * drawn, axis=1).mean(axis=0)
