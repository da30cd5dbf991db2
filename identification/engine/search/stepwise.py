"""Chooses groups of columns one by one: orthogonal least squares with exchanges.

Each step adds the group that lowers the sum of squares most. Then each chosen group is exchanged for another one if
that lowers the sum further. Only products of the columns, summed over blocks, are needed, so that the choice can be
repeated on other blocks at little cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.engine.products.block_products import RIDGE, Products
from phantom_dyn.array_types import Array, Float, Int

Chosen = tuple[int, ...]

_RANK = 1e-5  # least share of a column's squares that is orthogonal to the chosen columns: less is rounding


@dataclass(frozen=True)
class Terms:
    """Columns of each term: one, or two that belong together, such as a sine and a cosine.

    Attributes:
        first: First column of each term, ``(K,)``.
        second: Second column, or the first again if the term has one only, ``(K,)``.
    """

    first: Int[Array, " K"]
    second: Int[Array, " K"]

    def columns(self, chosen: Chosen) -> list[int]:
        """Columns of some terms."""
        return list(dict.fromkeys(int(k) for term in chosen for k in (self.first[term], self.second[term])))


def stepwise(terms: Terms, products: Products, most: int) -> list[Chosen]:
    """Chosen terms at every size from one to ``most``, each after exchanges."""
    out: list[Chosen] = []
    chosen: Chosen = ()
    for _ in range(most):
        gain = gains(terms, products, chosen)
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        chosen = _exchanged(terms, products, (*chosen, best))
        out.append(chosen)
    return out


def extended(terms: Terms, products: Products, start: Chosen, most: int) -> list[Chosen]:
    """The given terms with 0 to ``most`` further ones, added without exchanges; without given terms, as `stepwise`."""
    if not start:
        return [(), *stepwise(terms, products, most)]
    out = [start]
    for _ in range(most):
        gain = gains(terms, products, out[-1])
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        out.append((*out[-1], best))
    return out


def _exchanged(terms: Terms, products: Products, chosen: Chosen) -> Chosen:
    """The chosen terms after exchanges of single terms that lower the sum of squares, in at most three rounds."""
    left = residual_squares(terms, products, chosen)
    for _ in range(3 if len(chosen) > 1 else 0):
        before = left
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            gain = gains(terms, products, others)
            tried = (*others[:place], int(np.argmax(gain)), *others[place:])
            now = residual_squares(terms, products, tried)
            if now < left:
                chosen, left = tried, now
        if left >= before * (1 - 1e-9):
            break
    return chosen


def residual_squares(terms: Terms, products: Products, chosen: Chosen) -> float:
    """Sum of squares that a least squares fit of some terms leaves."""
    columns = terms.columns(chosen)
    return products.left(columns, products.fitted(columns)) if columns else products.total


def gains(terms: Terms, products: Products, chosen: Chosen) -> Float[Array, " K"]:
    """Decrease of the sum of squares by each term in addition to the chosen ones, which have zero."""
    gram, right = products.gram, products.right
    # For the parts of the columns that are orthogonal to the chosen ones: their squares, their products with the
    # residual, and the product of the two columns of each term.
    size = np.diag(gram).copy()
    kept, rest, cross = size.copy(), right.copy(), gram[terms.first, terms.second].copy()
    columns = terms.columns(chosen)
    if columns:
        part = gram[np.ix_(columns, columns)]
        reach = np.linalg.solve(part + RIDGE * np.diag(np.diag(part)), gram[columns])
        kept -= np.einsum("kc,kc->c", gram[columns], reach)
        rest -= reach.T @ right[columns]
        cross -= np.einsum("kt,kt->t", gram[columns][:, terms.first], reach[:, terms.second])
    a, b = terms.first, terms.second
    good = kept[a] > _RANK * np.maximum(size[a], 1e-300)
    safe = np.where(good, kept[a], 1.0)
    gain = np.where(good, rest[a] ** 2 / safe, 0.0)
    beyond = kept[b] - cross**2 / safe
    pair = good & (a != b) & (beyond > _RANK * np.maximum(size[b], 1e-300))
    more = (rest[b] - cross / safe * rest[a]) ** 2 / np.where(pair, beyond, 1.0)
    gain += np.where(pair, more, 0.0)
    gain[list(chosen)] = 0.0
    return gain
