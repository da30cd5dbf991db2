"""Which set of effects explains the residual: stepwise in, out again, and swapped for simpler or better ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
from jaxtyping import Float

from identification.diagnosis.fitting import Fitted, fit
from identification.diagnosis.problem import Problem
from identification.diagnosis.projection import Beside, beside, gain_of
from identification.diagnosis.terms import Term
from phantom_dyn.effects.payload import Payload

Array = np.ndarray

# What a parameter has to earn on held-out data, beyond what it costs there, to be preferred to doing without it:
# about the logarithm of the effective number of samples, as in the Bayesian information criterion.
PARAMETER_PRICE = 5.0
# Standard errors over blocks by which a gain has to be positive, unless it is very large.
_SIGNIFICANT = 2.0
_MOST_TERMS = 40
# A gain has to be this many times what encoder noise alone gives, beyond what chance gives.
_SPURIOUS = 2.0
# Rivals that are judged on held-out data in one step, the best in sample.
_MOST_JUDGED = 24
# Rivals that are fitted to know their gains in sample: the best ranked, with at least this share of the best gain.
_MOST_FITTED = 30
_WORTH_FITTING = 0.2
# By how many thresholds a structure has to be better than the named effects whose place it takes, by their number:
# several effects together that do no better than one structure are the less likely cause.
_MARGIN = (1.0, 1.0, 0.0, -0.5)
# Structures without a name that are taken in, and how many of them are judged on held-out data in one step.
_MOST_NAMELESS = 4
_NAMELESS_JUDGED = 8
# Swaps that are evaluated on held-out data, the best in sample.
_WORTH_TRYING = 8


@dataclass(frozen=True)
class Search:
    """Rivals of one problem and how sets of them are judged.

    Attributes:
        problem: What is fitted.
        terms: All rivals.
        sizes: Number of parameters that each rival really adds (its rank), by rival.
        evaluate: Fit with held-out losses of a set of rivals, remembered.
        quick: Loss in sample of a set of rivals, a tenth of the work; it ranks what is worth evaluating.
        besides: All columns with what a set can make of them taken out, remembered.
        threshold: Held-out gain below which no effect is claimed.
        row_thresholds: The same for the part of the gain on each row, ``(nv,)``: what touches a row with a large gap
            has to close a fair part of it.
        spurious: What encoder noise alone lets each effect gain.
    """

    problem: Problem
    terms: tuple[Term, ...]
    sizes: dict[Term, int]
    evaluate: Callable[[frozenset[Term]], Fitted]
    quick: Callable[[frozenset[Term]], float]
    besides: Callable[[frozenset[Term]], Beside]
    threshold: float
    row_thresholds: Float[Array, " nv"]
    spurious: dict[tuple[str, str | None], float]

    def score(self, chosen: frozenset[Term]) -> float:
        """Held-out loss plus the price of the parameters; lower is better.

        A hair is added for parameters that add no rank, so that of exact twins the one that says less is named.
        """
        return self.evaluate(chosen).total + self.price_of(chosen) + 0.02 * sum(term.size for term in chosen)

    def gains(self, chosen: frozenset[Term], terms: tuple[Term, ...]) -> dict[Term, float]:
        """What each term gains in sample beside a set, less the price of its parameters.

        All are ranked with the bounds that bind the set held; the best of them are then fitted.
        """
        besides = self.besides(chosen)
        costs = {term: price(self.sizes[term]) - self.price_of(chosen - with_term(chosen, term)) for term in terms}
        out = {term: gain_of(self.problem, besides, term) - costs[term] for term in terms}
        ranked = sorted(terms, key=lambda term: -out[term])
        least = _WORTH_FITTING * max(out[ranked[0]], 0.0) if ranked else 0.0
        for k, term in enumerate(ranked):
            richer = not chosen <= with_term(chosen, term)
            if richer or (out[term] > least and (k < _MOST_FITTED or out[term] > 0.8 * out[ranked[0]])):
                out[term] = self.quick(chosen) - self.quick(with_term(chosen, term)) - costs[term]
        return out

    def price_of(self, chosen: frozenset[Term]) -> float:
        """Price of the parameters of a set."""
        return sum(price(self.sizes[term]) for term in chosen)

    def sizes_of(self, chosen: frozenset[Term]) -> int:
        """Number of parameters of a set."""
        return sum(self.sizes[term] for term in chosen)


def price(size: int) -> float:
    """What an effect with ``size`` parameters has to earn; beyond four, each costs what chance gives it."""
    return PARAMETER_PRICE * min(size, 4) + max(size - 4, 0)


def ordered(terms: Iterable[Term]) -> tuple[Term, ...]:
    """Terms in the order of their columns, so that results do not depend on the order of a set."""
    return tuple(sorted(terms, key=lambda term: (term.columns, term.place[0])))


def rank_of(problem: Problem, term: Term) -> int:
    """Independent directions among a term's columns in these recordings, at most its number of parameters."""
    index = list(term.columns)
    a = problem.grams.a[:, index][:, :, index].sum(axis=0)
    scale = np.sqrt(np.diag(a))
    alive = scale > 1e-9 * max(float(scale.max()), 1e-300)
    if not alive.any():
        return 0
    normal = a[np.ix_(alive, alive)] / np.outer(scale[alive], scale[alive])
    values = np.linalg.eigvalsh(normal)
    rank = int(np.sum(values > 1e-7 * values[-1]))
    return min(rank + (0 if term.effect.shape_is_estimate else len(term.shape)), term.size)


