"""Choice of the terms of a formula: stepwise least squares over groups of columns, with exchanges.

Orthogonal least squares: in each step the term that lowers the squares most is added, by its part that is orthogonal to
those that are in; then every term is exchanged for a better one where there is one. All of it works on products of the
columns, summed over blocks, so that the same choice is made again on other blocks at no cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Float, Int

Array = np.ndarray
Chosen = tuple[int, ...]

_RANK = 1e-5  # part of a column's squares that has to be left beside those that are in
_RIDGE = 1e-9  # of a column's squares


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


@dataclass(frozen=True)
class Products:
    """Products of columns and residual over some blocks.

    Attributes:
        gram: Of the columns, ``(C, C)``.
        right: Of the columns with the residual, ``(C,)``.
        total: Of the residual with itself.
    """

    gram: Float[Array, "C C"]
    right: Float[Array, " C"]
    total: float

    def fitted(self, columns: list[int]) -> Float[Array, " k"]:
        """Least squares coefficients of some columns."""
        part = self.gram[np.ix_(columns, columns)]
        return np.linalg.solve(part + _RIDGE * np.diag(np.diag(part)), self.right[columns])

    def left(self, columns: list[int], coefficients: Float[Array, " k"]) -> float:
        """Sum of squares that given coefficients leave."""
        part = self.gram[np.ix_(columns, columns)]
        return float(self.total - 2 * self.right[columns] @ coefficients + coefficients @ part @ coefficients)


@dataclass(frozen=True)
class Free:
    """The last columns, which every fit has, with a quadratic prior on their coefficients.

    Attributes:
        precision: Of the prior, ``(F, F)``.
        right: Precision times its mean, ``(F,)``.
    """

    precision: Float[Array, "F F"]
    right: Float[Array, " F"]

    @property
    def count(self) -> int:
        """How many columns."""
        return len(self.right)

    def taken_out(self, products: Products) -> Products:
        """Products of the other columns with what these ones can make taken out."""
        n = len(products.right) - self.count
        if self.count == 0:
            return products
        between, mine = products.gram[:n, n:], self._normal(products)
        right = products.right[n:] + self.right
        through = solve(mine, np.column_stack([between.T, right]))
        return Products(
            products.gram[:n, :n] - between @ through[:, :-1],
            products.right[:n] - between @ through[:, -1],
            float(products.total - right @ through[:, -1]),
        )

    def beside(self, products: Products, columns: list[int], theta: Float[Array, " k"]) -> Float[Array, " F"]:
        """Their coefficients beside given ones of other columns."""
        n = len(products.right) - self.count
        if self.count == 0:
            return np.zeros(0)
        right = products.right[n:] + self.right - products.gram[n:, columns] @ theta
        return solve(self._normal(products), right)

    def _normal(self, products: Products) -> Float[Array, "F F"]:
        n = len(products.right) - self.count
        return products.gram[n:, n:] + self.precision


@dataclass(frozen=True)
class BlockProducts:
    """The same for each block.

    Attributes:
        gram: ``(B, C, C)``.
        right: ``(B, C)``.
        total: ``(B,)``.
    """

    gram: Float[Array, "B C C"]
    right: Float[Array, "B C"]
    total: Float[Array, " B"]

    def summed(self, counts: Float[Array, " B"]) -> Products:
        """Of all blocks, each as often as ``counts`` says."""
        gram = np.tensordot(counts, self.gram, axes=1)
        return Products(gram, counts @ self.right, float(counts @ self.total))

    def of(self, columns: list[int]) -> BlockProducts:
        """The same of some columns."""
        at = np.array(columns, dtype=int)
        return BlockProducts(self.gram[:, at[:, None], at], self.right[:, at], self.total)

    def freed(self, counts: Float[Array, " B"], free: Free) -> Products:
        """The same of the columns but the last, which are fitted beside every choice and so taken out."""
        return free.taken_out(self.summed(counts))

    def block(self, k: int) -> Products:
        """Of one block."""
        return Products(self.gram[k], self.right[k], float(self.total[k]))


def block_products(
    x: Float[Array, "n C"], y: Float[Array, " n"], weight: Float[Array, " n"], blocks: Int[Array, " n"], count: int
) -> BlockProducts:
    """Products of each block.

    Args:
        x: Columns.
        y: Residual.
        weight: What each sample counts.
        blocks: Of each sample, -1 for none.
        count: Number of blocks.
    """
    gram, right, total = np.zeros((count, x.shape[1], x.shape[1])), np.zeros((count, x.shape[1])), np.zeros(count)
    root = np.sqrt(weight)
    for k in range(count):
        use = (blocks == k) & (weight > 0)
        xb, yb = x[use] * root[use, None], y[use] * root[use]
        gram[k], right[k], total[k] = xb.T @ xb, xb.T @ yb, yb @ yb
    return BlockProducts(gram, right, total)


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
    """Chosen terms with none to ``most`` others added to given ones, which stay; without given ones as `stepwise`."""
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
    """What each term lowers the squares beside those that are chosen."""
    gram, right = products.gram, products.right
    size = np.diag(gram).copy()
    kept, rest, cross = size.copy(), right.copy(), gram[terms.first, terms.second].copy()
    columns = terms.columns(chosen)
    if columns:
        part = gram[np.ix_(columns, columns)]
        reach = np.linalg.solve(part + _RIDGE * np.diag(np.diag(part)), gram[columns])
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
