"""Choice of groups of columns one by one: orthogonal least squares with exchanges.

In each step the group that lowers the squares most is added, by its part that is orthogonal to the chosen ones; then
every group is exchanged for a better one where there is one. All of it works on products of the columns, summed over
blocks, so that repeating the choice on other blocks costs next to nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.engine.products.block_products import RIDGE, Products
from phantom_dyn.array_types import Array, Float, Int

Chosen = tuple[int, ...]

_RANK = 1e-5  # share of a column's squares that has to be orthogonal to the chosen ones


@dataclass(frozen=True)
class Terms:
    """Which columns each term has: one, or two that belong together as sine and cosine do.

    Attributes:
        first: First column of each term, ``(K,)``.
        second: Second column; the first again where there is none, ``(K,)``.
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
    """Given terms with 0 to ``most`` further ones, chosen as by `stepwise`."""
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
    """The same number of terms, each exchanged for a better one beside the others while that helps."""
    left = squares(terms, products, chosen)
    for _ in range(3 if len(chosen) > 1 else 0):
        before = left
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            gain = gains(terms, products, others)
            tried = (*others[:place], int(np.argmax(gain)), *others[place:])
            now = squares(terms, products, tried)
            if now < left:
                chosen, left = tried, now
        if left >= before * (1 - 1e-9):
            break
    return chosen


def squares(terms: Terms, products: Products, chosen: Chosen) -> float:
    """Sum of squares that a least squares fit of some terms leaves."""
    columns = terms.columns(chosen)
    return products.left(columns, products.fitted(columns)) if columns else products.total


def gains(terms: Terms, products: Products, chosen: Chosen) -> Float[Array, " K"]:
    """Decrease of the sum of squares by each term beside the chosen ones."""
    gram, right = products.gram, products.right
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
