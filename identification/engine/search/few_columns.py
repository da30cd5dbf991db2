"""Search for the few columns that explain a residual: a beam over sets, each column at the price of chance.

Nuisances have been taken out of residual and columns, so that a fit of any set is a small system of products. Where the
columns depend on what was found, `until_same_set` takes them again at each set and searches again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float

State = TypeVar("State")
Chosen = tuple[int, ...]

_BEAM = 8
_MOST = 20
_PATIENCE = 2  # columns that a set may cost before it pays
_TIE = 1e-8  # of all squares: twins differ by less, through rounding
_APART = 1e-9  # least eigenvalue of products of columns of size one: less are combinations of each other
_ROUNDS = 5  # of taking columns again


@dataclass(frozen=True)
class SetFits:
    """Products of a residual and of columns in units of noise, nuisances taken out: fits of any set in microseconds.

    Attributes:
        products: Of the columns, ``(p, p)``.
        slopes: Of the columns with the residual, ``(p,)``.
        total: Square of the residual.
        lower, upper: Bounds of each coefficient; a set that ends beyond them explains nothing, ``(p,)``.
        seen: Places of the columns that leave something of their own beside the nuisances.
    """

    products: Float[Array, "p p"]
    slopes: Float[Array, " p"]
    total: float
    lower: Float[Array, " p"]
    upper: Float[Array, " p"]
    seen: Chosen

    def values(self, chosen: Sequence[int]) -> Float[Array, " k"] | None:
        """Best coefficients of some columns; None if they are combinations of each other."""
        at = list(chosen)
        products = self.products[np.ix_(at, at)]
        size = np.sqrt(np.diag(products))
        scaled = products / np.outer(size, size)
        if len(at) > 1 and np.linalg.eigvalsh(scaled)[0] < _APART:
            return None
        return np.linalg.solve(scaled, self.slopes[at] / size) / size

    def squares(self, chosen: Sequence[int]) -> float:
        """Squares that are left; infinite where a coefficient is beyond its bounds."""
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
    seen: Bool[Array, " p"],
) -> SetFits:
    """Products of columns and residual, from both of which the nuisances were taken out.

    Args:
        columns: In units of noise.
        residual: In units of noise.
        bounds: Least and largest coefficient of each column.
        seen: False for columns that leave nothing of their own.
    """
    return SetFits(
        columns.T @ columns,
        columns.T @ residual,
        float(residual @ residual),
        *bounds,
        tuple(np.flatnonzero(seen).tolist()),
    )


def few_columns(fits: SetFits, price: float) -> Chosen:
    """The set of columns with the least squares and prices together, ascending; of twins that which stands first.

    Args:
        fits: Products.
        price: Of a column.
    """
    best: tuple[float, Chosen] = (_rounded(fits, (), price), ())
    front: list[Chosen] = [()]
    waited = 0
    for _ in range(min(_MOST, len(fits.seen))):
        sets = {tuple(sorted((*chosen, k))) for chosen in front for k in fits.seen if k not in chosen}
        scored = sorted((_rounded(fits, chosen, price), chosen) for chosen in sets)
        scored = [one for one in scored if np.isfinite(one[0])]
        if not scored:
            break
        front = [chosen for _, chosen in scored[:_BEAM]]
        waited = 0 if scored[0][0] < best[0] else waited + 1
        best = min(best, scored[0]) if waited == 0 else best
        if waited > _PATIENCE:
            break
    return _swapped(fits, best[1], price)


def _swapped(fits: SetFits, chosen: Chosen, price: float) -> Chosen:
    """The set after all exchanges of a column, and all that can be spared, that pay."""
    while chosen:
        others = [k for k in fits.seen if k not in chosen]
        trials = [tuple(x for x in chosen if x != k) for k in chosen]
        trials += [tuple(sorted((*(x for x in chosen if x != k), other))) for k in chosen for other in others]
        value, trial = min((_rounded(fits, trial, price), trial) for trial in trials)
        if value >= _rounded(fits, chosen, price):
            return chosen
        chosen = trial
    return chosen


def _rounded(fits: SetFits, chosen: Sequence[int], price: float) -> float:
    """Squares and prices of a set, so that twins stay in their order and not in that of their rounding errors."""
    value, grain = fits.squares(chosen) + price * len(chosen), max(_TIE * fits.total, 1e-6)
    return float(np.round(value / grain)) * grain if np.isfinite(value) else np.inf


def rivals_of(fits: SetFits, chosen: Chosen, group: Chosen, near: float) -> list[Chosen]:
    """Sets that stand in the place of a group: the group with one of its columns exchanged for another one.

    Args:
        fits: Products.
        chosen: All columns that were found.
        group: Some of them.
        near: Squares by which a rival may fit worse.
    """
    rest, most = tuple(k for k in chosen if k not in group), fits.squares(chosen) + near
    out = []
    for gone in group:
        kept = tuple(k for k in group if k != gone)
        for other in fits.seen:
            trial = tuple(sorted((*kept, other)))
            if other not in chosen and fits.squares((*rest, *trial)) < most:
                out.append(trial)
    return out


def until_same_set(
    state: State, search: Callable[[State, int], tuple[State, Chosen]], retake: Callable[[State, Chosen], State]
) -> tuple[State, Chosen]:
    """The set of columns that a search finds again where the columns are taken at what it has found.

    Sets that come back in a circle end it too.

    Args:
        state: Where the columns are taken first.
        search: The state with what it needs for a search, and the set found, from the number of earlier rounds.
        retake: The state with columns taken at the fit of a set.
    """
    chosen: Chosen = ()
    tried: list[Chosen] = []
    for turn in range(_ROUNDS):
        state, now = search(state, turn)
        if (now == chosen and turn > 1) or (now in tried[:-1] and turn > 2):
            break
        chosen = now
        tried.append(now)
        state = retake(state, chosen)
    return state, chosen
