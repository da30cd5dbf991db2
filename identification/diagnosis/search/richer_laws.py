"""Odds of a richer law against a simpler one of the same kind that it contains."""

from __future__ import annotations

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.search.search import Search
from identification.engine.fits.projection import taken_out


def odds_of_richer(search: Search, chosen: frozenset[Term], rich: frozenset[Term]) -> float:
    """Odds of a richer law of the same kind against what it contains, its further parameters not known beforehand.

    By Laplace's approximation: each further direction is expected to carry some half of the torque that was found. If
    the data hardly show such a direction beside the tolerances, they cannot say that it is not there.
    """
    problem, found = search.problem.of(chosen), search.evaluate(chosen)
    more = np.array(sorted({k for term in rich - chosen for k in term.columns} - set(found.active.tolist())), dtype=int)
    old = np.array(sorted({k for term in chosen - rich for k in term.columns}), dtype=int)
    a = problem.total_a
    energy = float(found.theta[old] @ a[np.ix_(old, old)] @ found.theta[old])
    own = np.diag(a)[more]
    if not len(more) or energy <= 0.0 or not np.all(own > 0.0):
        return 0.0
    cross, made, gradient = taken_out(problem, found, more)
    left = a[np.ix_(more, more)] - cross.T @ made
    size = rules.EXPECTED_SHARE * np.sqrt(energy / own)
    shown = np.eye(len(more)) + left * np.outer(size, size)
    pull = gradient * size
    log_odds = 0.5 * float(pull @ np.linalg.solve(shown, pull)) - 0.5 * float(np.linalg.slogdet(shown)[1])
    return float(np.exp(min(log_odds, 0.0)))