def set_up_search(
    problem: Problem,
    threshold: float,
    row_thresholds: Float[Array, " nv"],
    spurious: dict[tuple[str, str | None], float],
) -> Search:
    """A search over all terms that leave any trace in the recordings."""
    sizes = {term: rank_of(problem, term) for term in problem.columns.terms}
    terms = tuple(term for term in problem.columns.terms if sizes[term] > 0)

    # A payload is found by iteration; the one of the last fit is a good start for the next.
    nearby: dict[str, Float[Array, " 4"]] = {}

    def fitted(chosen: frozenset[Term], held_out: bool) -> Fitted:
        found = fit(problem, ordered(chosen), held_out=held_out, near=nearby.get("payload"))
        for term in chosen:
            if isinstance(term.effect, Payload):
                nearby["payload"] = found.theta[list(term.columns[:4])]
        return found

    @cache
    def evaluate(chosen: frozenset[Term]) -> Fitted:
        return fitted(chosen, True)

    @cache
    def quick(chosen: frozenset[Term]) -> float:
        return fitted(chosen, False).objective

    @cache
    def besides(chosen: frozenset[Term]) -> Beside:
        return beside(problem, fitted(chosen, False))

    return Search(problem, terms, sizes, evaluate, quick, besides, threshold, row_thresholds, spurious)


def contains(rich: Term, simple: Term) -> bool:
    """True if ``simple`` is a special case of ``rich``."""
    if rich is simple:
        return False
    if set(simple.columns) < set(rich.columns):
        return True
    if simple.effect.name in rich.effect.contains:
        return simple.joint == rich.joint or set(simple.columns) == set(rich.columns)
    return False


def with_term(chosen: frozenset[Term], term: Term) -> frozenset[Term]:
    """``chosen`` and ``term``, without its special cases and without the same effect of another shape."""
    kept = (other for other in chosen if not contains(term, other) and not _exclude(term, other))
    return frozenset([*kept, term])


def _exclude(one: Term, other: Term) -> bool:
    """The same effect of another shape, or two rich friction laws on one joint, which collapse into the better."""
    if one.place == other.place:
        return True
    shared = set(one.effect.contains) & set(other.effect.contains)
    return bool(shared) and one.joint == other.joint


def possible(chosen: frozenset[Term], term: Term) -> bool:
    """False if ``term`` is there already, or a special case of what is."""
    return term not in chosen and not any(contains(other, term) for other in chosen)


def least_gain(search: Search, terms: frozenset[Term]) -> float:
    """Held-out gain that a claim of these effects needs: more than chance, and a fair part of the gap it touches."""
    rows = sorted(set().union(*(rows_of(search.problem, term) for term in terms)))
    noise = sum(search.spurious.get(term.place, 0.0) for term in terms)
    return max(search.threshold, float(search.row_thresholds[rows].sum())) + _SPURIOUS * noise


