"""Fits of sets of effects to one problem, each made once and kept."""

from __future__ import annotations

from functools import cached_property

from identification.diagnosis.fit.fitting import Fitted, Near, Point, fit
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.fit.projection import Beside, beside
from identification.diagnosis.model.terms import Term, ordered

Chosen = frozenset[Term]


class Fits:
    """The explicit cache of a search: what a set of effects leaves of one problem.

    Every fit starts from the same point, so that it depends on its set alone and not on the order of the calls.

    Args:
        problem: What is fitted.
    """

    def __init__(self, problem: Problem):
        self.problem = problem
        self._held_out: dict[Chosen, Fitted] = {}
        self._in_sample: dict[Chosen, float] = {}
        self._points: dict[Chosen, Point] = {}
        self._besides: dict[Chosen, Beside] = {}

    def held_out(self, chosen: Chosen) -> Fitted:
        """Fit of a set on all blocks, and once without each fold."""
        if chosen not in self._held_out:
            self._held_out[chosen] = self._fitted(chosen, held_out=True)
        return self._held_out[chosen]

    def in_sample(self, chosen: Chosen) -> float:
        """Loss of a set in sample: a tenth of the work, by which it is ranked what is worth holding out."""
        if chosen not in self._in_sample:
            known = self._held_out.get(chosen) or self._fitted(chosen, held_out=False)
            self._in_sample[chosen] = known.objective
        return self._in_sample[chosen]

    def beside(self, chosen: Chosen) -> Beside:
        """All columns with the part taken out that a set can make of them."""
        if chosen not in self._besides:
            self._besides[chosen] = beside(self.problem, self._fitted(chosen, held_out=False))
        return self._besides[chosen]

    def _fitted(self, chosen: Chosen, *, held_out: bool) -> Fitted:
        # The point about which a fit is linear takes several fits to find, and is the same in sample and held out.
        point = self._points.get(chosen)
        found = fit(self.problem, ordered(chosen), held_out=held_out, near=self._start, point=point)
        if found.point.moved:
            self._points[chosen] = found.point
        return found

    @cached_property
    def _start(self) -> Near:
        """The nuisances alone, whose bounds bind in most fits, and the point mass that explains most by itself."""
        start = Near.nothing(self.problem)
        start = start.after(fit(self.problem, (), held_out=False, near=start), ())
        load = next((term for term in self.problem.columns.terms if term.effect.inertial == "point mass"), None)
        if load is None:
            return start
        alone = fit(self.problem, (load,), held_out=False, near=start)
        return Near(start.theta, start.after(alone, (load,)).payload)
