"""Expresses a finding and its rivals as fitted models, which predict the torque of another recording."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.result import EffectAt, Finding
from identification.diagnosis.search.containment import contains, with_term
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.swaps import with_replacement
from phantom_dyn.array_types import Array, Float, Int

# Largest number of shapes (such as Stribeck velocities) of one law that are kept: another shape of a rival may fit the
# torque of the true effect better.
_VARIANTS = 3
# A shape is kept if its loss is at most this much larger than that of the best shape, in squared standard deviations.
_CLOSE = 8.0
# Largest number of combinations of shapes of one set of effects that are fitted.
_COMBINATIONS = 60
# Largest number of hypotheses of one finding that are compared; the most probable ones are taken.
_MOST = 5


@dataclass(frozen=True)
class Variant:
    """A set of effects with their shapes, fitted to the recordings.

    Attributes:
        terms: All effects of the model.
        fitted: Fit of the model.
        score: In-sample loss plus the price of the parameters.
    """

    terms: frozenset[Term]
    fitted: Fitted
    score: float


@dataclass(frozen=True)
class Hypothesis:
    """One explanation of the same residual: the finding itself, or a rival.

    Attributes:
        effects: The effect of the finding, or the effects of the rival.
        probability: Probability of this explanation in the diagnosis.
        variants: Fits with different shapes, the best first.
    """

    effects: tuple[EffectAt, ...]
    probability: float
    variants: tuple[Variant, ...]

    def contains(self, other: Hypothesis) -> bool:
        """True if the other hypothesis is a special case of this one."""
        mine, theirs = self.variants[0].terms, other.variants[0].terms
        return any(contains(rich, simple) for rich in mine - theirs for simple in theirs - mine)


@dataclass(frozen=True)
class Model:
    """A fitted variant, expressed in the columns that several variants use together (their union).

    With parameters ``y`` the coefficients of these columns are ``basis @ y + shift``, and the cost is ``prior @ y**2``.

    Attributes:
        theta: Coefficients of the columns at the fit, ``(u,)``.
        basis: Derivatives of the coefficients by the parameters, ``(u, n)``.
        shift: Constant part of the coefficients, ``(u,)``.
        prior: Prior precision of each parameter, ``(n,)``.
        lower: Least value of each parameter, ``(n,)``.
        upper: Largest value of each parameter, ``(n,)``.
        is_nuisance: True for tolerance parameters, ``(n,)``.
        score: In-sample loss plus the price of the parameters.
        columns: Indices in the union of the columns of the variant's effects.
    """

    theta: Float[Array, " u"]
    basis: Float[Array, "u n"]
    shift: Float[Array, " u"]
    prior: Float[Array, " n"]
    lower: Float[Array, " n"]
    upper: Float[Array, " n"]
    is_nuisance: Array
    score: float
    columns: tuple[int, ...]

    @property
    def y(self) -> Float[Array, " n"]:
        """Parameters of the fit, shape ``(n,)``."""
        return self.theta[self._rows]

    @property
    def _rows(self) -> Int[Array, " n"]:
        """For each parameter, the coefficient that is equal to it."""
        return np.argmax(self.basis == 1.0, axis=0)


def hypotheses_of(search: Search, chosen: frozenset[Term], finding: Finding) -> tuple[Hypothesis, ...]:
    """The finding and its rivals, the most probable first; empty without rivals, or if ``chosen`` lacks the finding.

    Args:
        search: The search, which fits sets of effects.
        chosen: The set of effects that the search has chosen.
        finding: A finding of the diagnosis.
    """
    cause = (finding.effect, finding.joint)
    term = next((other for other in chosen if other.effect_joint == cause), None)
    if term is None or not finding.rivals:
        return ()
    causes = [((EffectAt(*cause, words=finding.words),), finding.probability)]
    causes += [(rival.effects, rival.probability) for rival in finding.rivals]
    out = []
    for effects, probability in sorted(causes, key=lambda one: -one[1])[:_MOST]:
        variants = _variants(search, chosen, term, effects)
        if variants:
            out.append(Hypothesis(effects, probability, variants))
    return tuple(out) if len(out) > 1 else ()


def with_all_findings(search: Search, chosen: frozenset[Term], findings: tuple[Finding, ...]) -> frozenset[Term]:
    """The set that the search has chosen, changed so that it contains every finding of the diagnosis.

    The diagnosis may name a more probable rival as its finding, in place of the effect that the search chose. The rival
    then has to replace this effect in the set, before its own rivals can be compared with it.

    Args:
        search: The search, which fits sets of effects.
        chosen: The set of effects that the search has chosen.
        findings: Findings of the diagnosis.
    """
    found_causes = {(finding.effect, finding.joint) for finding in findings}
    for finding in findings:
        cause = (finding.effect, finding.joint)
        shapes = [term for term in search.terms if term.named and term.effect_joint == cause]
        if not shapes or any(term.effect_joint == cause for term in chosen):
            continue
        rivals = {(at.effect, at.joint) for rival in finding.rivals for at in rival.effects}
        replaced = frozenset(
            term
            for term in chosen
            if term.effect_joint not in found_causes
            and (term.effect_joint in rivals or any(contains(term, shape) for shape in shapes))
        )
        chosen = min((with_term(chosen - replaced, shape) for shape in shapes), key=search.in_sample_loss)
    return chosen


def union_of(hypotheses: tuple[Hypothesis, ...]) -> Int[Array, " u"]:
    """Indices of all tolerance parameters, then of all columns that any hypothesis uses."""
    fits = [variant.fitted for one in hypotheses for variant in one.variants]
    # Even tolerance parameters that no fit uses are included, because the next recording may depend on them.
    used = {int(k) for found in fits for k in (*range(found.problem.nuisance_count), *found.active)}
    return np.array(sorted(used), dtype=int)


def model_of(variant: Variant, union: Int[Array, " u"]) -> Model:
    """A variant expressed in the columns of a union."""
    fit = variant.fitted
    # The fit's own problem is used: its tolerance parameters may differ from those of the search's problem.
    problem = fit.problem
    at = np.searchsorted(union, fit.active)
    expand = np.eye(len(at)) if fit.expansion is None else fit.expansion
    # The parameters are all tolerance parameters, those that the fit did not use included, and those of the effects.
    nuisances, used = problem.nuisance_count, len(problem.fitted_nuisances)
    basis = np.zeros((len(union), nuisances + expand.shape[1] - used))
    basis[:nuisances, :nuisances] = np.eye(nuisances)
    basis[at[used:], nuisances:] = expand[used:, used:]
    theta = fit.theta[union]
    # The first 1 in a column of the basis marks the coefficient that is equal to the parameter.
    rows = np.argmax(basis == 1.0, axis=0)
    columns = union[rows]
    effects = {column for term in variant.terms for column in term.columns}
    return Model(
        theta,
        basis,
        theta - basis @ theta[rows],
        problem.precision[columns],
        problem.lower[columns],
        problem.upper[columns],
        columns < problem.nuisance_count,
        variant.score,
        tuple(k for k, column in enumerate(union.tolist()) if column in effects),
    )


def _variants(
    search: Search, chosen: frozenset[Term], term: Term, effects: tuple[EffectAt, ...]
) -> tuple[Variant, ...]:
    """The best fits of a set of effects in place of a term, for different shapes of the effects' laws."""
    options = [
        [other for other in search.terms if other.named and other.effect_joint == (at.effect, at.joint)]
        for at in effects
    ]
    scores: dict[frozenset[Term], float] = {}
    for group in islice(product(*options), _COMBINATIONS):
        others = frozenset(group)
        swapped = with_replacement(chosen, term, others)
        if others <= swapped:
            scores[swapped] = search.in_sample_loss(swapped) + search.price_of(swapped)
    # The columns decide between equal scores, so that the order does not depend on that of the sets.
    ranked = sorted(scores, key=lambda terms: (scores[terms], sorted(one.columns for one in terms)))[:_VARIANTS]
    close = [terms for terms in ranked if scores[terms] <= scores[ranked[0]] + _CLOSE]
    return tuple(Variant(terms, search.held_out_fit(terms), scores[terms]) for terms in close)
