"""Consistent sets of numbers for the corrected model: sizes of effects and changes within tolerance, fitted together.

A diagnosis states the sizes, and of the changes within tolerance only those that certainly differ from zero. A model
with these numbers alone may fit worse: a size that was fitted together with a change of a mass is wrong without that
change, however uncertain the change is.
"""

from __future__ import annotations

from identification.data.changes import Change
from identification.diagnosis.columns.terms import ordered
from identification.diagnosis.columns.tolerance_parameters import ARRIVAL, BASE, SOFTNESS, TIMING, tolerance_parameters
from identification.diagnosis.fit.full_fit import FullFit, full_fit
from identification.diagnosis.fit.gap import judged_blocks, sample_weights
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.judge.findings.parameters import finding_parameters
from identification.diagnosis.replay import Replay
from identification.diagnosis.result import Adjusted, FittedNumbers, Value

_Sizes = dict[tuple[str, str | None], dict[str, Value]]


def fitted_numbers(shown: Shown) -> tuple[FittedNumbers, ...]:
    """Sets of numbers that were fitted together, first the set with the stated sizes.

    A structure without a name is no part of the corrected model. If there is one, a second set is fitted without it.

    Args:
        shown: The effects, and the fit from which their sizes are stated.
    """
    problem, named = shown.problem, shown.named
    out = [_numbers(problem, shown.full_fit, {})]
    if named != shown.chosen:
        terms = ordered(named)
        alone = full_fit(problem.of(named), terms, shown.named_fit)
        robot = problem.session.robot
        sizes = {term.effect_joint: finding_parameters(robot, term, alone) for term in terms}
        out.append(_numbers(problem, alone, sizes))
    return tuple(out)


def _numbers(problem: Problem, fitted: FullFit, sizes: _Sizes) -> FittedNumbers:
    """The numbers of one fit, with every change of the model within its tolerances, however uncertain."""
    parameters = tolerance_parameters(problem.session.robot)
    timing = float(sum(fitted.x[k] for k in problem.fitted_nuisances if parameters[k].kind == TIMING))
    soft, arrivals, base = (
        tuple(
            (str(parameters[k].owner), float(fitted.x[k]))
            for k in problem.fitted_nuisances
            if parameters[k].kind == kind
        )
        for kind in (SOFTNESS, ARRIVAL, BASE)
    )
    pairs = ((problem.columns.tolerance_parameters[k], float(fitted.x[k])) for k in problem.fitted_nuisances)
    changes = tuple(Adjusted(own.name, change, own.sigma) for own, change in pairs if own.relative and change)
    return FittedNumbers(changes, sizes, timing, soft, arrivals, base)


def replay_of(problem: Problem, changes: tuple[Change, ...]) -> Replay:
    """Recordings and held-out samples of a diagnosis, on which residuals are computed as for the gap of each joint.

    Args:
        problem: Robot, recordings and blocks.
        changes: Known changes of the robot in each recording; empty if there are none.
    """
    session = problem.session
    blocks = [problem.blocks[k] for k in judged_blocks(problem)]
    return Replay(
        session.robot,
        session.logs,
        changes,
        session.cutoff_hz,
        tuple((block.log, block.core, block.stop) for block in blocks),
        tuple(sample_weights(problem, k) for k in range(len(session.logs))),
    )
