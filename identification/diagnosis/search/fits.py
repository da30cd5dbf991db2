"""Fits of sets of effects to one problem, each computed once and cached.

Nuisances are tolerance parameters that are always fitted. If they are many and the effects linear, a fit is computed as
a change of a similar fit (`NearFits`). Otherwise it is computed in full, starting from a similar fit. With few
nuisances, the fits of many subsets of a few effects use one set of products (`Fits.of_subsets`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from itertools import count

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.fitting import Fitted, LinearisationPoint, WarmStart, active_columns, fit
from identification.diagnosis.fit.possible_bodies import impossible_bodies
from identification.diagnosis.fit.problem import Problem
from identification.engine.fits.bilinear import products_of
from identification.engine.fits.near_fits import NearFits
from identification.engine.fits.projection import gains_if_added
from identification.engine.numerics.bounded import bounded_solve, bounded_solve_without
from phantom_dyn.array_types import Array, Float

Chosen = frozenset[Term]

# With at least this many fitted nuisances a fit is computed as a change of a similar fit. With fewer, a new fit is as
# fast.
_MANY_NUISANCES = 120
# With fewer nuisances, a fit starts from the most similar one of this number of recent fits.
_RECENT = 40


class FitLimitReached(Exception):
    """A search has fitted as many sets of effects as it may."""


class Fits:
    """The cache of a search: fits of sets of effects to one problem.

    A fit depends on its set alone and, but for rounding, not on the order of the calls.

    Args:
        problem: The problem that is fitted.
        allowed: Yields one item for each fit that may be made. Searches that share it have one limit together. None for
            no limit.

    Raises:
        FitLimitReached: By the first fit beyond the limit.
    """

    def __init__(self, problem: Problem, allowed: Iterator[int] | None = None):
        self.problem = problem
        self.allowed = count() if allowed is None else allowed
        self._held_out: dict[Chosen, Fitted] = {}
        self._row_losses: dict[Chosen, Float[Array, " nv"]] = {}
        self._in_sample: dict[Chosen, float] = {}
        self._points: dict[Chosen, LinearisationPoint] = {}
        self._gains: dict[Chosen, dict[tuple[int, ...], float]] = {}
        self._recent: deque[tuple[Chosen, Fitted]] = deque(maxlen=_RECENT)
        self._at_readings = None if problem.at_readings is None else Fits(problem.at_readings, allowed)

    def without_limit(self) -> None:
        """Remove the limit, because after the search only single fits are made."""
        self.allowed = count()
        if self._at_readings is not None:
            self._at_readings.without_limit()

    def of(self, chosen: Chosen) -> Fits:
        """The cache for the problem that a set needs.

        If effects of the problem displace the links or tilt the base, a set without one of these effects uses the
        problem at the encoders' readings (`Problem.of`).
        """
        return self if self._at_readings is None or self.problem.of(chosen) is self.problem else self._at_readings

    def held_out(self, chosen: Chosen) -> Fitted:
        """Fit of a set on all blocks, and once without each fold."""
        own = self.of(chosen)
        if chosen not in own._held_out:
            own._held_out[chosen] = own._fitted(chosen, held_out=True)
        return own._held_out[chosen]

    def row_losses(self, chosen: Chosen) -> Float[Array, " nv"]:
        """Squared residual of each row after the fit of a set to all blocks."""
        own = self.of(chosen)
        if chosen not in own._row_losses:
            known = own._held_out.get(chosen) or own._fitted(chosen, held_out=False)
            own._row_losses[chosen] = known.row_losses
        return own._row_losses[chosen]

    def in_sample(self, chosen: Chosen) -> float:
        """In-sample loss of a set, which ranks sets in a tenth of the time of held-out losses."""
        own = self.of(chosen)
        if chosen not in own._in_sample:
            known = own._held_out.get(chosen) or own._fitted(chosen, held_out=False)
            own._in_sample[chosen] = known.objective
        return own._in_sample[chosen]

    def gains(self, chosen: Chosen, terms: tuple[Term, ...]) -> dict[Term, float]:
        """Decrease of the in-sample loss if one effect is added to a set, for each of ``terms``.

        The decrease is computed by a quadratic approximation.
        """
        if self.of(chosen) is not self:
            return self.of(chosen).gains(chosen, terms)
        if self._similar_fits is not None and _linear(chosen):
            active = active_columns(self.problem, ordered(chosen))
            found = self._similar_fits.gains(active, {term.columns for term in terms})
            return {term: found[term.columns] for term in terms}
        known = self._gains.setdefault(chosen, {})
        new = {term.columns for term in terms}.difference(known)
        if new:
            known.update(gains_if_added(self.problem, self._fitted(chosen, held_out=False), new))
        return {term: known[term.columns] for term in terms}

    def of_subsets(self, terms: Chosen) -> Callable[[Chosen], Float[Array, "G K"]]:
        """Function that gives the coefficients of a fit of any subset of some effects.

        It gives one row for the fit without each fold and, last, one for the fit to all blocks. No losses are computed
        and nothing is cached, because there are many subsets and each is needed once.
        """
        problem, total = self.problem, len(self.problem.precision)
        free = any(term.effect.inertial == "free" for term in terms)
        # With many nuisances, a fit from the products of all columns is slower. If the columns depend on the subset, or
        # the fit is nonlinear, it is wrong. With free inertial parameters, its body may be physically impossible.
        if self._similar_fits is not None or self._at_readings is not None or free or not _linear(terms):

            def fitted(chosen: Chosen) -> Float[Array, "G K"]:
                similar = self._similar_fits if self.of(chosen) is self else None
                if similar is not None and _linear(chosen) and not free and chosen not in self._held_out:
                    return similar.coefficients(active_columns(problem, ordered(chosen)))
                found = self.held_out(chosen)
                return np.vstack([found.fold_theta, found.theta])

            return fitted
        columns = active_columns(problem, ordered(terms))
        whole = products_of(problem, columns, (), held_out=True)
        folds = whole.held_out  # the part of the products that each fold contributes
        assert folds is not None
        with_prior = whole.a + np.diag(problem.precision[columns])
        lower, upper, start = problem.lower[columns], problem.upper[columns], self._first_start.theta[columns]

        def solved(chosen: Chosen) -> Float[Array, "G K"]:
            active = active_columns(problem, ordered(chosen))
            own = np.searchsorted(columns, active)
            bounds = lower[own], upper[own]
            a, b, fold_a = with_prior[np.ix_(own, own)], whole.b[own], folds.a[:, own[:, None], own]
            x = bounded_solve(a, b, *bounds, near=start[own])
            out = np.zeros((len(fold_a) + 1, total))
            out[:-1, active] = bounded_solve_without(a, b, fold_a, folds.b[:, own], *bounds, x)
            out[-1, active] = x
            return out

        return solved

    @cached_property
    def _similar_fits(self) -> NearFits | None:
        """Fits computed as changes of a similar one; None with few nuisances."""
        many = len(self.problem.fitted_nuisances) >= _MANY_NUISANCES
        return NearFits(self.problem, self._first_start.theta) if many else None

    def _fitted(self, chosen: Chosen, *, held_out: bool) -> Fitted:
        if next(self.allowed, None) is None:
            raise FitLimitReached
        if self._similar_fits is not None and _linear(chosen):
            found = self._similar_fits.fit(active_columns(self.problem, ordered(chosen)), held_out=held_out)
            bodies = self.problem.bodies_of(chosen)
            if not any(impossible_bodies(bodies, theta) for theta in (found.theta, *found.fold_theta)):
                return Fitted(self.problem, LinearisationPoint(), *found)
        # A nonlinear fit needs several linear fits to find the point about which it is linearised. The point is cached,
        # because fits with and without held-out data have the same one.
        point = self._points.get(chosen)
        found = fit(self.problem, ordered(chosen), held_out=held_out, near=self._start_of(chosen), point=point)
        if found.point.iterated:
            self._points[chosen] = found.point
        self._recent.append((chosen, found))
        return found

    def _start_of(self, chosen: Chosen) -> WarmStart:
        """Coefficients of a similar fit, from which the fit of a set starts.

        With many nuisances, linear sets and the very first set start from the fit of their linear effects. Any other
        set starts from the most similar recent fit.
        """
        if self._similar_fits is not None and (_linear(chosen) or not self._recent):
            others = ordered(term for term in chosen if _linear(frozenset([term])))
            found = self._similar_fits.fit(active_columns(self.problem, others), held_out=False)
            similar = Fitted(self.problem, LinearisationPoint(), *found)
        elif self._recent:
            _, similar = min(reversed(self._recent), key=lambda one: len(one[0] ^ chosen))
        else:
            return self._first_start
        return replace(WarmStart.empty(self.problem).after(similar, ()), payload=self._first_start.payload)

    @cached_property
    def _first_start(self) -> WarmStart:
        """Start of a fit if there is no similar one: the nuisances of a fit without effects, and the best point mass.

        This is a good start, because the nuisances are at the same bounds in most fits.
        """
        start = WarmStart.empty(self.problem)
        start = start.after(fit(self.problem, (), held_out=False, near=start), ())
        load = next((term for term in self.problem.columns.terms if term.effect.inertial == "point mass"), None)
        if load is None:
            return start
        alone = fit(self.problem, (load,), held_out=False, near=start)
        return WarmStart(start.theta, start.after(alone, (load,)).payload)


def _linear(chosen: Chosen) -> bool:
    """True if a fit of these effects is linear in all their coefficients."""
    return not any(term.effect.scales_joint or term.effect.inertial == "point mass" for term in chosen)