def claimed(search: Search, chosen: frozenset[Term], without: frozenset[Term]) -> bool:
    """True if what ``chosen`` has beyond ``without`` gains on held-out data what chance does not.

    The gain has to be above the threshold, in sample too, and either positive from block to block or above the
    threshold without its best block too; a gain ten times the threshold may sit in few blocks only, as that of an
    effect that acts rarely does.
    """
    rich, plain = search.evaluate(chosen), search.evaluate(without)
    # In sample a gain can only be larger, unless chance has made the few held-out blocks agree.
    gain = min(plain.total - rich.total, plain.objective - rich.objective)
    gains = plain.loss - rich.loss
    extra = search.price_of(chosen) - search.price_of(without)
    needed = least_gain(search, chosen - without) + max(extra - PARAMETER_PRICE, 0.0)
    error = float(np.sqrt(len(gains)) * gains.std()) + 1e-12
    lasting = gain > _SIGNIFICANT * error or gain - float(gains.max()) > needed
    return gain > needed and (lasting or gain > 10 * needed)


def explain(search: Search, progress: Callable[[str], None], start: frozenset[Term] = frozenset()) -> frozenset[Term]:
    """The set of effects that explains the recordings with the fewest parameters.

    Args:
        search: Problem, rivals, threshold.
        progress: Told in words what is being done.
        start: What an earlier search has found.
    """
    chosen = _drop(search, frozenset(term for term in start if term.named))
    for _ in range(4):
        before = chosen
        chosen = _forward(search, chosen, progress)
        progress("weighing alternatives")
        chosen = _swap(search, _drop(search, chosen))
        if chosen == before:
            break
    return _nameless(search, chosen, progress)


def best_short(search: Search, chosen: frozenset[Term]) -> frozenset[Term] | None:
    """The set with the named effect in it that gains most beside ``chosen``, if it gains more than its price."""
    rivals = tuple(term for term in search.terms if term.named and possible(chosen, term))
    promised = search.gains(chosen, rivals)
    best = sorted(rivals, key=lambda term: -promised[term])[:_NAMELESS_JUDGED]
    tried = min((with_term(chosen, term) for term in best), key=search.score, default=None)
    return tried if tried is not None and search.score(tried) < search.score(chosen) else None


def _nameless(search: Search, chosen: frozenset[Term], progress: Callable[[str], None]) -> frozenset[Term]:
    """Structures that the catalogue has no name for, added to what it explains or put in its place.

    A structure has to gain what any claim has to gain beyond the best that named effects do; what it makes needless
    is then dropped. One that stands for several effects at a lower price takes their place.
    """
    progress("looking for what has no name")
    nameless = tuple(term for term in search.terms if not term.named)
    for _ in range(_MOST_NAMELESS):
        best, lowest = None, search.score(chosen)
        for base in {chosen, frozenset(term for term in chosen if not term.named)}:
            promised = search.gains(base, nameless)
            for term in sorted(nameless, key=lambda term: -promised[term])[:_NAMELESS_JUDGED]:
                if promised[term] < search.threshold or not possible(base, term):
                    continue
                tried = _drop_named(search, with_term(base, term), chosen)
                limit = lowest - _MARGIN[min(len(chosen - tried), len(_MARGIN) - 1)] * search.threshold
                if search.score(tried) < limit and claimed(search, tried, tried - {term}):
                    best, lowest = tried, search.score(tried)
        if best is None:
            return chosen
        chosen = best
    return chosen


def _drop_named(search: Search, tried: frozenset[Term], chosen: frozenset[Term]) -> frozenset[Term]:
    """A set with a structure in it, with the named effects that it still needs and without the others."""
    for term in ordered(chosen):
        if term.named and possible(tried, term) and claimed(search, with_term(tried, term), tried):
            tried = with_term(tried, term) if with_term(tried, term) >= tried else tried
    while True:
        needless = [t for t in ordered(tried) if t.named and not claimed(search, tried, tried - {t})]
        if not needless:
            return tried
        tried = tried - {min(needless, key=lambda term: search.score(tried - {term}))}


