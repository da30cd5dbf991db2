"""Search for the few terms that explain poses: stepwise with a beam, each term at the price of chance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.geometry.terms import ELASTIC, Term
from identification.geometry.whitened import Whitened
from phantom_dyn.array_types import Float

Array = np.ndarray

CHANCE = 0.005
"""Share of robots without a gap on which chance alone may put the best of all terms above its price."""
_BEAM = 8
_MOST = 20
_PATIENCE = 2  # terms that a set may cost before it pays
_TIE = 1e-8  # of all squares: twins differ by less, through rounding


@dataclass(frozen=True)
class Fits:
    """Squares and products of projected columns: fits of any set of terms in microseconds.

    Attributes:
        products: Shape ``(p, p)``.
        slopes: Of the terms with what is left, ``(p,)``.
        total: Square of what is left without any term.
        terms: One for each column.
        seen: Places of the terms that leave something of their own.
    """

    products: Float[Array, "p p"]
    slopes: Float[Array, " p"]
    total: float
    terms: tuple[Term, ...]
    seen: tuple[int, ...]

    def values(self, chosen: Sequence[int]) -> Float[Array, " k"] | None:
        """Best values of some terms; None if they are not separate from each other."""
        at = list(chosen)
        products = self.products[np.ix_(at, at)]
        size = np.sqrt(np.diag(products))
        scaled = products / np.outer(size, size)
        if len(at) > 1 and np.linalg.eigvalsh(scaled)[0] < 1e-9:
            return None
        return np.linalg.solve(scaled, self.slopes[at] / size) / size

    def squares(self, chosen: Sequence[int]) -> float:
        """Squares that are left; infinite where a value is impossible: a negative compliance, or one out of reason."""
        if not len(chosen):
            return self.total
        values = self.values(chosen)
        if values is None:
            return np.inf
        for k, value in zip(chosen, values, strict=True):
            term = self.terms[k]
            if abs(value) > term.largest or (term.effect == ELASTIC and value < 0):
                return np.inf
        return self.total - float(self.slopes[list(chosen)] @ values)


def fits_of(found: Whitened, terms: tuple[Term, ...]) -> Fits:
    """Products of the columns of an equation."""
    columns = found.columns
    return Fits(
        columns.T @ columns,
        columns.T @ found.left,
        float(found.left @ found.left),
        terms,
        tuple(np.flatnonzero(found.seen).tolist()),
    )


def price_of(count: int, free: float) -> float:
    """Squares that a term has to explain so that the best of ``count`` does by chance in `CHANCE` of all cases."""
    from scipy.special import fdtri

    return 1.0 / float(fdtri(free, 1, CHANCE / max(count, 1)))


def chosen_terms(fits: Fits, price: float) -> tuple[int, ...]:
    """The set of terms with the least squares and prices together, ascending; of twins that which stands first.

    Args:
        fits: Of the poses.
        price: Of a term.
    """
    best: tuple[float, tuple[int, ...]] = (_rounded(fits, (), price), ())
    front: list[tuple[int, ...]] = [()]
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


def _swapped(fits: Fits, chosen: tuple[int, ...], price: float) -> tuple[int, ...]:
    """The set after all exchanges of a term, and all that can be spared, that pay."""
    while chosen:
        others = [k for k in fits.seen if k not in chosen]
        trials = [tuple(x for x in chosen if x != k) for k in chosen]
        trials += [tuple(sorted((*(x for x in chosen if x != k), other))) for k in chosen for other in others]
        value, trial = min((_rounded(fits, trial, price), trial) for trial in trials)
        if value >= _rounded(fits, chosen, price):
            return chosen
        chosen = trial
    return chosen


def _rounded(fits: Fits, chosen: Sequence[int], price: float) -> float:
    """Squares and prices of a set, so that twins stay in the order of the robot and not of their rounding errors."""
    value, grain = fits.squares(chosen) + price * len(chosen), max(_TIE * fits.total, 1e-6)
    return float(np.round(value / grain)) * grain if np.isfinite(value) else np.inf
