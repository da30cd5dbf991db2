"""Fits many sets of columns that differ little: each fit is computed from the full solution of a similar set.

A fit of a robot with many joints contains about a hundred nuisances. If one column replaces another, the same bounds
are active for nearly all nuisances. Therefore a few sets are solved fully and kept as tableaus (see
`numerics.tableau`). The fit of any other set starts from the most similar solved set, and its cost grows with the
number of columns and active bounds that differ. Its minimum equals that of a full solution up to rounding.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from identification.engine.fits.problem import LinearProblem
from identification.engine.fits.projection import gains_within
from identification.engine.fits.solved_set import PastFit, SolvedSet, marked, quadratic
from identification.engine.numerics.held_minimum import responses_among
from identification.engine.numerics.tableau import tableau
from identification.engine.numerics.tableau_changes import ChangedMinimum, changed
from phantom_dyn._kernels.jit import fused
from phantom_dyn.array_types import Float, Int

Array = np.ndarray

# A set that differs from all solved sets by more columns and active bounds than this is solved fully.
_MOST_DIFFERENCES = 60
# Numbers of solved sets and of earlier fits that are kept. A new fit is computed from the most similar solved set, and
# tries the active bounds of the most similar earlier fit first.
_KEPT_SETS = 4
_KEPT_FITS = 100
# A change of a coefficient is rounding if it changes the loss by at most this share of the largest such change, or of
# one if that is larger.
_ROUNDING_SHARE = 1e-14


class LinearFit(NamedTuple):
    """Result of one fit.

    Attributes:
        theta: All coefficients, zero where a column is not in the fit, ``(K,)``.
        active: Columns in the fit.
        penalty: Sum of the squared nuisances, each in standard deviations of its prior.
        objective: In-sample loss over all training blocks, with the penalties of all priors.
        loss: Weighted squared residual of the core of each block, predicted by the fit without the block's fold,
            ``(B,)``; empty if nothing was held out.
        fold_active: Coefficients of the columns ``active`` in the fit without each fold, ``(F, k)``.
    """

    theta: Float[Array, " K"]
    active: Int[Array, " k"]
    penalty: float
    objective: float
    loss: Float[Array, " B"]
    fold_active: Float[Array, "F k"]

    @property
    def fold_theta(self) -> Float[Array, "F K"]:
        """All coefficients of the fit without each fold, zero where a column is not in the fit."""
        out = np.zeros((len(self.fold_active), len(self.theta)))
        out[:, self.active] = self.fold_active
        return out


class NearFits:
    """Linear fits of sets of columns, each computed from the most similar solved set.

    Args:
        problem: The problem that is fitted.
        start: Coefficients at which a full solution starts, ``(K,)``; NaN where there is no start.
    """

    def __init__(self, problem: LinearProblem, start: Float[Array, " K"]):
        self.problem = problem
        self._start = start
        self._solved: list[SolvedSet] = []
        # Coefficients of the last fits, from which similar ones start.
        self._past_fits, self._held_out_fits = deque[PastFit](maxlen=_KEPT_FITS), deque[PastFit](maxlen=_KEPT_FITS)
        self._loss_without_columns = float(problem.grams.c[problem.grams.fold >= 0].sum())

    def fit(self, active: Int[Array, " k"], *, held_out: bool) -> LinearFit:
        """Fit of some columns to all blocks; with ``held_out`` also once without each fold."""
        problem = self.problem
        solved, minima, x = self._coefficients(active, held_out=held_out)
        new, _, index = solved.changes(active)
        every = np.zeros((len(x), len(problem.precision)))
        every[:, index] = x
        theta = every[-1].copy()  # a view would keep the whole array in memory
        nuisances = slice(0, problem.nuisance_count)
        penalty = float(theta[nuisances] ** 2 @ problem.precision[nuisances])
        objective = self._loss_without_columns + minima[-1].value
        loss = _losses(solved, new, x) if held_out else np.zeros(0)
        return LinearFit(theta, active, penalty, objective, loss, every[:-1, active])

    def coefficients(self, active: Int[Array, " k"]) -> Float[Array, "G K"]:
        """Coefficients of the fits of some columns: one row without each fold, then that of the fit to all blocks."""
        solved, _, x = self._coefficients(active, held_out=True)
        out = np.zeros((len(x), len(self.problem.precision)))
        out[:, solved.changes(active)[2]] = x
        return out

    def _coefficients(
        self, active: Int[Array, " k"], *, held_out: bool
    ) -> tuple[SolvedSet, list[ChangedMinimum], Float[Array, "G v"]]:
        """The solved set that a fit is computed from, the minima of the fit (see `_minima`), and their coefficients."""
        problem, (solved, minima) = self.problem, self._solved_and_minima(active, held_out=held_out)
        x, index = np.array([one.x for one in minima]), solved.changes(active)[2]
        at_bound = (x[-1] <= problem.lower[index]) | (x[-1] >= problem.upper[index])
        count = len(problem.precision)
        fit = PastFit(self._bits(active), index, x, marked(index, count), marked(index[at_bound], count))
        self._past_fits.append(fit)
        if held_out:
            self._held_out_fits.append(fit)
        return solved, minima, x

    def _solved_and_minima(self, active: Int[Array, " k"], *, held_out: bool) -> tuple[SolvedSet, list[ChangedMinimum]]:
        """The solved set that a fit is computed from, and the minima of the fit (see `_minima`)."""
        solved = self._nearest(active)
        minima = self._minima(solved, active, held_out=held_out)
        if all(one.converged for one in minima):
            return solved, minima
        # The nearest solved set differs so much that rounding errors are too large: solve the set itself.
        solved = self._solve(active)
        return solved, self._minima(solved, active, held_out=held_out)

    def _minima(self, solved: SolvedSet, active: Int[Array, " k"], *, held_out: bool) -> list[ChangedMinimum]:
        """Minima of the fits of some columns: with ``held_out`` those without each fold; last that of all blocks."""
        new, gone, index = solved.changes(active)
        bounds = self.problem.lower[index], self.problem.upper[index]
        tableaus = (*solved.folds, solved.whole) if held_out else (solved.whole,)
        entering = [*(solved.fold_entering(new) if held_out else ()), solved.entering(new)]
        start = np.full((len(tableaus), len(self.problem.precision)), np.nan)
        similar = self._most_similar_fit(active, held_out=held_out)
        # No start is needed if the set is the solved one, as its active bounds are known.
        if similar is not None and len(new) + len(gone) > 0:
            start[:, similar.index] = similar.x[-len(start) :]
        parts = zip(tableaus, entering, start[:, index], strict=True)
        return [changed(one, more, gone, bounds, near) for one, more, near in parts]

    def _most_similar_fit(self, active: Int[Array, " k"], *, held_out: bool) -> PastFit | None:
        """The earlier fit of the most similar set; the latest one if several are equally similar."""
        wanted = self._bits(active)
        past = self._held_out_fits if held_out else self._past_fits
        return min(reversed(past), key=lambda one: (one.bits ^ wanted).bit_count(), default=None)

    def _bits(self, active: Int[Array, " k"]) -> int:
        """The set as an integer with one bit for each column, so that two sets can be compared quickly."""
        return int.from_bytes(np.packbits(marked(active, len(self.problem.precision))).tobytes())

    def gains(self, active: Int[Array, " k"], sets: Iterable[tuple[int, ...]]) -> dict[tuple[int, ...], float]:
        """Decrease of the in-sample loss of a fit when each set of columns is added to it.

        The active bounds of the fit are kept active, so that the decrease is exact to second order.
        """
        problem, (solved, (found,)) = self.problem, self._solved_and_minima(active, held_out=False)
        new, _, _ = solved.changes(active)
        inside = frozenset(active.tolist())
        added = {columns: tuple(k for k in columns if k not in inside) for columns in sets}
        wanted = np.array(sorted({k for own in added.values() for k in own}), dtype=int)
        gains = dict.fromkeys(added, 0.0)
        if not len(wanted):
            return gains
        projected = _ProjectedColumns(solved, new, found, wanted)
        for size in {len(own) for own in added.values()} - {0}:
            same_size = [columns for columns, own in added.items() if len(own) == size]
            own = np.array([added[columns] for columns in same_size])
            found_gains = gains_within(*projected.products(own), problem.lower[own], problem.upper[own])
            gains.update(zip(same_size, found_gains.tolist(), strict=True))
        return gains

    def _nearest(self, active: Int[Array, " k"]) -> SolvedSet:
        """The most similar solved set; the set itself, newly solved, if it differs much from all solved sets."""
        wanted, similar = marked(active, len(self.problem.precision)), self._most_similar_fit(active, held_out=False)
        near = min(self._solved, key=lambda one: one.differences(wanted, similar), default=None)
        if near is None or near.differences(wanted, similar) > _MOST_DIFFERENCES:
            return self._solve(active, near)
        self._solved = [*(one for one in self._solved if one is not near), near]
        return near

    def _solve(self, active: Int[Array, " k"], near: SolvedSet | None = None) -> SolvedSet:
        """Solve a set fully and keep it; the oldest kept set is dropped.

        Args:
            active: The columns of the set.
            near: A solved set whose minimum is the start.
        """
        start = self._start
        if near is not None:
            start = start.copy()
            start[near.columns] = near.whole.x * near.whole.scale
        solved = SolvedSet(self.problem, active, tableau(*quadratic(self.problem, active), start[active]))
        self._solved = [*self._solved, solved][-_KEPT_SETS:]
        return solved


class _ProjectedColumns:
    """Columns that may be added to a fit, minus the part that the free columns of the fit can explain (projection).

    The fit was computed from a solved set. Its free columns differ from those of the solved set by the flipped columns:
    these are free in the fit and held at a bound in the solved set, or the other way round. So the products of the
    projected columns are

        gram + cross response' - slope_by_flipped flipped_response'

    ``gram`` has the products of the columns as they are. The second term (``response`` is negative for free columns)
    projects off the free columns of the solved set. The third term corrects for the flipped columns. Actions, responses
    and slopes are those of `numerics.held_minimum`, in the scaled units of the tableau.

    Args:
        solved: The solved set from which the fit was computed.
        new: Columns of the fit that are not in the solved set.
        found: The minimum of the fit.
        wanted: Indices of the columns that may be added, in ascending order.
    """

    def __init__(self, solved: SolvedSet, new: Int[Array, " m"], found: ChangedMinimum, wanted: Int[Array, " w"]):
        self._wanted, self._problem, free = wanted, solved.problem, ~solved.whole.held
        cross, response, slope, self._scale = solved.entering_parts(wanted)
        entered = solved.entering(new)
        n, flips = len(solved.columns), len(found.flipped)
        acted_on, actions = found.action  # the flipped columns come first
        is_solved = acted_on < n
        gram_with_new = self._problem.total_a[np.ix_(wanted, new)] * self._scale[:, None] * entered.scale
        # Change of the slope of each wanted column by a unit action on each column.
        slope_by_action = np.empty((len(wanted), len(acted_on)))
        signs = np.where(solved.whole.held[acted_on[is_solved]], 1.0, -1.0)
        slope_by_action[:, is_solved] = signs * response[:, acted_on[is_solved]]
        slope_by_new = gram_with_new + cross[:, free] @ entered.response[:, free].T
        slope_by_action[:, ~is_solved] = slope_by_new[:, acted_on[~is_solved] - n]
        # Change of the state of each flipped column by a unit shift of each wanted column.
        flipped_by_wanted = slope_by_action[:, :flips].copy()
        flipped_by_wanted[:, is_solved[:flips]] = response[:, acted_on[:flips][is_solved[:flips]]]
        among_flipped = responses_among(solved.whole, entered, found.flipped)
        self._cross, self._response = cross[:, free], response[:, free]
        self._slope_by_flipped = slope_by_action[:, :flips]
        self._flipped_response = np.linalg.solve(among_flipped, flipped_by_wanted.T).T
        self._slope = (slope + slope_by_action @ actions) / self._scale

    def products(self, columns: Int[Array, "g m"]) -> tuple[Float[Array, "g m m"], Float[Array, "g m"]]:
        """Products among the projected columns of each group, with priors, and their products with the residual."""
        at, size = np.searchsorted(self._wanted, columns), columns.shape[1]
        gram = self._problem.total_a[columns[:, :, None], columns[:, None, :]]
        gram[:, np.arange(size), np.arange(size)] += self._problem.precision[columns]
        projection = self._cross[at] @ self._response[at].transpose(0, 2, 1)
        projection = projection - self._slope_by_flipped[at] @ self._flipped_response[at].transpose(0, 2, 1)
        scale = self._scale[at]
        return gram + projection / (scale[:, :, None] * scale[:, None, :]), -self._slope[at]


def _losses(solved: SolvedSet, new: Int[Array, " m"], x: Float[Array, "G v"]) -> Float[Array, " B"]:
    """Held-out loss of the core of each block, computed as a change of the loss of the solved set.

    Args:
        solved: The solved set from which the fit was computed.
        new: Columns of the fit that are not in the solved set.
        x: Coefficients without each fold and last of the fit to all blocks, the new columns last.
    """
    grams, n = solved.problem.grams, len(solved.columns)
    x = x[solved.fit_of_block]
    step, entered = x[:, :n] - solved.x_of_block, x[:, n:]
    lines = solved.core_products(new)
    square = grams.core_a.among(new)
    out = solved.losses + 2.0 * np.einsum("bk,bk->b", solved.core_slope, step)
    slope = (lines @ (x[:, :n])[:, :, None])[:, :, 0] - grams.core_b[:, new]
    out += 2.0 * np.einsum("bm,bm->b", slope, entered) + np.einsum("bm,bmk,bk->b", entered, square, entered)
    # The coefficients of other limbs change by rounding only: they are left out to save time.
    size = np.abs(step).max(axis=0) ** 2 * solved.core_diagonal
    used = np.flatnonzero(size > _ROUNDING_SHARE * max(float(size.max(initial=0.0)), 1.0))
    _add_quadratic_forms(out, solved.core, used, np.ascontiguousarray(step[:, used]))
    return out


@fused
def _add_quadratic_forms(out: Array, values: Array, used: Array, x: Array) -> None:
    """Add ``x values[:, used, used] x`` of each block."""
    for block in range(len(out)):
        for i in range(len(used)):
            line = values[block, used[i]]
            inner = 0.5 * line[used[i]] * x[block, i]
            for k in range(i):
                inner += line[used[k]] * x[block, k]
            out[block] += 2.0 * inner * x[block, i]
