"""Points about which nonlinear laws are linearised for the next search: found effects and their best rivals.

The shape of a law is the set of parameters in which it is nonlinear, such as the time of a delay. A search tries a grid
of shapes, and fits each linearised law. The next search tries shapes near those of the effects found here.
"""

from __future__ import annotations

from functools import partial

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import FoundEffect, Term, ordered
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.search.containment import with_term
from identification.diagnosis.search.search import Search

# Largest number of runners-up of one finding.
_MOST_RUNNERS_UP = 3
# Relative difference of shapes below which laws are linearised about the same point.
_SAME_SHAPE = 0.03


def found_effects(fitted: Fitted, chosen: frozenset[Term]) -> tuple[FoundEffect, ...]:
    """Found effects as points about which nonlinear laws are linearised."""
    return tuple(_found_effect(fitted, term) for term in ordered(chosen))


def runners_up(search: Search, chosen: frozenset[Term]) -> tuple[FoundEffect, ...]:
    """Effects with a shape that gain nearly as much as a finding in its place, or nearly enough for a further claim.

    One of them may be the true effect. It may gain less than a wrong effect with more parameters only because the grid
    of shapes is coarse, or because the law was linearised far from the true size.
    """
    found = {term.effect_joint for term in chosen}
    shaped = tuple(term for term in search.terms if term.named and term.shape and term.effect_joint not in found)
    out: dict[tuple[str, str | None], FoundEffect] = {}
    # Rivals of each finding, and, under None, effects that are added to the whole set.
    for finding in (None, *ordered(chosen)):
        remaining = chosen - {finding}
        finding_gain = None if finding is None else search.gains(remaining, (finding,))[finding]
        rivals = tuple(term for term in shaped if search.can_join(remaining, term))
        least = 0.0 if finding_gain is None else rules.RUNNER_UP * finding_gain
        gains = search.gains(remaining, rivals, above=least, instead_of=finding)
        best: dict[tuple[str, str | None], Term] = {}
        for term in sorted(rivals, key=lambda term: -gains[term]):
            compared = search.threshold.of(term) if finding_gain is None else finding_gain
            if gains[term] >= rules.RUNNER_UP * compared and len(best) < _MOST_RUNNERS_UP:
                best.setdefault(term.effect_joint, term)
        for effect_joint, term in best.items():
            out.setdefault(effect_joint, _found_effect(search.held_out_fit(with_term(remaining, term)), term))
    return tuple(out.values())


def needs_refinement(found: tuple[FoundEffect, ...]) -> bool:
    """True if a law is nonlinear in its parameters, or depends on a torque that the other findings change."""
    loaded = any(point.effect.on_link for point in found)
    return any(point.shape or point.effect.follows_torque or (loaded and point.effect.follows_load) for point in found)


def same_points(found: tuple[FoundEffect, ...], before: tuple[FoundEffect, ...]) -> bool:
    """True if nonlinear laws would be linearised about the same points again."""
    now, last = ([(*point.effect_joint, len(point.shape)) for point in points] for points in (found, before))
    return now == last and all(
        abs(x - y) <= _SAME_SHAPE * abs(y)
        for a, b in zip(found, before, strict=True)
        for x, y in zip(a.shape, b.shape, strict=True)
    )


def matching_terms(search: Search, found: tuple[FoundEffect, ...]) -> frozenset[Term]:
    """Terms of a new search for the effects that an earlier one has found, each with the nearest shape."""
    shapes = ((point, [term for term in search.terms if term.effect_joint == point.effect_joint]) for point in found)
    return frozenset(min(terms, key=partial(_shape_distance, point)) for point, terms in shapes if terms)


def _found_effect(fitted: Fitted, term: Term) -> FoundEffect:
    """One fitted effect as a point about which its law is linearised."""
    return FoundEffect(term.effect, term.joint, term.shape, fitted.theta[list(term.columns)])


def _shape_distance(point: FoundEffect, term: Term) -> tuple[int, float]:
    """Difference of two shapes: in their numbers of parameters, then in the parameters that both have."""
    apart = sum(abs(a - b) for a, b in zip(term.shape, point.shape, strict=False))
    return abs(len(term.shape) - len(point.shape)), apart
