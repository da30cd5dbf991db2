"""Diagnoses measured poses, and adds the result to a diagnosis of torques if there is one."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING
from uuid import uuid4

import numpy as np

from identification.data.recording import Recording
from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import Diagnosis, EffectAt, Finding, Gap, Unexplained
from identification.engine.claims import Claim
from identification.geometry.measured import has_poses
from identification.geometry.pins import KnownPlaces
from identification.geometry.terms import ZERO
from identification.notes import Code, Note
from phantom_dyn import __version__
from phantom_dyn.model.robot import Robot

if TYPE_CHECKING:
    from identification.geometry.result import GeometryResult

_AGREE = 3.0  # standard deviations within which two estimates of an encoder's zero agree


def with_poses(
    diagnosis: Diagnosis, robot: Robot, recordings: tuple[Recording, ...], known: KnownPlaces | None = None
) -> Diagnosis:
    """A diagnosis of torques with the findings of measured poses added; unchanged if there are no poses.

    Args:
        diagnosis: Diagnosis of the torques.
        robot: The given model.
        recordings: All recordings.
        known: Corrected placements of the joints and frames of a closed chain, from earlier diagnoses of poses.
    """
    if not has_poses(recordings):
        return diagnosis
    from identification.geometry.diagnose_poses import diagnose_poses

    started = time.perf_counter()
    found = diagnose_poses(robot, recordings, known)
    assert found is not None
    notes = tuple(zero_notes(diagnosis.findings, found))
    found = replace(found, torque_verdict=diagnosis.verdict, notes=notes)
    return replace(
        diagnosis,
        geometry=found,
        verdict=verdict_together(diagnosis.verdict, found.verdict),
        data_warnings=(*diagnosis.data_warnings, *found.warnings),
        ledger=(*diagnosis.ledger, *_entries(found)),
        seconds=diagnosis.seconds + time.perf_counter() - started,
    )


def diagnosis_of_poses(robot: Robot, recordings: tuple[Recording, ...], known: KnownPlaces | None = None) -> Diagnosis:
    """A diagnosis of poses alone.

    Args:
        robot: The given model.
        recordings: Recordings with poses and without torque.
        known: Corrected placements of the joints and frames of a closed chain, from earlier diagnoses of poses.
    """
    from identification.geometry.diagnose_poses import diagnose_poses

    started = time.perf_counter()
    found = diagnose_poses(robot, recordings, known)
    assert found is not None
    no_rows = np.zeros((0, robot.nv))
    return Diagnosis(
        verdict=found.verdict,
        robot=robot.name,
        recordings=tuple(recording.file for recording in recordings),
        joints=(),
        band_hz=(0.0, 0.0),
        findings=(),
        adjusted=(),
        unexplained=Unexplained(0.0, found.structured, None, "posture" if found.structured else None),
        bounds=(),
        not_testable=(),
        data_warnings=(
            *robot.warnings,
            *(remark for recording in recordings for remark in recording.remarks),
            *found.warnings,
        ),
        next_experiment=None,
        rollout=None,
        seconds=time.perf_counter() - started,
        version=__version__,
        evidence=Evidence(np.zeros(0), no_rows, no_rows, no_rows, no_rows, no_rows, no_rows, ({},) * robot.nv),
        run=uuid4().hex,
        geometry=found,
        ledger=_entries(found),
        gap=Gap(found.closed, found.interval),
    )


def _entries(found: GeometryResult) -> tuple[Claim[EffectAt], ...]:
    """Entries of the ledger for the effects of the geometry, with the results of their gates."""
    return tuple(
        Claim(
            tuple(EffectAt(*at) for at in claim.effects),
            claim.gates,
            claim.outcome,
            tuple(EffectAt(*at) for at in claim.instead),
            claim.figures,
            claim.judged_by,
        )
        for claim in found.claims
    )


def verdict_together(torques: str, poses: str) -> str:
    """The common verdict of a diagnosis of torques and one of poses.

    Any other verdict takes precedence over ``no_gap``, which takes precedence over ``not_testable``. Of two other
    verdicts that differ, ``unknown`` takes precedence; without it the result is ``partly_explained``.

    Args:
        torques: Verdict of the torques.
        poses: Verdict of the poses.
    """
    if torques == poses:
        return torques
    for weaker in ("not_testable", "no_gap"):
        if torques == weaker:
            return poses
        if poses == weaker:
            return torques
    return "unknown" if "unknown" in (torques, poses) else "partly_explained"


def zero_notes(findings: Sequence[Finding], poses: GeometryResult) -> list[Note]:
    """A note on each encoder zero that torques and poses both show: both estimates, and whether they agree."""
    pose_zeros = {one.joint: one.parameters["offset"] for one in (*poses.findings, *poses.minor) if one.effect == ZERO}
    out = []
    for finding in findings:
        if finding.effect != ZERO or finding.joint not in pose_zeros:
            continue
        by_torque, by_pose = finding.parameters["offset"], pose_zeros[finding.joint]
        offset, std = by_torque.numbers[0], by_torque.stds[0]
        distance = abs(offset - by_pose.value) / max(float(np.hypot(std, by_pose.std)), 1e-300)
        sizes = {"by_torque": offset, "by_pose": by_pose.value, "unit": by_pose.unit}
        out.append(Note(Code.ZEROS_COMPARED, finding.joint, {**sizes, "agree": bool(distance < _AGREE)}))
    return out
