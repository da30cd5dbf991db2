"""Converts the findings of a diagnosis to effects, and applies its changes within tolerances to the given model."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from identification.diagnosis.columns.operations import adjusted_robot
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.columns.tolerance_parameters import tolerance_parameters
from identification.diagnosis.result import Adjusted, Diagnosis, Finding
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import RobotError, listed
from phantom_dyn.model.inertia import body_name
from phantom_dyn.model.robot import Robot


def findings_in_all_recordings(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """Findings that act in all recordings. An effect in a single recording is not part of the robot."""
    return tuple(finding for finding in diagnosis.findings if finding.recording is None)


def effect_of(robot: Robot, finding: Finding) -> KnownEffect:
    """A finding as an effect; changes of inertial parameters that the finding does not name are zero.

    Raises:
        ParameterError: If the effect is unknown.
        RobotError: If the robot does not have the finding's joint.
    """
    stated = {name: value.value for name, value in finding.parameters.items()}
    parameters = effect_named(finding.effect, robot).from_stated(robot, stated)
    theta: list[float] = []
    for name in _names(robot, finding, parameters):
        value = parameters.get(name, 0.0)
        theta += [float(x) for x in value] if isinstance(value, list) else [float(value)]
    return KnownEffect(finding.effect, finding.joint, tuple(theta))


def loadings_of(robot: Robot, finding: Finding) -> Float[Array, "p k"]:
    """Matrix ``L`` that describes the errors of the numbers of `effect_of` and how they are correlated.

    With ``k`` independent standard normal numbers ``z`` the errors of the numbers are ``L z``. If a finding has no
    loadings, its errors count as independent, and standard deviations that are not finite count as zero.
    """
    given = {name: _rows(finding, name) for name in finding.parameters}
    width = max((len(row) for rows in given.values() for row in rows), default=0)
    out: list[Array] = []
    for name in _names(robot, finding, finding.parameters):
        out += [np.array(row) for row in given[name]] if name in given else [np.zeros(width)]
    return np.array(out).reshape(len(out), width)


def _names(robot: Robot, finding: Finding, stated: Collection[str]) -> list[str]:
    """Names of a finding's parameters: first in the order of the catalogue, then further stated ones.

    An effect with free inertial parameters has all of the catalogue and no others.
    """
    effect = effect_named(finding.effect, robot)
    known = [parameter.name for parameter in effect.parameters(robot, finding.joint)]
    if effect.inertial == "free":
        return known
    return [name for name in known if name in stated] + [name for name in stated if name not in known]


def _rows(finding: Finding, name: str) -> list[list[float]]:
    """Rows of `loadings_of` for one parameter: one row, or several if its value is a list."""
    sizes = {key: len(value.numbers) for key, value in finding.parameters.items()}
    total = sum(sizes.values())
    start = sum(sizes[key] for key in list(sizes)[: list(sizes).index(name)])
    if len(finding.loadings) == total:
        return [list(row) for row in finding.loadings[start : start + sizes[name]]]
    finite = [float(std) if np.isfinite(std) else 0.0 for std in finding.parameters[name].stds]
    return [[s if start + k == j else 0.0 for j in range(total)] for k, s in enumerate(finite)]


def robot_within_tolerances(robot: Robot, adjusted: tuple[Adjusted, ...]) -> Robot:
    """The given robot with the parameters that a diagnosis changed; the same object if it changed none.

    Findings were fitted together with these changes. A model with the findings but without the changes may have a
    larger residual than the diagnosis states, and even than the given model. Changes that are no parameters of the
    model, such as a delay of the recording or an error of a sensor, are left out.

    Args:
        robot: The given model.
        adjusted: The changes within tolerances, as a diagnosis or a ``corrected.yaml`` lists them.

    Raises:
        RobotError: If the mass of a link would be zero or negative, or is zero in the given model.
    """
    changes = {entry.quantity: entry.change for entry in adjusted}
    parameters = tolerance_parameters(robot)
    values = np.array([changes.get(own.name, 0.0) if own.relative else 0.0 for own in parameters])
    try:
        return adjusted_robot(robot, values) if values.any() else robot
    except RobotError as error:
        weightless = [body_name(robot, k) for k in range(1, robot.model.njoints) if robot.model.inertias[k].mass == 0]
        if not weightless:
            raise
        raise RobotError(
            f"{listed(weightless)} of {robot.source} {'has' if len(weightless) == 1 else 'have'} a mass of 0, with "
            "which no change of inertia within its tolerance can be written: write the mass into that file."
        ) from error
