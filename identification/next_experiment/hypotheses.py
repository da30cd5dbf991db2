"""A finding and its rivals as fitted models, which predict the torque of another recording."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice, product

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.result import EffectAt, Finding
from identification.diagnosis.search.containment import contains, with_term
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.swaps import replaced
from phantom_dyn.array_types import Array, Float, Int

# Shapes of one law that are kept: a rival may take another one to fit what another has made.
_VARIANTS = 3
# A shape is kept if it costs at most this much more than the best one, in squared standard deviations.
_CLOSE = 8.0
# Combinations of shapes of one set of effects that are looked at.
_COMBINATIONS = 60
# Hypotheses of one finding that are compared, the likeliest first.
_MOST = 5


@dataclass(frozen=True)
class Variant:
    """A set of effects with their shapes, fitted to the recordings.

    Attributes:
        terms: All effects of the model.
        fitted: Coefficients.
        score: Loss in sample with the price of the parameters.
    """

    terms: frozenset[Term]
    fitted: Fitted
    score: float


@dataclass(frozen=True)
class Hypothesis:
    """One explanation of what a finding explains.

    Attributes:
        effects: What it blames in the finding's place.
        probability: Its share of bootstrap wins.
        variants: Its fits, the best first.
    """

    effects: tuple[EffectAt, ...]
    probability: float
    variants: tuple[Variant, ...]

    def contains(self, other: Hypothesis) -> bool:
        """True if the other one is a special case of this one."""
        mine, theirs = self.variants[0].terms, other.variants[0].terms
        return any(contains(rich, simple) for rich in mine - theirs for simple in theirs - mine)


@dataclass(frozen=True)
class Model:
    """A fitted variant as ``basis @ y + shift`` among the columns ``union``, with the cost ``prior @ y**2``.

    Attributes:
        theta: Its coefficients, ``(u,)``.
        basis: Of what a fit may move, ``(u, n)``.
        shift: What no fit moves, ``(u,)``.
        prior: Precision of each number, ``(n,)``.
        lower, upper: Bounds of each number, ``(n,)``.
        moves: Which of the numbers are moves within the tolerances, ``(n,)``.
        score: Held-out loss of the variant, see `Variant`.
        columns: Places of its effects' columns in the union.
    """

    theta: Float[Array, " u"]
    basis: Float[Array, "u n"]
    shift: Float[Array, " u"]
    prior: Float[Array, " n"]
    lower: Float[Array, " n"]
    upper: Float[Array, " n"]
    moves: Array
    score: float
    columns: tuple[int, ...]

    @property
    def y(self) -> Float[Array, " n"]:
        """Parameters of the fit."""
        return self.theta[self._rows]

    @property
    def _rows(self) -> Int[Array, " n"]:
        return np.argmax(self.basis == 1.0, axis=0)


def hypotheses_of(search: Search, chosen: frozenset[Term], finding: Finding) -> tuple[Hypothesis, ...]:
    """The finding and its rivals, the likeliest first; empty if it is not one of the chosen effects or has no rival.

    Args:
        search: Knows all effects and fits them.
        chosen: The set that the diagnosis has found.
        finding: One of them, as the diagnosis states it.
    """
    place = (finding.effect, finding.joint)
    term = next((other for other in chosen if other.place == place), None)
    if term is None or not finding.rivals:
        return ()
    causes = [((EffectAt(*place, words=finding.words),), finding.probability)]
    causes += [(rival.effects, rival.probability) for rival in finding.rivals]
    out = []
    for effects, probability in sorted(causes, key=lambda one: -one[1])[:_MOST]:
        variants = _variants(search, chosen, term, effects)
        if variants:
            out.append(Hypothesis(effects, probability, variants))
    return tuple(out) if len(out) > 1 else ()


def with_all_findings(search: Search, chosen: frozenset[Term], findings: tuple[Finding, ...]) -> frozenset[Term]:
    """The set that the search has found, with every finding of the diagnosis in it.

    Where a rival leads in the diagnosis, it is the finding in the place of what the search had found; without this no
    fits would compare its own rivals.

    Args:
        search: Knows all effects and fits them.
        chosen: What it has found.
        findings: Those of the diagnosis.
    """
    found_places = {(finding.effect, finding.joint) for finding in findings}
    for finding in findings:
        place = (finding.effect, finding.joint)
        shapes = [term for term in search.terms if term.named and term.place == place]
        if not shapes or any(term.place == place for term in chosen):
            continue
        rivals = {(at.effect, at.joint) for rival in finding.rivals for at in rival.effects}
        gone = frozenset(
            term
            for term in chosen
            if term.place not in found_places
            and (term.place in rivals or any(contains(term, shape) for shape in shapes))
        )
        chosen = min((with_term(chosen - gone, shape) for shape in shapes), key=search.quick)
    return chosen


def union_of(hypotheses: tuple[Hypothesis, ...]) -> Int[Array, " u"]:
    """All columns that any hypothesis uses and all moves of the model, which come first."""
    fits = [variant.fitted for one in hypotheses for variant in one.variants]
    # What no recording so far has shown may show in the next one.
    used = {int(k) for found in fits for k in (*range(found.problem.nuisances), *found.active)}
    return np.array(sorted(used), dtype=int)


def model_of(search: Search, variant: Variant, union: Int[Array, " u"]) -> Model:
    """A variant among the columns of a union."""
    problem, found = search.problem, variant.fitted
    at = np.searchsorted(union, found.active)
    expand = np.eye(len(at)) if found.expand is None else found.expand
    all_moves, fitted = problem.nuisances, len(problem.moves)
    basis = np.zeros((len(union), all_moves + expand.shape[1] - fitted))
    basis[:all_moves, :all_moves] = np.eye(all_moves)
    basis[at[fitted:], all_moves:] = expand[fitted:, fitted:]
    theta = found.theta[union]
    # The first unit entry of a column is the coefficient that its number is.
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
        columns < problem.nuisances,
        variant.score,
        tuple(k for k, column in enumerate(union.tolist()) if column in effects),
    )


def _variants(
    search: Search, chosen: frozenset[Term], term: Term, effects: tuple[EffectAt, ...]
) -> tuple[Variant, ...]:
    """Fits of a set of effects in the place of a term, over the shapes of their laws."""
    options = [
        [other for other in search.terms if other.named and other.place == (at.effect, at.joint)] for at in effects
    ]
    sets = {}
    for group in islice(product(*options), _COMBINATIONS):
        others = frozenset(group)
        swapped = replaced(chosen, term, others)
        if others <= swapped:
            sets[swapped] = search.quick(swapped) + search.price_of(swapped)
    ranked = sorted(sets, key=lambda one: (sets[one], sorted(other.columns for other in one)))[:_VARIANTS]
    return tuple(
        Variant(one, search.evaluate(one), sets[one]) for one in ranked if sets[one] <= sets[ranked[0]] + _CLOSE
    )
