"""Chooses terms (one or two columns each) one by one: orthogonal least squares with exchanges.

Each step adds the term that lowers the sum of squared residuals most; this decrease is the term's gain. Then each
chosen term is exchanged for another one if the exchange lowers the sum further. Only products of the columns, summed
over blocks, are needed, so that the choice can be repeated on other blocks at little cost.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.engine.products.block_products import RIDGE, SummedProducts
from phantom_dyn.array_types import Array, Float, Int

Chosen = tuple[int, ...]

# A column counts as linearly dependent on the chosen ones if less than this share of its square is orthogonal to them.
_RANK = 1e-5


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


def stepwise(terms: Terms, products: SummedProducts, most: int) -> list[Chosen]:
    """The chosen terms for each number of terms from one to ``most``, each after exchanges."""
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


def extended(terms: Terms, products: SummedProducts, start: Chosen, most: int) -> list[Chosen]:
    """The given terms, followed by sets with one to ``most`` further terms, added without exchanges.

    Without given terms the sets are those of `stepwise`.
    """
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


def _exchanged(terms: Terms, products: SummedProducts, chosen: Chosen) -> Chosen:
    """The chosen terms after exchanges of single terms that lower the sum of squares, in at most three rounds."""
    lowest = residual_squares(terms, products, chosen)
    for _ in range(3 if len(chosen) > 1 else 0):
        before = lowest
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            gain = gains(terms, products, others)
            tried = (*others[:place], int(np.argmax(gain)), *others[place:])
            now = residual_squares(terms, products, tried)
            if now < lowest:
                chosen, lowest = tried, now
        if lowest >= before * (1 - 1e-9):
            break
    return chosen


def residual_squares(terms: Terms, products: SummedProducts, chosen: Chosen) -> float:
    """Sum of squares of the residual after a least-squares fit of some terms."""
    columns = terms.columns(chosen)
    return products.left(columns, products.fitted(columns)) if columns else products.total


def gains(terms: Terms, products: SummedProducts, chosen: Chosen) -> Float[Array, " K"]:
    """Decrease of the sum of squares by each term in addition to the chosen ones; zero for chosen terms, ``(K,)``."""
    gram, right = products.gram, products.right
    # Of the parts of the columns that are orthogonal to the chosen columns: their squares, their products with the
    # residual, and the product of the two columns of each term.
    full_square = np.diag(gram).copy()
    square, slope, cross = full_square.copy(), right.copy(), gram[terms.first, terms.second].copy()
    columns = terms.columns(chosen)
    if columns:
        part = gram[np.ix_(columns, columns)]
        coefficients = np.linalg.solve(part + RIDGE * np.diag(np.diag(part)), gram[columns])
        square -= np.einsum("kc,kc->c", gram[columns], coefficients)
        slope -= coefficients.T @ right[columns]
        cross -= np.einsum("kt,kt->t", gram[columns][:, terms.first], coefficients[:, terms.second])
    first, second = terms.first, terms.second
    independent = square[first] > _RANK * np.maximum(full_square[first], 1e-300)
    first_square = np.where(independent, square[first], 1.0)
    gain = np.where(independent, slope[first] ** 2 / first_square, 0.0)
    # The second column adds the gain of its part that is orthogonal to the first one.
    second_square = square[second] - cross**2 / first_square
    has_second = independent & (first != second) & (second_square > _RANK * np.maximum(full_square[second], 1e-300))
    second_slope = slope[second] - cross / first_square * slope[first]
    gain += np.where(has_second, second_slope**2 / np.where(has_second, second_square, 1.0), 0.0)
    gain[list(chosen)] = 0.0
    return gain
