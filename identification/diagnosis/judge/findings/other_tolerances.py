"""Deviations of sizes beside a model that is weaker than its tolerances say: moves that end at their limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.joint_fit import JointFit
from identification.diagnosis.search.rival_sets import with_wide_tolerances
from identification.diagnosis.search.search import Search


def with_other_tolerances(fitted: JointFit, plain: Search, chosen: frozenset[Term]) -> JointFit:
    """The same fit with the deviations of sizes that a model with three times the tolerances leaves elsewhere.

    Where no move ends at its limit, the tolerances hold as they are stated. Where one does, the model is likely to be
    further off than that, and what a size takes over from it is not in its deviation.

    Args:
        fitted: Fit of all numbers.
        plain: Fits in the judged band.
        chosen: The effects of the fit.
    """
    problem = plain.problem.of(chosen)
    found = plain.evaluate(chosen)
    moves = slice(0, problem.nuisances)
    if not np.any(np.abs(found.theta[moves]) >= rules.AT_LIMIT * problem.upper[moves]):
        return fitted
    elsewhere = with_wide_tolerances(plain).evaluate(chosen)
    cov = fitted.cov.copy()
    for place in fitted.places:
        count = place.coefficients.stop - place.coefficients.start
        columns = list(place.term.columns[:count])
        shift = elsewhere.theta[columns] - found.theta[columns]
        cov[place.coefficients, place.coefficients] += np.outer(shift, shift)
    return replace(fitted, cov=cov)
