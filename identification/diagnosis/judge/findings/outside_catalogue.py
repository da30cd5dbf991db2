"""Lowers the probability of a finding if a cause outside the catalogue may explain the recordings as well.

Structures without a name (flexible torques of the state) represent causes outside the catalogue. The search claims a
structure only if it gains more than the best effects. But an effect may gain as much without being the cause: a contact
over half of a motion has a torque like that of a spring. So structures are compared with a finding in the same
bootstrap replicates as its rivals.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.result import Rival
from identification.diagnosis.search.claims import rows_of_term
from identification.diagnosis.search.fair_costs import costs_of
from identification.diagnosis.search.rival_candidates import is_far_worse
from identification.diagnosis.search.rival_sets import RivalComparison
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.swaps import explained_loss, with_replacement
from identification.engine import contract_levels
from identification.engine.resampling import Costs, probabilities
from identification.gates import exchange
from phantom_dyn.array_types import Array, Float


def weighed_with_structures(
    search: Search,
    chosen: frozenset[Term],
    term: Term,
    comparison: RivalComparison,
    other_conditions: tuple[Search, ...],
) -> RivalComparison:
    """The comparison, with lower probabilities of the finding and its rivals if structures win some replicates.

    Args:
        search: Effects and structures.
        chosen: A set of effects.
        term: The finding, one effect of the set.
        comparison: Comparison of the finding with its rivals of the catalogue.
        other_conditions: The search under other conditions that should not change the result.
    """
    known = _share_of_known_causes(search, chosen, term, comparison, other_conditions)
    if known > 1.0 - contract_levels.LISTED:
        return comparison
    listed_rivals = [rival for rival in comparison.rivals if known * rival.probability >= contract_levels.LISTED]
    # Rivals that are no longer listed leave their probability to the finding and the other rivals.
    factor = known / (comparison.probability + sum(rival.probability for rival in listed_rivals))
    rivals = tuple(Rival(rival.effects, factor * rival.probability) for rival in listed_rivals)
    return replace(comparison, probability=factor * comparison.probability, rivals=rivals)


def _share_of_known_causes(
    search: Search,
    chosen: frozenset[Term],
    term: Term,
    comparison: RivalComparison,
    other_conditions: tuple[Search, ...],
) -> float:
    """Share of the replicates in which the finding or one of its rivals costs less than each structure."""
    structures = _sets_with_structure(search, chosen, term)
    if not structures:
        return 1.0
    known = [chosen, *(rival_set for rival_set, _ in comparison.rival_sets)]
    sets, is_known = [*known, *structures], np.arange(len(known) + len(structures)) < len(known)

    def losses_and_costs(fits: Search) -> tuple[Float[Array, "B m"], Costs]:
        held_out = np.array([fits.held_out_fit(one).loss for one in sets]).T
        # A structure is so flexible that it gains this much from errors of the law that it replaces.
        spurious_gain = np.where(is_known, 0.0, exchange.NAMELESS_ACCURACY * explained_loss(fits, chosen, term))
        return held_out, tuple(cost + spurious_gain for cost in costs_of(fits, sets, [False] * len(sets)))

    conditions = [losses_and_costs(other) for other in other_conditions]
    won = probabilities(*losses_and_costs(search), conditions, by_halves=bool(conditions))
    return float(won[is_known].sum())


def _sets_with_structure(search: Search, chosen: frozenset[Term], term: Term) -> list[frozenset[Term]]:
    """Sets in which a structure on a joint of a finding replaces the finding; sets that fit far worse are left out."""
    rows, others = rows_of_term(search.problem, term), chosen - {term}
    swapped = [
        with_replacement(chosen, term, search.alone[structure])
        for structure in search.terms
        if not structure.named
        and not rows.isdisjoint(rows_of_term(search.problem, structure))
        and search.can_join(others, structure)
    ]
    return [one for one in dict.fromkeys(swapped) if not is_far_worse(search, chosen, one, priced=True)]
