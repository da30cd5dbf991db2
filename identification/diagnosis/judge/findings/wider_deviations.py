"""Deviations of sizes, wider by what else the recordings allow: a weaker model, and other causes beside a finding.

The fit of all numbers takes for granted that the moves stay within the tolerances and that every finding is the cause.
Where either is in doubt, a size is uncertain by what it would be otherwise (law of total variance).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.joint_fit import JointFit
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.search.search import Search, with_wide_tolerances
from phantom_dyn.array_types import Array, Float


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
    return _wider(fitted, chosen, with_wide_tolerances(plain).evaluate(chosen).theta - found.theta, 1.0)


def with_other_causes(fitted: JointFit, shown: Shown) -> JointFit:
    """The same fit with deviations of sizes that hold what they are beside the rivals of other findings.

    Each set that rivals make counts once, by its largest probability: one law in the place of two is a rival of both.
    Rivals that keep an effect and add another one to it count for its own size too.

    Args:
        fitted: Fit of all numbers.
        shown: What is shown, with the sets of its rivals.
    """
    sets: dict[frozenset[Term], float] = {}
    for standing in shown.standings.values():
        for rivals, probability in standing.elsewhere:
            sets[rivals] = max(probability, sets.get(rivals, 0.0))
    if not sets:
        return fitted
    here = shown.plain.evaluate(shown.beside).theta
    for rivals, probability in sets.items():
        fitted = _wider(fitted, rivals, shown.plain.evaluate(rivals).theta - here, probability)
    return fitted


def _wider(fitted: JointFit, kept: frozenset[Term], shift: Float[Array, " K"], probability: float) -> JointFit:
    """The fit with the shift of all coefficients added to the deviations of those effects that another set keeps."""
    cov = fitted.cov.copy()
    for place in fitted.places:
        if place.term in kept:
            count = place.coefficients.stop - place.coefficients.start
            moved = shift[list(place.term.columns[:count])]
            cov[place.coefficients, place.coefficients] += probability * np.outer(moved, moved)
    return replace(fitted, cov=cov)
