"""Chosen effects as findings: parameters, share of the gap that each closes, and rivals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.stats import chi2

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.gap import Sums, held_out_torque, residual_after, sums
from identification.diagnosis.fit.joint_fit import JointFit, joint_fit
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.judged_band import Judge, gap_is_there, visible
from identification.diagnosis.judge.parameters import finding_loadings, finding_parameters
from identification.diagnosis.model.session import Series
from identification.diagnosis.model.terms import Term, ordered
from identification.diagnosis.result import Finding
from identification.diagnosis.search.rival_sets import block_counts, stand
from identification.diagnosis.search.search import Search
from phantom_dyn.random_streams import random_stream

Array = np.ndarray


@dataclass(frozen=True)
class Shown:
    """Effects that are shown to the user, and their fits in the judged band.

    Attributes:
        plain: The search with plain fits in the judged band.
        chosen: The effects, structures without a name among them.
        joint_fit: Fit of all their numbers at once.
    """

    plain: Search
    chosen: frozenset[Term]
    joint_fit: JointFit

    @property
    def problem(self) -> Problem:
        """The plain problem."""
        return self.plain.problem

    @property
    def named(self) -> frozenset[Term]:
        """Effects of the catalogue."""
        return frozenset(term for term in self.chosen if term.named)

    @property
    def found(self) -> Fitted:
        """Held-out fit of the named effects."""
        return self.plain.evaluate(self.named)


def shown_effects(plain: Search, chosen: frozenset[Term], noise: Series) -> Shown:
    """Chosen effects that are visible in the judged band and differ from zero there; none where there is no gap."""
    kept = visible(plain, chosen)
    if not gap_is_there(plain.problem, noise):
        kept = frozenset()
    return Shown(plain, *distinct(plain, kept))


def distinct(plain: Search, chosen: frozenset[Term]) -> tuple[frozenset[Term], JointFit]:
    """Removes effects whose coefficients do not differ from zero in a joint fit of all, and returns that fit.

    The search holds all but the coefficients, and weighs noise otherwise: what gains there may be nothing in the fit
    that states its size. Only linear laws are tested: the size of others is in their shape. Nor is what
    goes with accelerations: a torque constant and a load are correlated with each other and with the tolerances, so
    that neither differs from zero beside the other.
    """
    while True:
        fitted = joint_fit(plain.problem, ordered(chosen), plain.evaluate(chosen))
        certain = {term: certainty(term, fitted) for term in ordered(chosen) if term.named and _is_asked(term)}
        least = min(certain, key=lambda term: certain[term], default=None)
        if least is None or certain[least] >= rules.DIFFERS_FROM_ZERO:
            return chosen, fitted
        chosen = chosen - {least}


def _is_asked(term: Term) -> bool:
    return term.effect.tested_against_zero or not (term.shape or term.effect.uses_acceleration)


def certainty(term: Term, fitted: JointFit) -> float:
    """Probability that chance keeps the coefficients of an effect that is not there nearer to zero (Wald's test)."""
    at = fitted.place(term).coefficients
    x, cov = fitted.x[at], fitted.cov[at, at]
    return float(chi2.cdf(x @ np.linalg.pinv(cov, rcond=1e-9, hermitian=True) @ x, len(x)))


def findings_without(
    search: Search, shown: Shown, settled: frozenset[Term], judge: Judge, before: Sums
) -> tuple[tuple[Finding, Series], ...]:
    """Each named effect with its gap closed and rivals, and the torque of the other named ones without it.

    Args:
        search: Rivals, with fits to white noise.
        shown: The effects that are shown.
        settled: All that the search has found, those too that nobody would see: a rival must not win by making up for
            one of them.
        judge: Of the gap.
        before: Loss of the given model.
    """
    plain, chosen, fitted = shown.plain, shown.chosen, shown.joint_fit
    robot = plain.problem.session.robot
    problem, floor, found = plain.problem, judge.floor, plain.evaluate(chosen)
    after = sums(problem, judge.narrow(residual_after(problem, held_out_torque(problem, chosen, found))))
    counts = block_counts(len(before.counts), random_stream("bootstrap of the gap closed"))
    once = np.ones((1, len(before.counts)))
    out = []
    for term in ordered(chosen):
        if not term.named:
            continue
        others = frozenset(other for other in chosen if other.named and other is not term)
        without = plain.evaluate(chosen - {term})
        torque = held_out_torque(problem, chosen - {term}, without)
        lost = sums(problem, judge.narrow(residual_after(problem, torque)))

        def closed(weights: Float[Array, "R B"], lost: Sums = lost) -> Float[Array, " R"]:
            gap = np.maximum(before.loss(floor, weights) - 1.0, 1e-9)
            return (lost.loss(floor, weights) - after.loss(floor, weights)) / gap

        standing = stand(search, settled, term)
        low, high = np.percentile(closed(counts), [2.5, 97.5])
        finding = Finding(
            effect=term.effect.name,
            joint=term.joint,
            regime=term.effect.regime,
            parameters=finding_parameters(robot, term, fitted),
            gap_closed=float(closed(once)[0]),
            gap_closed_interval=(float(low), float(high)),
            probability=standing.probability,
            rivals=standing.rivals,
            verdict="one_of" if standing.rivals else "supported",
            loadings=finding_loadings(robot, term, fitted),
        )
        if others != chosen - {term}:
            torque = held_out_torque(problem, others, plain.evaluate(others))
        out.append((finding, torque))
    return tuple(out)
