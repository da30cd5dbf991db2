"""Odds of richer laws, which have more parameters, against a finding that is their special case.

The odds of a law are its probability divided by the probability of the finding.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from scipy.special import ndtr

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.search.containment import contains
from identification.diagnosis.search.fits import Chosen
from identification.diagnosis.search.plausible_sizes import implausible_size
from identification.diagnosis.search.record import Cause, EffectJoint
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.swaps import with_replacement
from identification.engine import contract_levels
from identification.engine.fits.projection import project_off_fit


def odds_of_richer_laws(
    search: Search,
    chosen: Chosen,
    term: Term,
    barred: frozenset[EffectJoint],
    richer_laws: list[Chosen],
) -> dict[Cause, float]:
    """Odds of richer laws against a finding that is their special case, as means over the shapes of each law.

    A law whose fit does not differ from the special case is not ruled out. For example, a recording shows friction that
    falls at the lowest speeds only if the joint is that slow. So odds are averaged over all shapes of a law, including
    shapes that the recording hardly shows. A law of plausible size that fits at least as well has odds of one against a
    finding of implausible size, such as a load of negative mass.

    Args:
        search: Candidates and fits of sets.
        chosen: A set of effects.
        term: One of them, the finding.
        barred: Laws, with their joints, that do not differ from a simpler one.
        richer_laws: Sets of effects with more parameters that may replace the finding; laws of the same joint that
            contain it are added.
    """
    is_plausible = has_plausible_sizes(search, chosen, frozenset([term]))

    def odds(rich: Chosen) -> float:
        better = (
            not is_plausible
            and has_plausible_sizes(search, rich, rich - chosen)
            and search.in_sample_loss(rich) <= search.in_sample_loss(chosen)
        )
        return 1.0 if better else _bounded_odds(search, chosen, rich)

    sets: dict[Cause, list[Chosen]] = defaultdict(list)
    single = {one.effect_joint for others in richer_laws if len(others) == 1 for one in others}
    for one in search.terms:
        own = one.named and one.joint == term.joint and contains(one, term) and one.effect.inertial is None
        if one.effect_joint in single or (own and one.effect_joint not in barred):
            sets[one.effect_joint,].append(with_replacement(chosen, term, frozenset([one])))
    for others in richer_laws:
        if len(others) > 1:
            causes = tuple(dict.fromkeys(other.effect_joint for other in ordered(others)))
            sets[causes] = [with_replacement(chosen, term, others)]
    return {causes: float(np.mean([odds(one) for one in each])) for causes, each in sets.items()}


def _bounded_odds(search: Search, chosen: Chosen, rich: Chosen) -> float:
    """Odds of a set against one with a special case of one of its laws, at most one.

    If the columns of the law do not include those of the special case, the odds are also at most twice the probability
    that the law predicts other blocks better, computed from the scatter of the held-out losses over blocks.
    """
    odds = min(odds_of_richer(search, chosen, rich), 1.0)
    columns = {column for one in chosen for column in one.columns}
    if odds < contract_levels.LISTED or columns <= {column for one in rich for column in one.columns}:
        return odds
    worse = search.held_out_fit(rich).loss - search.held_out_fit(chosen).loss
    error = float(np.sqrt(len(worse)) * worse.std())
    return min(odds, 2.0 * float(ndtr(-worse.sum() / error))) if error > 0.0 else odds


def odds_of_richer(search: Search, chosen: frozenset[Term], rich: frozenset[Term]) -> float:
    """Odds of a richer law against its special case (Laplace's approximation), at most one.

    By the prior, each additional column makes about half as much torque as the finding. If the data and the tolerances
    do not determine the coefficient of an additional column, the odds are near one.
    """
    problem, found = search.problem.of(chosen), search.held_out_fit(chosen)
    more = np.array(sorted({k for term in rich - chosen for k in term.columns} - set(found.active.tolist())), dtype=int)
    replaced = np.array(sorted({k for term in chosen - rich for k in term.columns}), dtype=int)
    a = problem.total_a
    energy = float(found.theta[replaced] @ a[np.ix_(replaced, replaced)] @ found.theta[replaced])
    own = np.diag(a)[more]
    if not len(more) or energy <= 0.0 or not np.all(own > 0.0):
        return 0.0
    cross, solution, gradient = project_off_fit(problem, found, more)
    projected = a[np.ix_(more, more)] - cross.T @ solution
    # From here on, coefficients are in units of their prior standard deviation.
    prior_std = rules.EXPECTED_SHARE * np.sqrt(energy / own)
    precision = np.eye(len(more)) + projected * np.outer(prior_std, prior_std)
    slope = gradient * prior_std
    log_odds = 0.5 * float(slope @ np.linalg.solve(precision, slope)) - 0.5 * float(np.linalg.slogdet(precision)[1])
    return float(np.exp(min(log_odds, 0.0)))


def has_plausible_sizes(search: Search, chosen: Chosen, effects: Chosen) -> bool:
    """True if all given effects of a set have plausible sizes in its fit."""
    session, found = search.problem.session, search.held_out_fit(chosen)
    return all(implausible_size(session, one, *found.coefficients_of(one)) is None for one in effects)
