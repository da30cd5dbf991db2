"""Rivals and the score of a set of them: held-out loss plus a BIC-like price, with thresholds from chance.

A claim has to gain more on held-out data than chance gives over the whole catalogue, or on one joint.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np

from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.gap import row_counts
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.gates import above_chance, fair_part
from identification.diagnosis.gates.above_chance import more_than_chance
from identification.diagnosis.gates.fair_part import fair_part_of_the_gap
from identification.diagnosis.gates.over_blocks import in_enough_blocks
from identification.diagnosis.gates.possible import possible_size
from identification.diagnosis.search.fits import Fits
from identification.diagnosis.search.record import Record
from identification.diagnosis.search.row_gaps import RowGaps
from identification.diagnosis.search.special_cases import ends_on_nothing
from identification.engine.claims import GateResult, until_failed
from phantom_dyn.array_types import Float


@dataclass(frozen=True)
class Threshold:
    """Held-out gain below which no effect is claimed: what chance gives over the whole catalogue, or on one joint.

    Attributes:
        overall: What no effect reaches by chance.
        joints: The same for the effects of one joint, None for those of no single joint. Noise of a joint that nothing
            explains raises what chance seems to give there, which is no reason to doubt effects on others.
    """

    overall: float
    joints: dict[str | None, float]

    def of(self, *terms: Term) -> float:
        """Threshold of a claim of these effects together."""
        return max((min(self.joints.get(joint_of(term), self.overall), self.overall) for term in terms), default=0.0)

    def lowered(self, other: Threshold) -> Threshold:
        """The lower of two thresholds, overall and joint by joint."""
        joints = {
            joint: min(both.joints.get(joint, both.overall) for both in (self, other))
            for joint in {*self.joints, *other.joints}
        }
        return Threshold(min(self.overall, other.overall), joints)


def joint_of(term: Term) -> str | None:
    """The single joint that a term sits on, None if there is none (a coupling sits on two, joined by ``+``)."""
    return None if term.joint is None or "+" in term.joint else term.joint


Array = np.ndarray

# Joints beyond which effects on different ones are added, swapped and dropped in one step: one by one takes too long.
_MANY_JOINTS = 10
# Effects of a set without which it is fitted, those that it would miss least.
_MOST_TRIED = 12
# Rivals that are fitted to know their gains in sample: the best ranked, with at least this share of the best gain.
_MOST_FITTED = 30
_WORTH_FITTING = 0.2
# Score of an impossible set, more than any recording's loss.
_IMPOSSIBLE = 1e15


@dataclass(frozen=True)
class Search:
    """Rivals of one problem and the scores of sets of them.

    Attributes:
        problem: What is fitted.
        terms: All rivals.
        sizes: Number of parameters that each rival really adds (its rank), by rival.
        fits: Fits of sets of rivals, each made once.
        displacing: Rivals to which one gives way if they are added, itself among them, remembered.
        covering: Rivals that one is a special case of, remembered.
        threshold: What chance gives.
        rows: Gap of each row: what acts on a row with a large gap has to close a fair part of it.
        spurious: What encoder noise alone lets each effect gain.
        record: What was decided of each effect.
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

    @property
    def many_joints(self) -> bool:
        """True if effects on different joints are added, swapped and dropped in one step."""
        return len(self.problem.columns.rows) > _MANY_JOINTS

    @cached_property
    def alone(self) -> dict[Term, frozenset[Term]]:
        """The set of each rival by itself."""
        return {term: frozenset([term]) for term in self.terms}

    def of(self, chosen: frozenset[Term]) -> Search:
        """The same search on the columns that a set needs, see `Problem.of`."""
        fits = self.fits.of(chosen)
        return self if fits is self.fits else replace(self, problem=fits.problem, fits=fits)

    def evaluate(self, chosen: frozenset[Term]) -> Fitted:
        """Fit of a set with its held-out losses."""
        return self.fits.held_out(chosen)

    def quick(self, chosen: frozenset[Term]) -> float:
        """Loss of a set in sample."""
        return self.fits.in_sample(chosen)

    def score(self, chosen: frozenset[Term]) -> float:
        """Held-out loss plus the price of the parameters; lower is better.

        A hair is added for parameters that add no rank, so that of exact twins the one that says less is named. A
        size that nothing has, at the end of what is possible, is no explanation at all.
        """
        if chosen not in self._scores:
            self._scores[chosen] = self._score(chosen)
        return self._scores[chosen]

    @cached_property
    def _scores(self) -> dict[frozenset[Term], float]:
        return {}

    @cached_property
    def near(self) -> dict[Term, tuple[frozenset[Term], ...]]:
        """Alternatives of an effect that touch a joint that it touches, remembered; see `swaps.relevant`."""
        return {}

    def _score(self, chosen: frozenset[Term]) -> float:
        found = self.evaluate(chosen)
        if any(ends_on_nothing(self.problem.session.robot, term, found.theta[list(term.columns)]) for term in chosen):
            return _IMPOSSIBLE
        return found.total + self.price_of(chosen) + 0.02 * sum(term.size for term in chosen)

    def gains(self, chosen: frozenset[Term], terms: tuple[Term, ...], above: float = -np.inf) -> dict[Term, float]:
        """What each term gains in sample beside a set, less the price of its parameters.

        All are ranked with the bounds that bind the set held; the best of them are then fitted, and those that take the
        place of others, which gain no more without these than beside them, as far as they may gain what is asked for.

        Args:
            chosen: A set.
            terms: Rivals.
            above: A gain that is below this may be larger than stated, yet not above it.
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
        for k, term in enumerate(ranked):
            # Bounds that are held change a gain: there is room for as much again.
            worth = 2.0 * (out[term] + costs[term]) - costs[term] > above
            promising = out[term] > least and (k < _MOST_FITTED or out[term] > 0.8 * out[ranked[0]])
            if worth and (promising or term in gone):
                out[term] = self.quick(chosen) - self.quick((chosen - gone[term]) | {term}) - costs[term]
        return out

    def possible(self, chosen: frozenset[Term], term: Term) -> bool:
        """As `possible`, of rivals of this search: what contains them is known."""
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


def ranks_of(problem: Problem, terms: tuple[Term, ...]) -> dict[Term, int]:
    """Independent directions among the columns of each term in these recordings, at most its number of parameters."""
    out: dict[Term, int] = {}
    a = problem.grams.everything
    for count in {len(term.columns) for term in terms}:
        alike = [term for term in terms if len(term.columns) == count]
        index = np.array([term.columns for term in alike])
        scale = np.sqrt(np.einsum("tkk->tk", a[index[:, :, None], index[:, None, :]]))
        alive = scale > 1e-9 * np.maximum(scale.max(axis=1, keepdims=True), 1e-300)
        # A column that is not there leaves a direction of no size.
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
) -> Search:
    """A search over all terms that leave any trace in the recordings; it goes on with a record, or begins one."""
    sizes = ranks_of(problem, problem.columns.terms)
    terms = tuple(term for term in problem.columns.terms if sizes[term] > 0)
    displacing, covering = relations(problem.columns.terms)
    fits, kept = Fits(problem), Record() if record is None else record
    return Search(problem, terms, sizes, fits, displacing, covering, threshold, rows, spurious, kept)


def contains(rich: Term, simple: Term) -> bool:
    """True if ``simple`` is a special case of ``rich``."""
    if rich is simple:
        return False
    if simple.column_set < rich.column_set:
        return True
    if simple.effect.name in rich.effect.contains:
        return simple.joint == rich.joint or simple.column_set == rich.column_set
    return False


def with_term(chosen: frozenset[Term], term: Term) -> frozenset[Term]:
    """``chosen`` and ``term``, without its special cases and without the same effect of another shape."""
    kept = (other for other in chosen if not contains(term, other) and not _exclude(term, other))
    return frozenset([*kept, term])


def _exclude(one: Term, other: Term) -> bool:
    """The same effect of another shape, or two rich friction laws on one joint, which collapse into the better."""
    if one.joint != other.joint:
        return False
    return one.effect.name == other.effect.name or not set(one.effect.contains).isdisjoint(other.effect.contains)


def possible(chosen: frozenset[Term], term: Term) -> bool:
    """False if ``term`` is there already, or a special case of what is."""
    return term not in chosen and not any(contains(other, term) for other in chosen)


def relations(terms: tuple[Term, ...]) -> tuple[Callable[[Term], frozenset[Term]], Callable[[Term], frozenset[Term]]]:
    """For one of these terms, those to which it gives way, itself among them, and those that contain it."""
    near: dict[object, list[Term]] = defaultdict(list)
    for term in terms:
        # Only terms on one joint or with common columns have anything to do with each other.
        for key in (("joint", term.joint), *term.columns):
            near[key].append(term)

    def related(term: Term) -> set[Term]:
        return {other for key in (("joint", term.joint), *term.columns) for other in near[key]}

    @cache
    def displacing(term: Term) -> frozenset[Term]:
        return frozenset(other for other in related(term) if contains(other, term) or _exclude(other, term))

    @cache
    def covering(term: Term) -> frozenset[Term]:
        return frozenset(other for other in related(term) if contains(other, term))

    return displacing, covering


def least_gain(search: Search, terms: frozenset[Term], beside: frozenset[Term], by_row: Float[Array, " nv"]) -> float:
    """Held-out gain that a claim of these effects needs: more than chance, on joints where it closes a fair part.

    An effect may touch a joint with a large gap and act on another one: its gain counts only where it is a fair part of
    the gap. Of that gap, laws beside it that rigid bodies obey exactly have taken their part, and leave no more for
    what resembles them.

    Args:
        search: Thresholds of chance and gaps of the rows.
        terms: What is claimed.
        beside: Effects that are there without the claim.
        by_row: How the gain is spread over the joints, in any unit, ``(nv,)``.
    """
    parts = np.maximum(by_row, 0.0) / max(float(np.maximum(by_row, 0.0).sum()), 1e-300)
    fair = _fair_part(search, beside) / np.maximum(parts, 1e-12)
    order = np.argsort(fair)
    counted = np.maximum(np.cumsum(parts[order]), 1e-12)
    least = float(np.min(np.maximum(fair[order], search.threshold.of(*terms) / counted)))
    return least + fair_part.SPURIOUS_FACTOR * sum(search.spurious.get(term.place, 0.0) for term in terms)


def _fair_part(search: Search, beside: frozenset[Term]) -> Float[Array, " nv"]:
    """Gain on each row that is a fair part of its gap, ``(nv,)``."""
    gap, exact = search.rows.gap, frozenset(term for term in beside if term.effect.exact)
    if exact:
        left = search.fits.row_losses(exact)
        gap = np.minimum(gap, np.maximum(left - row_counts(search.problem), 0.0))
    return fair_part.LEAST_SHARE_OF_GAP * gap + search.rows.accuracy


def claimed(search: Search, chosen: frozenset[Term], without: frozenset[Term]) -> bool:
    """True if ``chosen`` passes the gates of a claim over ``without``, see `asked`."""
    return all(result.passed for result in asked(search, chosen, without))


def asked(search: Search, chosen: frozenset[Term], without: frozenset[Term]) -> tuple[GateResult, ...]:
    """What the gates of a claim say of ``chosen`` beside ``without``, in their order, up to the first that fails.

    Its sizes have to exist; the gain has to be more than chance gives, on held-out data and in sample; it has to be a
    fair part of the gap; and it has to hold in enough blocks.
    """
    return until_failed(_questions(search, chosen, without))


def _questions(search: Search, chosen: frozenset[Term], without: frozenset[Term]) -> Iterator[GateResult]:
    yield possible_size(int(search.score(chosen) >= _IMPOSSIBLE))
    rich, plain, new = search.evaluate(chosen), search.evaluate(without), chosen - without
    # In sample a gain can only be larger, unless chance has made the few held-out blocks agree.
    held_out = plain.total - rich.total
    gain = min(held_out, plain.objective - rich.objective)
    yield more_than_chance(gain, search.threshold.of(*new))
    extra = search.price_of(chosen) - search.price_of(without)
    by_row = plain.row_losses - rich.row_losses
    needed = least_gain(search, new, without, by_row) + max(extra - above_chance.PARAMETER_PRICE, 0.0)
    yield fair_part_of_the_gap(gain, needed)
    yield in_enough_blocks(
        plain.loss - rich.loss,
        held_out,
        gain,
        needed,
        lambda: energy_by_block(search.problem, new),
        named=any(term.named for term in new),
    )


def energy_by_block(problem: Problem, terms: frozenset[Term]) -> Float[Array, " B"]:
    """Energy of the columns of effects in each block over that in the block with most of it; one where there is none.

    Zero, up to rounding, where an effect does not act at all.
    """
    columns = np.array(sorted({column for term in terms for column in term.columns}), dtype=int)
    energy = problem.grams.core_a.diagonal(columns)
    share = energy / np.maximum(energy.max(axis=0, initial=0.0), 1e-300)
    return np.where(share > 1e-12, share, 0.0).max(axis=1, initial=0.0) if len(columns) else np.ones(len(energy))


def dropped(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """Backward elimination: remove, one by one, effects that are no longer needed.

    Of many effects only those are tried that the fit would miss least. On a robot of many joints several of these may
    go in one step, as long as no two of them touch the same joint.
    """
    while chosen:
        whole, touched = chosen, frozenset[int]()
        for term in sorted(least_missed(search, whole), key=lambda term: search.score(whole - {term})):
            rows = rows_of(search.problem, term)
            if rows.isdisjoint(touched) and not claimed(search, chosen, chosen - {term}):
                search.record.lost([term], *asked(search, chosen, chosen - {term}))
                chosen, touched = chosen - {term}, touched | rows
            if not touched or not search.many_joints:
                break
        if chosen == whole:
            return chosen
    return chosen


def least_missed(search: Search, chosen: frozenset[Term]) -> tuple[Term, ...]:
    """The effects without which the loss in sample grows least, to second order; of a few effects all."""
    terms = ordered(chosen)
    if len(terms) <= _MOST_TRIED:
        return terms
    found = search.evaluate(chosen)
    cov, missed = found.cov, {}
    for term in terms:
        own = np.searchsorted(found.active, term.columns)
        x = found.theta[list(term.columns)]
        missed[term] = float(x @ np.linalg.pinv(cov[np.ix_(own, own)], hermitian=True) @ x)
    return tuple(sorted(terms, key=lambda term: missed[term])[:_MOST_TRIED])


def rows_of(problem: Problem, term: Term) -> frozenset[int]:
    """Joints whose torque a term touches."""
    return problem.touched[term.columns[0]]
