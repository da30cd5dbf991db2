"""Rivals of a finding that the recordings cannot show, because in their motion they look like the finding.

For example, backlash looks like an encoder offset if the load never changes its sign.
"""

from __future__ import annotations

from dataclasses import replace

from identification.diagnosis.columns.terms import Term, merged
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.result import EffectAt, Rival
from identification.diagnosis.search.rival_sets import RivalComparison
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects import catalogue
from phantom_dyn.effects.effect import Effect


def with_untestable_rivals(
    problem: Problem, term: Term, coefficients: Float[Array, " k"], comparison: RivalComparison
) -> RivalComparison:
    """The comparison of a finding, with rivals that look like it in this motion, each as probable as the finding.

    Args:
        problem: Problem, with the samples of all recordings.
        term: The finding.
        coefficients: Its fitted coefficients.
        comparison: Comparison with rivals that the recordings show.
    """
    robot, effect = problem.session.robot, term.effect
    assert isinstance(effect, Effect)
    theta = effect.from_coefficients(robot, term.joint, coefficients, term.shape)
    operation = merged(problem.columns.operations)
    alike = [
        other.name
        for other in catalogue.effects_of(robot)
        if term.joint in other.places(robot) and other.looks_like(robot, operation, term.joint, effect.name, theta)
    ]
    if not alike:
        return comparison
    equal = comparison.probability / (1 + len(alike))
    ranked = [*comparison.rivals, *(Rival((EffectAt(name, term.joint),), equal) for name in alike)]
    ranked.sort(key=lambda rival: -rival.probability)
    return replace(comparison, probability=equal, rivals=tuple(ranked))
