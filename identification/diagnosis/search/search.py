"""Candidate effects of a diagnosis, and the score by which sets of them are compared.

The loss of a set is the weighted sum of squared residuals after a fit of its effects. Its score is the loss on held-out
data plus a price for each parameter, as in BIC. The gain of an effect is the decrease of the loss when the effect is
added to a set. A claim says that an effect is present: it has to gain more on held-out data than the best effect of the
whole catalogue, or of one joint, gains by chance.
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
from identification.diagnosis.search.fits import Chosen, Fits
from identification.diagnosis.search.record import Record
from identification.diagnosis.search.special_cases import vanishes_at_bound
from identification.gates import above_chance

# From this number of joints on, effects on different joints are added, swapped and removed in one step, to save time.
_MANY_JOINTS = 10
# Largest number of sets per joint that all searches of a diagnosis may fit: on a robot with fewer than `_MANY_JOINTS`
# joints, and on other robots. A real TX40 needed 792, a biped with a payload (seed 316 of `benchmarks.legged`) 180, by
# `benchmarks/search_fits.py`.
_MOST_FITS, _MOST_FITS_OF_MANY = 4000, 600
# Largest number of candidates whose in-sample gain is computed by a fit, not only estimated.
_MOST_FITTED_CANDIDATES = 30
# A candidate is fitted only if its estimated gain is above this share of the largest estimated gain.
_PROMISING_SHARE = 0.2
# A gain is estimated with coefficients fixed at their active bounds. A fit, which releases bounds, may gain this many
# times more.
_RELEASE_FACTOR = 2.0
# Score of a set with a physically impossible size: more than the loss of any recording.
IMPOSSIBLE = 1e15


@dataclass(frozen=True)
class Threshold:
    """Held-out gain that a claim needs, because the best effect may gain as much by chance.

    Attributes:
        overall: Gain that no effect of the catalogue reaches by chance.
        joints: Gain that no effect of each joint reaches by chance; the key None has the effects of several joints or
            of the whole robot. An unexplained residual on one joint raises the threshold of that joint only.
    """

    overall: float
    joints: dict[str | None, float]

    def of(self, *terms: Term) -> float:
        """Threshold of a claim of several effects together: the largest of their thresholds."""
        return max((min(self.joints.get(joint_of(term), self.overall), self.overall) for term in terms), default=0.0)


def joint_of(term: Term) -> str | None:
    """The joint of a term; None for a term of the whole robot, or of several joints, with names joined by ``+``."""
    return None if term.joint is None or "+" in term.joint else term.joint


@dataclass(frozen=True)
class Search:
    """Candidate effects of one problem and the scores of sets of them.

    Attributes:
        problem: The problem that is fitted.
        terms: All candidates, each an effect on one joint with one shape.
        counts: Number of parameters of each candidate that change the torque independently (`parameter_counts`).
        fits: Fits of sets of candidates, each made once.
        removed_by: Function that gives the candidates that remove a candidate from a set when they are added; the
            candidate itself is included. Cached.
        contained_in: Function that gives the candidates of which a candidate is a special case. Cached.
        threshold: Held-out gains that claims need.
        gaps: Gap of each row (joint): an effect on a joint with a large gap has to close a fair part of it.
        spurious: Gain of each effect from encoder noise alone, by its name and joint.
        record: Decisions on each effect.
        alternatives_on_joint: Cache of `swaps.relevant_alternatives`: for each effect, its alternatives that act on one
            of its joints.
    """

    problem: Problem
    terms: tuple[Term, ...]
    counts: dict[Term, int]
    fits: Fits
    removed_by: Callable[[Term], frozenset[Term]]
    contained_in: Callable[[Term], frozenset[Term]]
    threshold: Threshold
    gaps: RowGaps
    spurious: dict[tuple[str, str | None], float]
    record: Record = field(default_factory=Record, compare=False)
    alternatives_on_joint: dict[Term, tuple[Chosen, ...]] = field(default_factory=dict, init=False, compare=False)
    _scores: dict[frozenset[Term], float] = field(default_factory=dict, init=False, compare=False)

    @property
    def many_joints(self) -> bool:
        """True if effects on different joints are added, swapped and removed in one step."""
        return len(self.problem.columns.rows) >= _MANY_JOINTS

    @cached_property
    def alone(self) -> dict[Term, frozenset[Term]]:
        """For each candidate the set that contains it alone."""
        return {term: frozenset([term]) for term in self.terms}

    def of(self, chosen: frozenset[Term]) -> Search:
        """The same search on the columns that a set needs (`Problem.of`)."""
        fits = self.fits.of(chosen)
        return self if fits is self.fits else replace(self, problem=fits.problem, fits=fits)

    def held_out_fit(self, chosen: frozenset[Term]) -> Fitted:
        """Fit of a set with its held-out losses."""
        return self.fits.held_out(chosen)

    def in_sample_loss(self, chosen: frozenset[Term]) -> float:
        """In-sample loss of a set."""
        return self.fits.in_sample(chosen)

    def in_sample_score(self, chosen: frozenset[Term]) -> float:
        """In-sample loss plus the price of the parameters, which ranks sets in less time than `score`."""
        return self.in_sample_loss(chosen) + self.price_of(chosen)

    def score(self, chosen: frozenset[Term]) -> float:
        """Held-out loss plus the price of the parameters; lower is better.

        Parameters that add no rank have a negligible price, so that the set with fewer parameters is chosen if two sets
        have exactly the same columns. A set whose fit needs an impossible size has the score `IMPOSSIBLE`.
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
        """In-sample gain of each term if it is added to a set, minus the price of its parameters.

        All gains are first estimated, with coefficients fixed at their active bounds. Then fits are made for the best
        terms, and for terms that would remove others from the set, if their gain may exceed ``above``. A fit gains more
        than the estimate because it releases bounds: a few times more if tolerance parameters had reached their bounds
        in order to imitate the cause.

        Args:
            chosen: The set to which a term is added.
            terms: The terms, which are added one at a time.
            above: Gain below which an estimate is accurate enough.
            instead_of: A finding that the terms may replace. Estimates of the terms are assumed to be too small by the
                same factor as that of the finding.
        """
        gained = self.fits.gains(chosen, terms)
        costs = {term: self.prices[term] for term in terms}
        # A term that is added removes others, whose prices are then saved.
        removed: dict[Term, frozenset[Term]] = defaultdict(frozenset)
        for other in chosen:
            for term in self.removed_by(other) - {other}:
                removed[term] |= {other}
                if term in costs:
                    costs[term] -= self.prices[other]
        out = {term: gained[term] - costs[term] for term in terms}
        ranked = sorted(terms, key=lambda term: -out[term])
        least = _PROMISING_SHARE * max(out[ranked[0]], 0.0) if ranked else 0.0
        released = _RELEASE_FACTOR
        if instead_of is not None:
            estimate = max(self.fits.gains(chosen, (instead_of,))[instead_of], 1e-12)
            fitted = self.in_sample_loss(chosen) - self.in_sample_loss(chosen | {instead_of})
            released *= max(fitted / estimate, 1.0)
        for k, term in enumerate(ranked):
            may_exceed = released * (out[term] + costs[term]) - costs[term] > above
            # Beyond the largest number of fits, only terms that gain nearly as much as the best one are fitted.
            promising = out[term] > least and (k < _MOST_FITTED_CANDIDATES or out[term] > 0.8 * out[ranked[0]])
            if may_exceed and (promising or term in removed):
                with_term = (chosen - removed[term]) | {term}
                out[term] = self.in_sample_loss(chosen) - self.in_sample_loss(with_term) - costs[term]
        return out

    def can_join(self, chosen: frozenset[Term], term: Term) -> bool:
        """True unless a term is in the set already, or is a special case of one of its effects (`contained_in`)."""
        return term not in chosen and chosen.isdisjoint(self.contained_in(term))

    def price_of(self, chosen: frozenset[Term]) -> float:
        """Price of the parameters of a set."""
        return sum(self.prices[term] for term in chosen)

    @cached_property
    def prices(self) -> dict[Term, float]:
        """Price of the parameters of each candidate."""
        return {term: price(size) for term, size in self.counts.items()}

    def parameter_count(self, chosen: frozenset[Term]) -> int:
        """Number of parameters of a set, as in `counts`."""
        return sum(self.counts[term] for term in chosen)


