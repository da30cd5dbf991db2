"""The findings of a diagnosis as effects with the contract's parameters in order."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from identification.diagnosis.result import Diagnosis, Finding
from identification.diagnosis.terms import KnownEffect
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.inertial_parameters import InertialParameters
from phantom_dyn.robot import Robot

Array = np.ndarray


def lasting_findings(diagnosis: Diagnosis) -> tuple[Finding, ...]:
    """Findings that act in all recordings: what acts in one of them only is no part of the robot."""
    return tuple(finding for finding in diagnosis.findings if finding.recording is None)


def effect_of(robot: Robot, finding: Finding) -> KnownEffect:
    """A finding as an effect; inertial parameters that are not named did not move.

    Raises:
        ParameterError: If the effect is unknown.
        RobotError: If the robot does not have its joint.
    """
    names = _names(robot, finding)
    theta: list[float] = []
    for name in names:
        value = finding.parameters[name].value if name in finding.parameters else 0.0
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
    for name in _names(robot, finding):
        out += [np.array(row) for row in given[name]] if name in given else [np.zeros(width)]
    return np.array(out).reshape(len(out), width)


def _names(robot: Robot, finding: Finding) -> list[str]:
    effect = effect_named(finding.effect)
    known = [parameter.name for parameter in effect.parameters(robot, finding.joint)]
    if isinstance(effect, InertialParameters):
        return known
    return [name for name in known if name in finding.parameters] + [n for n in finding.parameters if n not in known]


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
