"""Searches for the few columns that explain a residual: a beam search over sets, in which each column has a price.

The price of a column is the decrease of the sum of squares that the column may cause by chance. Residual and columns
are projected off the nuisances (columns of every fit) first, so that the fit of a set is a small linear system. If the
columns depend on the fitted coefficients, `until_same_set` recomputes the columns after each search and repeats the
search.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float

State = TypeVar("State")
Chosen = tuple[int, ...]

_BEAM = 8  # number of sets that are extended in each step
_MOST = 20  # largest number of columns of a set
_MOST_WITHOUT_GAIN = 2  # after more steps in a row without a better set the search ends
_TIE = 1e-8  # costs are rounded to this share of the total square, so that sets of equal columns have equal costs
_LEAST_EIGENVALUE = 1e-9  # of the products of normalised columns; below it the columns count as linearly dependent
_ROUNDS = 5  # largest number of searches in `until_same_set`


@dataclass(frozen=True)
class SetFits:
    """Products of residual and columns, from which the fit of any set of columns is computed in microseconds.

    Residual and columns are in units of the noise, and projected off the nuisances.

    Attributes:
        products: Products of the columns with each other, ``(p, p)``.
        slopes: Products of the columns with the residual, ``(p,)``.
        total: Sum of squares of the residual.
        lower: Least value of each coefficient, ``(p,)``; a set with a smaller coefficient is not allowed.
        upper: Largest value of each coefficient, ``(p,)``.
        independent: Indices of the columns that are not linear combinations of nuisances.
    """

    products: Float[Array, "p p"]
    slopes: Float[Array, " p"]
    total: float
    lower: Float[Array, " p"]
    upper: Float[Array, " p"]
    independent: Chosen

    def values(self, chosen: Sequence[int]) -> Float[Array, " k"] | None:
        """Least-squares coefficients of some columns; None if the columns are linearly dependent."""
        at = list(chosen)
        products = self.products[np.ix_(at, at)]
        size = np.sqrt(np.diag(products))
        scaled = products / np.outer(size, size)
        if len(at) > 1 and np.linalg.eigvalsh(scaled)[0] < _LEAST_EIGENVALUE:
            return None
        return np.linalg.solve(scaled, self.slopes[at] / size) / size

    def squares(self, chosen: Sequence[int]) -> float:
        """Sum of squares of the residual after a fit of some columns; infinite if a coefficient violates a bound."""
        at = list(chosen)
        if not at:
            return self.total
        values = self.values(at)
        if values is None or np.any(values < self.lower[at]) or np.any(values > self.upper[at]):
            return np.inf
        return self.total - float(self.slopes[at] @ values)


def set_fits(
    columns: Float[Array, "m p"],
    residual: Float[Array, " m"],
    bounds: tuple[Float[Array, " p"], Float[Array, " p"]],
    independent: Bool[Array, " p"],
) -> SetFits:
    """Products for the fits of all sets of columns.

    Args:
        columns: Columns in units of the noise, projected off the nuisances.
        residual: Residual in units of the noise, projected off the nuisances.
        bounds: Least and largest coefficient of each column.
        independent: False for columns that are linear combinations of nuisances.
    """
    return SetFits(
        columns.T @ columns,
        columns.T @ residual,
        float(residual @ residual),
        *bounds,
        tuple(np.flatnonzero(independent).tolist()),
    )


def few_columns(fits: SetFits, price: float) -> Chosen:
    """The set of columns with the lowest cost: sum of squares plus the price of its columns.

    Args:
        fits: Products of the columns.
        price: Price of a column.

    Returns:
        Indices of the columns in ascending order; of equal columns the first.
    """
    best: tuple[float, Chosen] = (_rounded_cost(fits, (), price), ())
    front: list[Chosen] = [()]
    steps_without_gain = 0
    for _ in range(min(_MOST, len(fits.independent))):
        sets = {tuple(sorted((*chosen, k))) for chosen in front for k in fits.independent if k not in chosen}
        scored = sorted((_rounded_cost(fits, chosen, price), chosen) for chosen in sets)
        scored = [one for one in scored if np.isfinite(one[0])]
        if not scored:
            break
        front = [chosen for _, chosen in scored[:_BEAM]]
        steps_without_gain += 1
        if scored[0][0] < best[0]:
            best, steps_without_gain = scored[0], 0
        if steps_without_gain > _MOST_WITHOUT_GAIN:
            break
    return _improved_by_exchange(fits, best[1], price)


def _improved_by_exchange(fits: SetFits, chosen: Chosen, price: float) -> Chosen:
    """The set after columns are removed or exchanged as long as this lowers its cost."""
    while chosen:
        others = [k for k in fits.independent if k not in chosen]
        smaller = [tuple(x for x in chosen if x != k) for k in chosen]
        exchanged = [tuple(sorted((*kept, other))) for kept in smaller for other in others]
        value, trial = min((_rounded_cost(fits, trial, price), trial) for trial in [*smaller, *exchanged])
        if value >= _rounded_cost(fits, chosen, price):
            return chosen
        chosen = trial
    return chosen


def _rounded_cost(fits: SetFits, chosen: Sequence[int], price: float) -> float:
    """Sum of squares plus prices of a set, rounded so that sets of equal columns have equal costs."""
    value, grain = fits.squares(chosen) + price * len(chosen), max(_TIE * fits.total, 1e-6)
    return float(np.round(value / grain)) * grain if np.isfinite(value) else np.inf


def rivals_of(fits: SetFits, chosen: Chosen, group: Chosen, near: float) -> list[Chosen]:
    """Rivals of a group of columns: the group with one column exchanged, if this raises the sum of squares only little.

    Args:
        fits: Products of the columns.
        chosen: All columns that were found.
        group: Some of the columns that were found, such as those of one joint.
        near: Increase of the sum of squares below which an exchanged group is a rival.
    """
    rest, limit = tuple(k for k in chosen if k not in group), fits.squares(chosen) + near
    out = []
    for removed in group:
        kept = tuple(k for k in group if k != removed)
        for other in fits.independent:
            trial = tuple(sorted((*kept, other)))
            if other not in chosen and fits.squares((*rest, *trial)) < limit:
                out.append(trial)
    return out


def until_same_set(
    state: State, search: Callable[[State, int], tuple[State, Chosen]], recompute: Callable[[State, Chosen], State]
) -> tuple[State, Chosen]:
    """Repeat a search, each time with columns recomputed at the fit of the set found, until it finds the same set.

    The repetition also ends if a search returns to an earlier set, or after five searches. It takes at least three
    searches, because the second may leave out outliers, and a return to an earlier set counts only from the fourth on.

    Args:
        state: Initial state, with the columns of the first search.
        search: Function from a state and the number of earlier searches to a new state and the set found.
        recompute: Function from a state and a set to the state with columns computed at the fit of that set.

    Returns:
        The last state and the last set.
    """
    chosen: Chosen = ()
    tried: list[Chosen] = []
    for earlier_rounds in range(_ROUNDS):
        state, found = search(state, earlier_rounds)
        if (found == chosen and earlier_rounds > 1) or (found in tried[:-1] and earlier_rounds > 2):
            break
        chosen = found
        tried.append(found)
        state = recompute(state, chosen)
    return state, chosen
