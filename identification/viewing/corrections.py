"""Reads corrections of a model (findings, changes within tolerances) from a diagnosis or ``corrected.yaml``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Adjusted, Diagnosis
from identification.export.corrected.corrected_yaml import CorrectedEffect, known_effect, read_corrected
from identification.export.corrected.found_effects import findings_in_all_recordings
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from phantom_dyn.errors import UsageError
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class Correction:
    """Corrections of the given model.

    Attributes:
        effects: Findings that act in all recordings.
        adjusted: Changes of the model within its tolerances.
        horizon_s: Length of each simulation in the diagnosis [s]; None if the file does not state a length.
    """

    effects: tuple[KnownEffect, ...] = ()
    adjusted: tuple[Adjusted, ...] = ()
    horizon_s: float | None = None


def read_correction(path: Path, robot: Robot) -> Correction:
    """Reads the corrections in a ``diagnosis.json``, in the folder of ``diagnose --out``, or in a ``corrected.yaml``.

    Args:
        path: Path of the file or folder.
        robot: The model that was diagnosed.

    Raises:
        LogError: If the file does not exist or is no diagnosis.
        UsageError: If the diagnosis is of a robot with other joints.
        ParameterError: If an effect, its joint or a parameter is unknown.
    """
    if path.suffix in (".yaml", ".yml"):
        corrected = read_corrected(path)
        return Correction(_effects(corrected.effects, robot, path), corrected.adjusted)
    return _of_diagnosis(read_diagnosis(path), robot, path)


def _of_diagnosis(diagnosis: Diagnosis, robot: Robot, path: Path) -> Correction:
    """The corrections in a diagnosis, after a check that its joints are the robot's."""
    joints = tuple(joint.joint for joint in diagnosis.joints)
    if joints != robot.joint_names:
        raise UsageError(
            f"{path} is a diagnosis of a robot with the joints {', '.join(joints)}, and {robot.name} has "
            f"{', '.join(robot.joint_names)}: give the robot and the robot.yaml that were diagnosed"
        )
    findings = tuple(
        CorrectedEffect(one.effect, one.joint, one.parameters, one.gap_closed)
        for one in findings_in_all_recordings(diagnosis)
    )
    rollout = diagnosis.rollout or {}
    return Correction(_effects(findings, robot, path), diagnosis.adjusted, rollout.get("horizon_s"))


def _effects(entries: tuple[CorrectedEffect, ...], robot: Robot, path: Path) -> tuple[KnownEffect, ...]:
    return tuple(known_effect(entry, robot, path) for entry in entries)