def price(size: int) -> float:
    """Price of an effect with ``size`` parameters, as in BIC.

    Parameters beyond the fourth cost one each, which is their expected gain by chance.
    """
    return above_chance.PARAMETER_PRICE * min(size, 4) + max(size - 4, 0)


def most_fits(joints: int) -> int:
    """Number of fits after which a search is stopped, because it seems to replace one set by another without end."""
    return joints * (_MOST_FITS if joints < _MANY_JOINTS else _MOST_FITS_OF_MANY)


def parameter_counts(problem: Problem, terms: tuple[Term, ...]) -> dict[Term, int]:
    """Number of parameters of each term that change the torque of these recordings independently.

    It is the rank of the term's columns plus the number of its shape parameters.
    """
    out: dict[Term, int] = {}
    a = problem.grams.everything
    for count in {len(term.columns) for term in terms}:
        same_size = [term for term in terms if len(term.columns) == count]
        index = np.array([term.columns for term in same_size])
        scale = np.sqrt(np.einsum("tkk->tk", a[index[:, :, None], index[:, None, :]]))
        not_zero = scale > 1e-9 * np.maximum(scale.max(axis=1, keepdims=True), 1e-300)
        # A column of zeros adds nothing to the rank.
        inverse = np.where(not_zero, 1.0 / np.where(not_zero, scale, 1.0), 0.0)
        normal = a[index[:, :, None], index[:, None, :]] * inverse[:, :, None] * inverse[:, None, :]
        values = np.linalg.eigvalsh(normal)
        ranks = np.sum(values > 1e-7 * np.maximum(values[:, -1:], 1e-300), axis=1)
        for term, rank in zip(same_size, ranks.tolist(), strict=True):
            shape_parameters = 0 if term.effect.shape_is_estimate or not rank else len(term.shape)
            out[term] = min(rank + shape_parameters, term.size)
    return out


def set_up_search(
    problem: Problem,
    threshold: Threshold,
    gaps: RowGaps,
    spurious: dict[tuple[str, str | None], float],
    record: Record | None = None,
    allowed: Iterator[int] | None = None,
) -> Search:
    """A search over all terms whose columns are not zero in the recordings.

    Args:
        problem: Columns, products, priors.
        threshold: Held-out gains that claims need.
        gaps: Gap of each joint.
        spurious: Gain of each effect from encoder noise alone, by its name and joint.
        record: Earlier decisions on each effect; None for an empty record.
        allowed: Yields one item for each fit that may be made; None for no limit.
    """
    counts = parameter_counts(problem, problem.columns.terms)
    terms = tuple(term for term in problem.columns.terms if counts[term] > 0)
    removed_by, contained_in = relations(problem.columns.terms)
    fits, record = Fits(problem, allowed), Record() if record is None else record
    return Search(problem, terms, counts, fits, removed_by, contained_in, threshold, gaps, spurious, record)


def with_wide_tolerances(search: Search) -> Search:
    """The search with three times the stated tolerances of the model, and the same candidates and prices."""

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
