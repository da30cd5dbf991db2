"""Structures that the catalogue has no name for: when they join what it explains, or take its place."""

from __future__ import annotations

from collections.abc import Callable

from identification.diagnosis.search import Search, claimed, ordered, possible, with_term
from identification.diagnosis.terms import Term

# By how many thresholds a structure has to be better than the named effects whose place it takes, by their number:
# several effects together that do no better than one structure are the less likely cause.
_MARGIN = (1.0, 1.0, 0.0, -0.5)
# And, of a single named effect, by this share of what it explains: so much is lost by what the fits take as linear, and
# a structure, with many shapes to choose from, makes good for some of it.
_ACCURACY = 0.015
# Structures without a name that are taken in, and how many of them are judged on held-out data in one step.
_MOST_NAMELESS = 4
_MOST_JUDGED = 8


def with_nameless(search: Search, chosen: frozenset[Term], progress: Callable[[str], None]) -> frozenset[Term]:
    """Structures that the catalogue has no name for, added to what it explains or put in its place.

    A structure has to gain what any claim has to gain beyond the best that named effects do; what it makes needless
    is then dropped. One that stands for several effects at a lower price takes their place.
    """
    progress("looking for what has no name")
    accuracy = _ACCURACY * max(search.score(frozenset()) - search.score(chosen), 0.0)
    nameless = tuple(term for term in search.terms if not term.named)
    for _ in range(_MOST_NAMELESS):
        best, lowest = None, search.score(chosen)
        for base in {chosen, frozenset(term for term in chosen if not term.named)}:
            promised = search.gains(base, nameless)
            for term in sorted(nameless, key=lambda term: -promised[term])[:_MOST_JUDGED]:
                if promised[term] < search.threshold.overall or not possible(base, term):
                    continue
                tried = _only_needed(search, with_term(base, term), chosen)
                gone = len(chosen - tried)
                limit = lowest - _MARGIN[min(gone, len(_MARGIN) - 1)] * search.threshold.overall
                limit -= accuracy if gone == 1 else 0.0
                if search.score(tried) < limit and claimed(search, tried, tried - {term}):
                    best, lowest = tried, search.score(tried)
        if best is None:
            return chosen
        chosen = best
    return chosen


def _only_needed(search: Search, tried: frozenset[Term], chosen: frozenset[Term]) -> frozenset[Term]:
    """A set with a structure in it, with the named effects that it still needs and without the others."""
    for term in ordered(chosen):
        if term.named and possible(tried, term) and claimed(search, with_term(tried, term), tried):
            tried = with_term(tried, term) if with_term(tried, term) >= tried else tried
    while True:
        needless = [t for t in ordered(tried) if t.named and not claimed(search, tried, tried - {t})]
        if not needless:
            return tried
        tried = tried - {min(needless, key=lambda term: search.score(tried - {term}))}
