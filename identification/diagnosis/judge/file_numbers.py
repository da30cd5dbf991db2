"""Numbers for the files of the corrected model: sizes of effects and changes within tolerance, from the same fit.

The report lists only changes within tolerance that clearly differ from zero. The corrected model needs all of them: an
effect that was fitted together with a change of a mass has the wrong size without that change.
"""

from __future__ import annotations

from identification.data.changes import Change
from identification.diagnosis.columns.terms import ordered
from identification.diagnosis.columns.tolerance_parameters import ARRIVAL, BASE, SOFTNESS, TIMING, tolerance_parameters
from identification.diagnosis.fit.full_fit import FullFit, full_fit
from identification.diagnosis.fit.gap import judged_blocks, sample_weights
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.findings.gate_state import ShownEffects
from identification.diagnosis.judge.findings.parameters import finding_parameters
from identification.diagnosis.replay import Replay
from identification.diagnosis.result import Adjusted, FittedNumbers, Value

_Sizes = dict[tuple[str, str | None], dict[str, Value]]


def fitted_numbers(shown: ShownEffects) -> tuple[FittedNumbers, ...]:
    """Sets of numbers for the corrected model, each from one fit; the sizes in the report come from the first set.

    The corrected model contains no structures without a name (fitted torques that match no effect of the catalogue). If
    there are such structures, a second set is fitted without them.

    Args:
        shown: The effects that are shown to the user, with their fit.
    """
    problem, named = shown.problem, shown.named
    sets = [_numbers(problem, shown.full_fit, {})]
    if named != shown.chosen:
        terms = ordered(named)
        alone = full_fit(problem.of(named), terms, shown.named_fit)
        robot = problem.session.robot
        sizes = {term.effect_joint: finding_parameters(robot, term, alone) for term in terms}
        sets.append(_numbers(problem, alone, sizes))
    return tuple(sets)


def _numbers(problem: Problem, fitted: FullFit, sizes: _Sizes) -> FittedNumbers:
    """The numbers of one fit, including all changes of the model within its tolerances, however uncertain."""
    parameters = tolerance_parameters(problem.session.robot)

    def by_owner(kind: str) -> tuple[tuple[str, float], ...]:
        """Owner and fitted value of each tolerance parameter of one kind."""
        indices = [k for k in problem.fitted_nuisances if parameters[k].kind == kind]
        return tuple((str(parameters[k].owner), float(fitted.x[k])) for k in indices)

    timing = float(sum(value for _, value in by_owner(TIMING)))
    pairs = ((problem.columns.tolerance_parameters[k], float(fitted.x[k])) for k in problem.fitted_nuisances)
    changes = tuple(
        Adjusted(parameter.name, change, parameter.sigma)
        for parameter, change in pairs
        if parameter.relative and change
    )
    return FittedNumbers(changes, sizes, timing, by_owner(SOFTNESS), by_owner(ARRIVAL), by_owner(BASE))


def replay_of(problem: Problem, changes: tuple[Change, ...]) -> Replay:
    """Recordings, held-out blocks and sample weights of the gap, for computing residuals of exported models.

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
