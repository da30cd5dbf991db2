"""Which set of effects explains the residual: stepwise in, out again, and swapped for simpler or better ones."""

from __future__ import annotations

from collections.abc import Callable

from identification.diagnosis.nameless import with_nameless
from identification.diagnosis.search import Search, claimed, dropped, possible, with_term
from identification.diagnosis.swaps import simplified, swapped
from identification.diagnosis.terms import Term

_MOST_TERMS = 40
# Rivals that are judged on held-out data in one step, the best in sample.
_MOST_JUDGED = 24
# The same where one that falls short is tried.
_SHORT_JUDGED = 8


def explain(search: Search, progress: Callable[[str], None], start: frozenset[Term] = frozenset()) -> frozenset[Term]:
    """The set of effects that explains the recordings with the fewest parameters.

    Args:
        search: Problem, rivals, threshold.
        progress: Told in words what is being done.
        start: What an earlier search has found.
    """
    chosen = dropped(search, frozenset(term for term in start if term.named))
    for _ in range(4):
        before = chosen
        chosen = _forward(search, chosen, progress)
        progress("weighing alternatives")
        chosen = simplified(search, swapped(search, dropped(search, chosen)))
        if chosen == before:
            break
    return with_nameless(search, chosen, progress)


def best_short(search: Search, chosen: frozenset[Term]) -> frozenset[Term] | None:
    """The set with the named effect in it that gains most beside ``chosen``, if it gains more than its price."""
    rivals = tuple(term for term in search.terms if term.named and possible(chosen, term))
    promised = search.gains(chosen, rivals)
    best = sorted(rivals, key=lambda term: -promised[term])[:_SHORT_JUDGED]
    tried = min((with_term(chosen, term) for term in best), key=search.score, default=None)
    return tried if tried is not None and search.score(tried) < search.score(chosen) else None


def _forward(search: Search, chosen: frozenset[Term], progress: Callable[[str], None]) -> frozenset[Term]:
    """Add the effect that helps most until none helps more than chance.

    In sample a gain is larger than on held-out data, so rivals are judged there in the order of their gains in sample
    until none that is left can do better than the best so far. What is added can make earlier effects needless, and
    without them it can be needless itself: where that leads in a circle, the best set of the circle is it.
    """
    seen = [chosen]
    while len(chosen) < _MOST_TERMS:
        progress(f"trying rivals, {len(chosen)} found")
        base = search.score(chosen)
        rivals = [term for term in search.terms if term.named and possible(chosen, term)]
        promised = search.gains(chosen, tuple(rivals))
        best, most = None, 0.0
        for term in sorted(rivals, key=lambda term: -promised[term])[:_MOST_JUDGED]:
            if promised[term] < most:
                break
            if promised[term] < search.threshold.of(term):
                continue
            gain = base - search.score(with_term(chosen, term))
            if gain > most and claimed(search, with_term(chosen, term), chosen):
                best, most = term, gain
        if best is None:
            return chosen
        chosen = dropped(search, with_term(chosen, best))
        if chosen in seen:
            return min(seen[seen.index(chosen) :], key=search.score)
        seen.append(chosen)
    return chosen