def _forward(search: Search, chosen: frozenset[Term], progress: Callable[[str], None]) -> frozenset[Term]:
    """Add the effect that helps most until none helps more than chance.

    In sample a gain is larger than on held-out data, so rivals are judged there in the order of their gains in sample
    until none that is left can do better than the best so far.
    """
    while len(chosen) < _MOST_TERMS:
        progress(f"trying rivals, {len(chosen)} found")
        base = search.score(chosen)
        rivals = [term for term in search.terms if term.named and possible(chosen, term)]
        promised = search.gains(chosen, tuple(rivals))
        best, most = None, 0.0
        for term in sorted(rivals, key=lambda term: -promised[term])[:_MOST_JUDGED]:
            if promised[term] < max(most, search.threshold):
                break
            gain = base - search.score(with_term(chosen, term))
            if gain > most and claimed(search, with_term(chosen, term), chosen):
                best, most = term, gain
        if best is None:
            return chosen
        chosen = _drop(search, with_term(chosen, best))
    return chosen


def _drop(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """Take out, one by one, what is no longer needed."""
    while chosen:
        least = min(ordered(chosen), key=lambda term: search.score(chosen - {term}))
        if claimed(search, chosen, chosen - {least}):
            return chosen
        chosen = chosen - {least}
    return chosen


def alternatives(search: Search, term: Term) -> tuple[frozenset[Term], ...]:
    """Sets of effects that could stand for ``term``: single ones, and pairs and triples of its special cases."""
    single = [frozenset([other]) for other in search.terms if other.named and other.place != term.place]
    parts = [other for other in search.terms if contains(term, other) and other.joint == term.joint]
    several = [frozenset(group) for size in (2, 3) for group in combinations(parts, size)]
    same = [frozenset([other]) for other in search.terms if other.place == term.place and other is not term]
    return (*single, *several, *same)


def replaced(chosen: frozenset[Term], term: Term, others: frozenset[Term]) -> frozenset[Term]:
    """``chosen`` with ``others`` in place of ``term``."""
    out = chosen - {term}
    for other in ordered(others):
        if possible(out, other):
            out = with_term(out, other)
    return out


def _swap(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """Replace single effects by better or simpler ones until no swap lowers the score."""
    for _ in range(20):
        base, quick = search.score(chosen), search.quick(chosen) + search.price_of(chosen)
        tried = {
            replaced(chosen, term, others)
            for term in ordered(chosen)
            for others in relevant(search, chosen, term, 2 * PARAMETER_PRICE)
        }
        ranked = sorted(tried - {chosen}, key=lambda other: (search.quick(other) + search.price_of(other), _key(other)))
        better = [
            other
            for other in ranked[:_WORTH_TRYING]
            if search.quick(other) + search.price_of(other) < quick + PARAMETER_PRICE
            and search.score(other) < base - 1e-6
            # A richer set has to earn its place as any new claim has, or dropping it would undo the swap.
            and (search.price_of(other) <= search.price_of(chosen) or claimed(search, other, chosen))
        ]
        if not better:
            return chosen
        chosen = _drop(search, min(better, key=lambda other: (search.score(other), _key(other))))
    return chosen


def _key(chosen: frozenset[Term]) -> list[tuple[int, ...]]:
    """Something to break ties by that does not depend on the order of a set."""
    return [term.columns for term in ordered(chosen)]


def relevant(search: Search, chosen: frozenset[Term], term: Term, slack: float) -> tuple[frozenset[Term], ...]:
    """Alternatives of ``term`` that touch a joint that it touches and could gain in sample what it gains.

    Args:
        search: Rivals.
        chosen: A set with ``term`` in it.
        term: What is to be replaced.
        slack: By how much less an alternative may gain, prices counted.
    """
    rest = chosen - {term}
    rows = rows_of(search.problem, term)
    near = [
        others
        for others in alternatives(search, term)
        if any(rows & rows_of(search.problem, other) for other in others)
        and not any(contains(kept, other) for other in others for kept in rest)
    ]
    singles = tuple(other for others in near if len(others) == 1 for other in others if other not in rest)
    lost = search.quick(rest) - search.quick(chosen)
    promised = search.gains(rest, singles)
    # Promises are to second order, and may be off by a few per cent where a law is not linear.
    least = lost - price(search.sizes[term]) - max(slack, 0.05 * lost)
    return tuple(others for others in near if len(others) > 1 or promised.get(next(iter(others)), -np.inf) >= least)


def rows_of(problem: Problem, term: Term) -> frozenset[int]:
    """Joints whose torque a term touches."""
    return problem.touched[term.columns[0]]
