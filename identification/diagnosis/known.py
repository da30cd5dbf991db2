"""Findings of earlier diagnoses, as part of the given model."""

from __future__ import annotations

from pathlib import Path

from identification.diagnosis.terms import KnownEffect
from identification.export.corrected import read_corrected
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.inertial_parameters import InertialParameters
from phantom_dyn.errors import ParameterError, PhantomDynError
from phantom_dyn.robot import Robot


def known_effects(files: tuple[Path, ...], robot: Robot) -> tuple[KnownEffect, ...]:
    """All effects of several ``corrected.yaml``, checked against the robot.

    Raises:
        ParameterError: If a file names an unknown effect, joint or parameter, or leaves one out.
    """
    out = []
    for file in files:
        for entry in read_corrected(file).effects:
            try:
                effect = effect_named(entry.effect)
            except PhantomDynError as error:
                raise ParameterError(f"{file}: {error}") from error
            places = effect.places(robot)
            if entry.joint is None and None not in places and not isinstance(effect, InertialParameters):
                raise ParameterError(
                    f"{file}: effect {entry.effect} has no joint, wanted one of {', '.join(robot.joint_names)}."
                )
            # Two joints that are coupled need not be neighbours to be known.
            apart = entry.joint.split("+") if entry.joint is not None else []
            if entry.joint not in places and not set(apart) <= set(robot.joint_names):
                raise ParameterError(
                    f"{file}: effect {entry.effect} is on joint '{entry.joint}', which this robot does not have: "
                    f"its joints are {', '.join(robot.joint_names)}."
                )
            names = [parameter.name for parameter in effect.parameters(robot, entry.joint)]
            unknown = sorted(set(entry.parameters) - set(names))
            # Inertial parameters that are not named did not move.
            missing = [] if isinstance(effect, InertialParameters) else sorted(set(names) - set(entry.parameters))
            if unknown or missing:
                raise ParameterError(
                    f"{file}: effect {entry.effect} has parameters {', '.join(entry.parameters)}, wanted "
                    f"{', '.join(names)}: correct the file or diagnose again."
                )
            theta: list[float] = []
            for name in names:
                value = entry.parameters[name].value if name in entry.parameters else 0.0
                theta += [float(x) for x in value] if isinstance(value, list) else [float(value)]
            out.append(KnownEffect(entry.effect, entry.joint, tuple(theta)))
    return tuple(out)
