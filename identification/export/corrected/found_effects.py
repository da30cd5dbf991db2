"""The findings of a diagnosis as effects, and the given model with the moves within its tolerances.

Moves within tolerance are fitted independently, and only their summed torque along the recorded motion is observed.
Together they may give a body that cannot exist: for a thin link with a small axial moment, for example, the other two
moments have to be nearly equal. Such bodies are replaced by possible ones with the same torques along that motion.
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
"""Number of samples of the recorded motion on which possible bodies must have the same torques."""
_SEEN = 1e-4
"""Combinations of parameters with a smaller torque than this share of the largest one may change freely."""


def lasting_findings(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """Findings that act in all recordings: an effect in only one of them is no part of the robot."""
    return tuple(finding for finding in diagnosis.findings if finding.recording is None)


def effect_of(robot: Robot, finding: Finding) -> KnownEffect:
    """A finding as an effect; inertial parameters that are not named are unchanged.

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

    For a finding without loadings, its deviations are taken as independent (``k`` is the number of its parameters), and
    a deviation that is not finite as zero.
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
    """The given robot with the adjustments of a diagnosis; the same object if there are none.

    Findings were fitted together with these moves: a model with the findings alone has another gap than the one stated,
    and may be further from the recordings than the given model.

    Args:
        robot: The given model.
        diagnosis: Its diagnosis.

    Raises:
        RobotError: If the mass of a link would be zero or negative.
    """
    return moved_by(robot, diagnosis.adjusted)


def moved_by(robot: Robot, adjusted: tuple[Adjusted, ...]) -> Robot:
    """The given robot with moves within its tolerances; the same object if there are none.

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
    """The robot with possible bodies, as near as possible to the given ones, that need the same torque along a motion.

    Args:
        robot: A robot of which some bodies may be impossible.
        given: The given model, whose bodies are possible or nearly so.
        motion: Motion with equal torques; of a long one some samples are used.

    Raises:
        EstimationError: If there are no such bodies.
        RobotError: If the mass of a link would be zero or negative.
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
