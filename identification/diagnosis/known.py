"""Findings of earlier diagnoses, as part of the given model."""

from __future__ import annotations

from pathlib import Path

from identification.diagnosis.columns import KnownEffect
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
            if entry.joint is None and effect.scope == "joint":
                raise ParameterError(
                    f"{file}: effect {entry.effect} has no joint, wanted one of {', '.join(robot.joint_names)}."
                )
            if entry.joint is not None and entry.joint not in robot.joint_names:
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
            values = (entry.parameters[n].value if n in entry.parameters else 0.0 for n in names)
            theta = tuple(float(value) for value in values if not isinstance(value, list))
            out.append(KnownEffect(entry.effect, entry.joint, theta))
    return tuple(out)
