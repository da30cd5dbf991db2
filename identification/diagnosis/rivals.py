"""What else a finding may be: sets of effects that explain the same held-out data, and how often each one wins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search import Search, contains, ordered
from identification.diagnosis.swaps import relevant, replaced
from identification.diagnosis.terms import Term

Array = np.ndarray

REPLICATES = 1000
_LISTED = 0.05
# A rival that wins this many times as often as the finding takes its place.
_OUTDONE = 1.5
# A rival that is this much worse in sample (ten standard deviations of one parameter) wins no replicate.
_FAR = 100.0
# Held-out losses that differ by less (in units of one squared standard deviation) are the same predictions.
_SAME = 0.05


@dataclass(frozen=True)
class Standing:
    """How a finding stands against its rivals.

    Attributes:
        probability: Its own share of wins.
        rivals: Theirs, the likeliest first.
        instead: The whole set with the likeliest rival in the finding's place, None if there is no rival.
    """

    probability: float
    rivals: tuple[Rival, ...]
    instead: frozenset[Term] | None = None


def block_counts(blocks: int, rng: np.random.Generator) -> Float[Array, "R B"]:
    """How often each block is drawn in each of a thousand bootstrap replicates."""
    draws = rng.integers(0, blocks, size=(REPLICATES, blocks))
    return np.apply_along_axis(np.bincount, 1, draws, minlength=blocks).astype(float)


def stand(search: Search, chosen: frozenset[Term], term: Term) -> Standing:
    """Compare a finding with everything that could stand in its place.

    A richer effect that contains the finding is a rival only if its extra parameters lower the held-out loss, and
    wins a replicate only if they earn their price in it; predictions that are the same share their wins. It needs no
    more than that: what chance gives over the whole catalogue is no measure of laws of one kind on one joint.
    """
    base = search.evaluate(chosen)
    options: dict[frozenset[Term], tuple[Array, float]] = {}
    names: dict[frozenset[Term], frozenset[Term]] = {}
    for others in relevant(search, chosen, term, _FAR):
        if not all(other.named for other in others):
            continue
        swapped = replaced(chosen, term, others)
        if swapped == chosen or swapped in options or not others <= swapped:
            continue
        if _hopeless(search, chosen, swapped):
            continue
        found = search.evaluate(swapped)
        richer = any(contains(other, term) for other in others) and search.sizes_of(others) > search.sizes[term]
        if richer and found.total >= base.total:
            continue
        options[swapped] = (found.loss, _fixed(search, swapped, base.penalty))
        names[swapped] = others
    for others, swapped in _twins(search, chosen, term):
        options[swapped] = (base.loss, _fixed(search, chosen, base.penalty))
        names[swapped] = others
    if not options:
        return Standing(1.0, ())
    keys = [chosen, *options]
    losses = np.array([base.loss, *(options[k][0] for k in keys[1:])])
    fixed = np.array([_fixed(search, chosen, base.penalty), *(options[k][1] for k in keys[1:])])
    counts = block_counts(losses.shape[1], np.random.default_rng(20260103))
    scores = counts @ losses.T + fixed
    best = scores.min(axis=1, keepdims=True)
    tied = scores <= best + _SAME
    shares = (tied / tied.sum(axis=1, keepdims=True)).mean(axis=0)
    shares = _by_place(term, keys, names, shares)
    kept = {effects: share for effects, share in shares.items() if share >= _LISTED and effects}
    own = shares[()]
    total = own + sum(kept.values())
    rivals = tuple(
        Rival(tuple(EffectAt(*place) for place in effects), share / total)
        for effects, share in sorted(kept.items(), key=lambda item: -item[1])
    )
    first = next(iter(sorted(kept, key=lambda effects: -kept[effects])), None)
    there = [key for key in keys[1:] if tuple(other.place for other in ordered(names[key])) == first]
    return Standing(own / total, rivals, min(there, key=search.score) if there else None)


def settled(search: Search, chosen: frozenset[Term]) -> frozenset[Term]:
    """``chosen`` with findings replaced by the rival that wins more often than they do, if there is one.

    The search compares sums over all blocks; a rival that wins in most bootstrap replicates is the better name.
    """
    for term in ordered(chosen):
        if not term.named or term not in chosen:
            continue
        standing = stand(search, chosen, term)
        if standing.instead is not None and standing.rivals[0].probability > _OUTDONE * standing.probability:
            chosen = standing.instead
    return chosen


def _fixed(search: Search, chosen: frozenset[Term], penalty: float) -> float:
    """What a set costs in every replicate: its price, and moves of the model beyond those of the finding.

    Moves that cost less than four more (two tolerances of one quantity) are no evidence against a rival.
    """
    return search.price_of(chosen) + max(search.evaluate(chosen).penalty - penalty - 4.0, 0.0)


def _by_place(
    term: Term, keys: list[frozenset[Term]], names: dict[frozenset[Term], frozenset[Term]], shares: Float[Array, " m"]
) -> dict[tuple[tuple[str, str | None], ...], float]:
    """Shares by set of effects and joints, shapes of one effect added up; the finding itself under ``()``."""
    out: dict[tuple[tuple[str, str | None], ...], float] = {}
    for key, share in zip(keys, shares, strict=True):
        place = tuple(other.place for other in ordered(names[key])) if key in names else ()
        if place == (term.place,):
            place = ()
        out[place] = out.get(place, 0.0) + float(share)
    return out


def _hopeless(search: Search, chosen: frozenset[Term], swapped: frozenset[Term]) -> bool:
    """True if the swap loses by so much, block by block, that it would win no bootstrap replicate."""
    if search.quick(swapped) > search.quick(chosen) + _FAR:
        return True
    found, base = search.evaluate(swapped), search.evaluate(chosen)
    worse = found.loss - base.loss
    loss = found.total + search.price_of(swapped) - base.total - search.price_of(chosen)
    return loss > 4.0 * float(np.sqrt(len(worse)) * worse.std()) + 4.0


def _twins(search: Search, chosen: frozenset[Term], term: Term) -> list[tuple[frozenset[Term], frozenset[Term]]]:
    """Direction-dependent friction without a viscous difference is Coulomb friction plus an offset, exactly."""
    pair = {"coulomb_friction", "torque_offset"}
    here = {other.effect.name: other for other in chosen if other.joint == term.joint}
    if term.effect.name not in pair or not pair <= set(here):
        return []
    rich = next(
        (t for t in search.terms if t.joint == term.joint and pair <= set(t.effect.contains)),
        None,
    )
    if rich is None:
        return []
    return [(frozenset([rich]), replaced(chosen, term, frozenset([rich])))]
