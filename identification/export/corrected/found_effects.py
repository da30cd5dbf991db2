"""The findings of a diagnosis as effects, and the given model with the moves within its tolerances.

Moves within tolerance are fitted one by one, and only their sum along the recorded motion is seen. Together they may
make a body that cannot be, as the axial moment of a thin link leaves its two others no room to differ: then possible
bodies take its place that need the same torques there.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from identification.diagnosis.columns.nuisances import moves_of
from identification.diagnosis.columns.operations import moved_robot
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Adjusted, Diagnosis, Finding
from identification.estimators.consistent.consistent_bodies import reference_bodies
from identification.estimators.consistent.consistent_program import Program, solve_program
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import EstimationError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

_SAMPLES = 300
"""Samples of the recorded motion on which possible bodies need the same torques."""
_SEEN = 1e-4
"""Combinations of parameters whose torque is a smaller share of the largest one's are free."""


def lasting_findings(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """Findings that act in all recordings: what acts in one of them only is no part of the robot."""
    return tuple(finding for finding in diagnosis.findings if finding.recording is None)


def effect_of(robot: Robot, finding: Finding) -> KnownEffect:
    """A finding as an effect; inertial parameters that are not named did not move.

    Raises:
        ParameterError: If the effect is unknown.
        RobotError: If the robot does not have its joint.
    """
    stated = {name: value.value for name, value in finding.parameters.items()}
    parameters = effect_named(finding.effect, robot).from_stated(robot, stated)
    theta: list[float] = []
    for name in _names(robot, finding, parameters):
        value = parameters.get(name, 0.0)
        theta += [float(x) for x in value] if isinstance(value, list) else [float(value)]
    return KnownEffect(finding.effect, finding.joint, tuple(theta))


def loadings_of(robot: Robot, finding: Finding) -> Float[Array, "p k"]:
    """Deviations of `effect_of`'s numbers as sums of independent standard numbers.

    Where a finding does not say what it shares with others, each of its deviations stands for itself (``k`` is the
    number of its parameters), and one that is not finite counts as none.
    """
    given = {name: _rows(finding, name) for name in finding.parameters}
    width = max((len(row) for rows in given.values() for row in rows), default=0)
    out: list[Array] = []
    for name in _names(robot, finding, finding.parameters):
        out += [np.array(row) for row in given[name]] if name in given else [np.zeros(width)]
    return np.array(out).reshape(len(out), width)


def _names(robot: Robot, finding: Finding, stated: Collection[str]) -> list[str]:
    """Names of the parameters of a finding in the contract's order, then others that are stated."""
    effect = effect_named(finding.effect, robot)
    known = [parameter.name for parameter in effect.parameters(robot, finding.joint)]
    if effect.inertial == "free":
        return known
    return [name for name in known if name in stated] + [name for name in stated if name not in known]


def _rows(finding: Finding, name: str) -> list[list[float]]:
    """Rows of the loadings of one parameter, which has several where its value is a list."""
    sizes = {key: len(v.value) if isinstance(v.value, list) else 1 for key, v in finding.parameters.items()}
    total = sum(sizes.values())
    start = sum(sizes[key] for key in list(sizes)[: list(sizes).index(name)])
    if len(finding.loadings) == total:
        return [list(row) for row in finding.loadings[start : start + sizes[name]]]
    std = finding.parameters[name].std
    values = std if isinstance(std, list) else [std]
    finite = [float(s) if np.isfinite(s) else 0.0 for s in values]
    return [[s if start + k == j else 0.0 for j in range(total)] for k, s in enumerate(finite)]


def within_tolerance(robot: Robot, diagnosis: Diagnosis) -> Robot:
    """The given robot with what the diagnosis lists as adjusted; the very same object where that is nothing.

    Findings are sizes beside these moves: a model that has the findings alone is not the one whose gap was measured,
    and may be further from the recordings than the given one.

    Args:
        robot: The given model.
        diagnosis: Of this model.

    Raises:
        RobotError: If a link would weigh nothing or less.
    """
    return moved_by(robot, diagnosis.adjusted)


def moved_by(robot: Robot, adjusted: tuple[Adjusted, ...]) -> Robot:
    """The given robot with moves within its tolerances; the very same object where there are none.

    Args:
        robot: The given model.
        adjusted: Its moves, as a diagnosis or a ``corrected.yaml`` lists them.

    Raises:
        RobotError: If a link would weigh nothing or less.
    """
    changes = {entry.quantity: entry.change for entry in adjusted}
    values = np.array([changes.get(m.nuisance.name, 0.0) if m.nuisance.relative else 0.0 for m in moves_of(robot)])
    return moved_robot(robot, values) if values.any() else robot


def same_torque_bodies(robot: Robot, given: Robot, motion: Motion) -> Robot:
    """The robot with bodies that can be, nearest to the given ones, that need the same torque along a motion.

    Args:
        robot: With bodies of which some may be impossible.
        given: The given model, whose bodies are possible or nearly so.
        motion: Along which torques are to be the same; of a long one some samples count.

    Raises:
        EstimationError: If there are no such bodies.
        RobotError: If a link would weigh nothing or less.
    """
    at = np.unique(np.linspace(0, len(motion.t) - 1, min(_SAMPLES, len(motion.t))).astype(int))
    if not len(at):
        raise EstimationError("No motion was recorded along which other bodies need the same torques.")
    few = motion.at(at)
    wanted, stated = standard_parameters(robot), standard_parameters(given)
    bodies = reference_bodies(stated)
    scale = np.concatenate([body.scale for body in bodies])
    _, sizes, rows = np.linalg.svd(
        rigid_body_regressor(robot, few).reshape(-1, len(stated)) * scale, full_matrices=False
    )
    seen = rows[: len(sizes)][sizes > _SEEN * sizes[0]] / scale
    none = np.zeros(0)
    found = solve_program(Program(seen, seen @ wanted, bodies, none, none, exact=True))
    return with_parameters(robot, found.pi - wanted)
