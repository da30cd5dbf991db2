"""Rivals and the score of a set of them: held-out loss plus a BIC-like price, with thresholds from chance.

A claim has to gain more on held-out data than the best of the whole catalogue, or of one joint, gains by chance.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.gap import RowGaps
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.search.containment import relations
from identification.diagnosis.search.fits import Fits
from identification.diagnosis.search.record import Record
from identification.diagnosis.search.special_cases import vanishes_at_bound
from identification.gates import above_chance

# Number of joints from which on effects on different ones are added, swapped and dropped in one step, to save time.
_MANY_JOINTS = 10
# Most sets that the searches of a diagnosis fit for each joint, of a robot with fewer joints than that and of others.
# A real TX40 needed 792, a biped with a payload (seed 316 of `benchmarks.legged`) 180, by `benchmarks/search_fits.py`.
_MOST_FITS, _MOST_FITS_OF_MANY = 4000, 600
# Most rivals whose in-sample gain is computed by a fit: the best ranked, and those with this share of the best gain.
_MOST_FITTED = 30
_WORTH_FITTING = 0.2  # share of the best gain below which a rival is no such rival
# With released bounds a gain may be so many times its estimate with the binding bounds held.
_RELEASED = 2.0
# Score of an impossible set, more than any recording's loss.
IMPOSSIBLE = 1e15


@dataclass(frozen=True)
class Threshold:
    """Held-out gain that a claim needs: that of the best effect of the catalogue, or of one joint, by chance.

    Attributes:
        overall: Gain that no effect reaches by chance.
        joints: The same for the effects of one joint, under None for those of no single joint. An unexplained residual
            of one joint raises its threshold, and should not raise that of effects on others.
    """

    overall: float
    joints: dict[str | None, float]

    def of(self, *terms: Term) -> float:
        """Threshold of a claim of these effects together."""
        return max((min(self.joints.get(joint_of(term), self.overall), self.overall) for term in terms), default=0.0)


def joint_of(term: Term) -> str | None:
    """The single joint that a term sits on, None if there is none (a coupling sits on two, joined by ``+``)."""
    return None if term.joint is None or "+" in term.joint else term.joint


@dataclass(frozen=True)
class Search:
    """Rivals of one problem and the scores of sets of them.

    Attributes:
        problem: The problem that is fitted.
        terms: All rivals.
        sizes: Number of parameters that each rival really adds (its rank), by rival.
        fits: Fits of sets of rivals, each made once.
        displacing: For each rival those that remove it when they are added, itself among them; cached.
        covering: For each rival those of which it is a special case; cached.
        threshold: Gains by chance.
        rows: Gap of each row: an effect on a row with a large gap has to close a fair part of it.
        spurious: Gain of each effect by encoder noise alone.
        record: Decisions on each effect.
        near: Cached alternatives of an effect that touch a joint that it touches, see `swaps.relevant_alternatives`.
    """

    problem: Problem
    terms: tuple[Term, ...]
    sizes: dict[Term, int]
    fits: Fits
    displacing: Callable[[Term], frozenset[Term]]
    covering: Callable[[Term], frozenset[Term]]
    threshold: Threshold
    rows: RowGaps
    spurious: dict[tuple[str, str | None], float]
    record: Record = field(default_factory=Record, compare=False)
    near: dict[Term, tuple[frozenset[Term], ...]] = field(default_factory=dict, init=False, compare=False)
    _scores: dict[frozenset[Term], float] = field(default_factory=dict, init=False, compare=False)

    @property
    def many_joints(self) -> bool:
        """True if effects on different joints are added, swapped and dropped in one step."""
        return len(self.problem.columns.rows) >= _MANY_JOINTS

    @cached_property
    def alone(self) -> dict[Term, frozenset[Term]]:
        """The set of each rival by itself."""
        return {term: frozenset([term]) for term in self.terms}

    def of(self, chosen: frozenset[Term]) -> Search:
        """The same search on the columns that a set needs, see `Problem.of`."""
        fits = self.fits.of(chosen)
        return self if fits is self.fits else replace(self, problem=fits.problem, fits=fits)

    def held_out_fit(self, chosen: frozenset[Term]) -> Fitted:
        """Fit of a set with its held-out losses."""
        return self.fits.held_out(chosen)

    def in_sample_loss(self, chosen: frozenset[Term]) -> float:
        """Loss of a set in sample."""
        return self.fits.in_sample(chosen)

    def score(self, chosen: frozenset[Term]) -> float:
        """Held-out loss plus the price of the parameters; lower is better.

        Parameters that add no rank cost a negligible amount, so that of two sets with exactly the same columns the one
        with fewer parameters is chosen. A set whose fit needs an impossible size scores `IMPOSSIBLE`.
        """
        if chosen not in self._scores:
            found, robot = self.held_out_fit(chosen), self.problem.session.robot
            vanishes = any(vanishes_at_bound(robot, term, found.theta[list(term.columns)]) for term in chosen)
            priced = found.total + self.price_of(chosen) + 0.02 * sum(term.size for term in chosen)
            self._scores[chosen] = IMPOSSIBLE if vanishes else priced
        return self._scores[chosen]

    def gains(
        self,
        chosen: frozenset[Term],
        terms: tuple[Term, ...],
        above: float = -np.inf,
        instead_of: Term | None = None,
    ) -> dict[Term, float]:
        """In-sample gain of each term if it is added to a set, less the price of its parameters.

        Gains are first estimated with the active bounds of the set fixed. Then the best terms are fitted, and also
        those that would remove others from the set, if their gain may be above ``above``. A gain is larger once bounds
        are released: a few times larger if tolerance parameters are at their bounds to imitate the cause.

        Args:
            chosen: A set.
            terms: Rivals.
            above: Gain below which an estimate is good enough.
            instead_of: A finding that the terms may replace. Its own gain shows how much larger gains are without the
                bounds.
        """
        gained = self.fits.gains(chosen, terms)
        costs = {term: self.prices[term] for term in terms}
        gone: dict[Term, frozenset[Term]] = defaultdict(frozenset)
        for other in chosen:
            for term in self.displacing(other) - {other}:
                gone[term] |= {other}
                if term in costs:
                    costs[term] -= self.prices[other]
        out = {term: gained[term] - costs[term] for term in terms}
        ranked = sorted(terms, key=lambda term: -out[term])
        least = _WORTH_FITTING * max(out[ranked[0]], 0.0) if ranked else 0.0
        released = _RELEASED
        if instead_of is not None:
            estimate = max(self.fits.gains(chosen, (instead_of,))[instead_of], 1e-12)
            fitted = self.in_sample_loss(chosen) - self.in_sample_loss(chosen | {instead_of})
            released *= max(fitted / estimate, 1.0)
        for k, term in enumerate(ranked):
            worth = released * (out[term] + costs[term]) - costs[term] > above
            promising = out[term] > least and (k < _MOST_FITTED or out[term] > 0.8 * out[ranked[0]])
            if worth and (promising or term in gone):
                out[term] = (
                    self.in_sample_loss(chosen) - self.in_sample_loss((chosen - gone[term]) | {term}) - costs[term]
                )
        return out

    def can_join(self, chosen: frozenset[Term], term: Term) -> bool:
        """As `containment.can_join`, with the cached relations of this search."""
        return term not in chosen and chosen.isdisjoint(self.covering(term))

    def price_of(self, chosen: frozenset[Term]) -> float:
        """Price of the parameters of a set."""
        return sum(self.prices[term] for term in chosen)

    @cached_property
    def prices(self) -> dict[Term, float]:
        """Price of the parameters of each effect."""
        return {term: price(size) for term, size in self.sizes.items()}

    def sizes_of(self, chosen: frozenset[Term]) -> int:
        """Number of parameters of a set."""
        return sum(self.sizes[term] for term in chosen)


def price(size: int) -> float:
    """Penalty of an effect with ``size`` parameters, as in BIC; beyond four, each costs its expected gain by chance."""
    return above_chance.PARAMETER_PRICE * min(size, 4) + max(size - 4, 0)


def most_fits(joints: int) -> int:
    """Number of fits after which a search has no end: it goes on from one set of effects to another."""
    return joints * (_MOST_FITS if joints < _MANY_JOINTS else _MOST_FITS_OF_MANY)


def ranks_of(problem: Problem, terms: tuple[Term, ...]) -> dict[Term, int]:
    """Independent directions among the columns of each term in these recordings, at most its number of parameters."""
    out: dict[Term, int] = {}
    a = problem.grams.everything
    for count in {len(term.columns) for term in terms}:
        alike = [term for term in terms if len(term.columns) == count]
        index = np.array([term.columns for term in alike])
        scale = np.sqrt(np.einsum("tkk->tk", a[index[:, :, None], index[:, None, :]]))
        alive = scale > 1e-9 * np.maximum(scale.max(axis=1, keepdims=True), 1e-300)
        # A column of zeros makes a direction of size zero.
        inverse = np.where(alive, 1.0 / np.where(alive, scale, 1.0), 0.0)
        normal = a[index[:, :, None], index[:, None, :]] * inverse[:, :, None] * inverse[:, None, :]
        values = np.linalg.eigvalsh(normal)
        ranks = np.sum(values > 1e-7 * np.maximum(values[:, -1:], 1e-300), axis=1)
        for term, rank in zip(alike, ranks.tolist(), strict=True):
            more = 0 if term.effect.shape_is_estimate or not rank else len(term.shape)
            out[term] = min(rank + more, term.size)
    return out


def set_up_search(
    problem: Problem,
    threshold: Threshold,
    rows: RowGaps,
    spurious: dict[tuple[str, str | None], float],
    record: Record | None = None,
    allowed: Iterator[int] | None = None,
) -> Search:
    """A search over all terms whose columns are not zero in the recordings.

    Args:
        problem: Columns, products, priors.
        threshold: See `Search`, as for the next two.
        rows: Gaps of the joints.
        spurious: Gains by noise of encoders.
        record: Decisions on each effect until now; None: a new one.
        allowed: Has an item for each fit that may be made, see `Fits`.
    """
    sizes = ranks_of(problem, problem.columns.terms)
    terms = tuple(term for term in problem.columns.terms if sizes[term] > 0)
    displacing, covering = relations(problem.columns.terms)
    fits, kept = Fits(problem, allowed), Record() if record is None else record
    return Search(problem, terms, sizes, fits, displacing, covering, threshold, rows, spurious, kept)


def with_wide_tolerances(search: Search) -> Search:
    """The search with three times the stated tolerances of the model, and the same rivals and prices."""

    def widened(problem: Problem) -> Problem:
        nuisance = np.arange(len(problem.precision)) < problem.nuisance_count
        width = np.where(nuisance, rules.OTHER_TOLERANCE, 1.0)
        return replace(
            problem,
            precision=problem.precision / width**2,
            lower=problem.lower * width,
            upper=problem.upper * width,
            at_readings=None if problem.at_readings is None else widened(problem.at_readings),
        )

    wide = widened(search.problem)
    return replace(search, problem=wide, fits=Fits(wide))
