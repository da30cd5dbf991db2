"""Runs the stages of a diagnosis in order: data, explanation, judgement, rollout, result, next experiment."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from uuid import uuid4

import numpy as np

from identification.data.changes import Change
from identification.data.checks.torques.lag_warnings import LagSentence
from identification.data.drives.arrivals import arrival_notes
from identification.data.recording import Recording
from identification.data.refusal import fault_warnings, wrong_with
from identification.diagnosis.columns.prepared import Prepared, prepared
from identification.diagnosis.columns.session import Session, session_of
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.explanation import Explanation, explanation_of
from identification.diagnosis.judge.bursts import burst_notes
from identification.diagnosis.judge.file_numbers import replay_of
from identification.diagnosis.judge.judgement import judgement_of
from identification.diagnosis.result import Diagnosis, Judgement
from identification.next_experiment.advise import Proposal
from identification.notes import Code, Note, Remark
from identification.regression.triangular import one_blas_thread
from identification.rollout.compare import Rollout
from identification.rollout.rollout import Explained, rollout_of, unknown_if_motion_deviates
from identification.rollout.simulated_motion import with_simulated_motion
from identification.scenarios import other_bands
from identification.scenarios.common_model import has_unknown_load, with_common_model
from identification.scenarios.gain_ambiguities import without_gain_ambiguities
from identification.scenarios.gain_or_load import preferred_diagnosis, scales_by_friction, with_scaled_gains
from identification.scenarios.known_changes import with_catalogue_names
from identification.scenarios.measured_poses import diagnosis_of_poses, with_poses
from identification.scenarios.protected_drives import protection_notes
from identification.scenarios.torque_or_motion import Reader, driven_by_controllers, torque_or_motion
from identification.scenarios.unlike_recordings import with_unlike_recordings
from identification.stages import Announcement, Progress, Stage
from identification.words.user_words import with_user_words
from phantom_dyn import __version__
from phantom_dyn.errors import LogError, UsageError
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class DiagnosisWithoutPlan:
    """A diagnosis for which no next experiment has been planned yet; the plan changes none of its findings.

    Attributes:
        diagnosis: The diagnosis, without a next experiment.
        explanation: Sets of effects that the next experiment is to separate; None if no experiment is planned.
        started: Start of the diagnosis, by `time.perf_counter` [s].
    """

    diagnosis: Diagnosis
    explanation: Explanation | None = None
    started: float = 0.0


def diagnose(
    robot: Robot,
    recordings: tuple[Recording, ...] | Reader,
    *,
    held_out: int = 0,
    known: tuple[KnownEffect, ...] = (),
    changes: tuple[Change, ...] = (),
    motion_only: bool = False,
    progress: Progress = lambda _: None,
) -> Diagnosis:
    """Diagnosis of recordings, with a plan for the next experiment.

    The arguments and errors are those of `diagnose_without_plan`.
    """
    found = diagnose_without_plan(
        robot,
        recordings,
        held_out=held_out,
        known=known,
        changes=changes,
        motion_only=motion_only,
        progress=progress,
    )
    return with_proposal(found.diagnosis, planned(found, progress), found.started)


# With more threads the order of sums, and so the last digits, would depend on the machine.
@one_blas_thread()
def planned(found: DiagnosisWithoutPlan, progress: Progress = lambda _: None) -> Proposal:
    """The motion that separates the most rivals of a diagnosis; an empty proposal if no motion can be planned."""
    if found.explanation is None or not any(finding.rivals for finding in found.diagnosis.findings):
        return Proposal()
    progress(Announcement(Stage.NEXT_EXPERIMENT))
    from identification.next_experiment.advise import proposed  # imports the planning of motions

    return proposed(found.explanation, found.diagnosis.findings)


def with_proposal(found: Diagnosis, proposal: Proposal, started: float) -> Diagnosis:
    """A diagnosis with the proposed next experiment, if there is one, and with the time of diagnosis and proposal.

    Args:
        found: The diagnosis, without a next experiment.
        proposal: The proposed experiment.
        started: Start of the diagnosis, by `time.perf_counter` [s].
    """
    if proposal == Proposal():
        return found
    return replace(
        found,
        next_experiment=proposal.experiment,
        next_motion=proposal.motion,
        notes=(*found.notes, *proposal.notes),
        seconds=time.perf_counter() - started,
    )


def diagnose_without_plan(
    robot: Robot,
    recordings: tuple[Recording, ...] | Reader,
    *,
    held_out: int = 0,
    known: tuple[KnownEffect, ...] = (),
    changes: tuple[Change, ...] = (),
    motion_only: bool = False,
    progress: Progress = lambda _: None,
) -> DiagnosisWithoutPlan:
    """Diagnosis of recordings, without a plan for the next experiment.

    Recordings with torque are judged by this torque. Recordings without torque are judged by the torque that their
    controllers command, or by their positions at rest.

    Args:
        robot: The model that is judged.
        recordings: The recordings, or a function that reads them. The function's argument says whether a torque is
            needed. With a function only the used parts of long recordings are kept in memory.
        held_out: Number of recordings, counted from the last one, that no fit sees. If it is not zero, all figures are
            computed on these recordings, otherwise on held-out blocks of all recordings.
        known: Effects that the given model already contains.
        changes: Known differences between the recordings.
        motion_only: True if a recorded torque must not be used.
        progress: Called at the start of each stage.

    Raises:
        UsageError: If recordings at rest are given with held-out recordings or known effects.
        LogError: If a recording cannot be used, if it is certainly wrong (unless it was read with ``anyway``), or if it
            does not determine the gain of a controller.
    """
    read = recordings if callable(recordings) else lambda _: recordings
    driven, given, motion = torque_or_motion(robot, read, motion_only=motion_only)
    if not motion:
        used = prepared(driven, given, held_out=held_out, known=known, changes=changes)
        del given  # `used` holds a few minutes of the recordings; this frees the memory of the other hours
        used = with_common_model(used) if has_unknown_load(changes) else used
        return _by_torque(used, progress)
    from identification.scenarios.at_rest.diagnose_at_rest import diagnose_at_rest, judged_at_rest

    if not judged_at_rest(driven, given):
        return _by_controllers(driven, given, held_out, known, progress)
    if known or held_out:
        raise UsageError(
            f"{given[0].file}: it is judged at rest, where every rest is held out in turn, so that held-out recordings "
            "and effects of an earlier diagnosis (--hold-out, --with) do not go with it; leave them out"
        )
    return DiagnosisWithoutPlan(replace(diagnose_at_rest(driven, given), driven=driven))


def _by_controllers(
    robot: Robot,
    recordings: tuple[Recording, ...],
    held_out: int,
    known: tuple[KnownEffect, ...],
    progress: Progress,
) -> DiagnosisWithoutPlan:
    """The diagnosis by the torque that controllers command; gains that the robot does not state are estimated.

    If the friction found with estimated gains suggests higher gains, the recordings are diagnosed with both.

    Args:
        robot: The model that is judged.
        recordings: Recordings with references, or with voltages from which a torque follows.
        held_out: Number of recordings, counted from the last one, that no fit sees.
        known: Effects of an earlier diagnosis, which the model contains.
        progress: Called at the start of each stage.

    Raises:
        LogError: If a recording cannot be used, or the motion does not determine the gains.
    """
    driven, moved = driven_by_controllers(robot, recordings)
    first = _by_torque(prepared(driven, moved, held_out=held_out, known=known), progress)
    scales = scales_by_friction(driven, moved, first.diagnosis.findings)
    if not scales:
        return replace(first, diagnosis=replace(first.diagnosis, driven=driven))
    higher, again = with_scaled_gains(driven, moved, scales)
    second = _by_torque(prepared(higher, again, held_out=held_out, known=known), progress)
    leads, found = preferred_diagnosis(first.diagnosis, second.diagnosis, scales)
    leading = second if leads else first
    return replace(leading, diagnosis=replace(found, driven=higher if leads else driven), started=first.started)


@one_blas_thread()
def _by_torque(given: Prepared, progress: Progress) -> DiagnosisWithoutPlan:
    """The diagnosis by torques and measured poses. It states no gap only if other bands show none either."""
    if not given.fitted:
        progress(Announcement(Stage.FITTING_POSES))
        return DiagnosisWithoutPlan(diagnosis_of_poses(given.robot, given.with_poses, given.places))
    session = _session(given, progress)
    found = _of_session(given, session, progress)
    if found.diagnosis.verdict != "no_gap":
        return found
    for factor in other_bands.FACTORS:
        try:
            other = _session(given, progress, factor)
            if not other_bands.are_distinct_bands(session.cutoff_hz, other.cutoff_hz):
                continue
            second = _of_session(given, other, progress)
        except LogError:  # the filter of a narrow band may leave too few samples
            continue
        if other_bands.shows_gap(second.diagnosis):
            return replace(second, diagnosis=other_bands.with_band_note(second.diagnosis, found.diagnosis))
    return found


def _session(given: Prepared, progress: Progress, factor: float = 1.0) -> Session:
    """The recordings in a common band whose edge is that chosen from the data times a factor."""
    progress(Announcement(Stage.FILTERING))
    known, changes = given.known, given.changes
    return session_of(given.robot, given.fitted, given.held_out, known=known, changes=changes, band_factor=factor)


def _of_session(given: Prepared, session: Session, progress: Progress) -> DiagnosisWithoutPlan:
    """The diagnosis in one band, stage by stage."""
    robot, changes = given.robot, given.changes
    explanation = explanation_of(session, progress)
    progress(Announcement(Stage.RIVALS_COMPARED))
    judgement, shown = judgement_of(explanation, progress)
    progress(Announcement(Stage.LAW))
    if judgement.unexplained.structured:
        from identification.diagnosis.law.find_law import with_law  # imports a dozen modules that few runs need

        judgement = with_law(judgement, shown)
    progress(Announcement(Stage.SIMULATION))
    floor = np.array([joint.noise_floor for joint in judgement.joints])
    rollout = rollout_of(Explained(shown.problem, shown.named, shown.named_fit, floor))
    judgement = unknown_if_motion_deviates(
        without_gain_ambiguities(judgement, session.recordings, rollout, robot), rollout
    )
    # Effects of single recordings explain changes between recordings. A further motion cannot separate their rivals.
    between = bool(session.differences.effects)
    judgement = with_user_words(with_catalogue_names(judgement, session) if between else judgement, robot)
    soft = (Note(Code.SOFT_FRICTION),) if session.robot.soft_friction else ()
    brakes = tuple(Note(Code.BRAKED, joint, {"file": log.file}) for log in session.logs for joint in log.braked)
    tried = {"fits": explanation.fits, "floating": robot.floating}
    endless = (Note(Code.SEARCH_WITHOUT_END, numbers=tried),) if explanation.endless else ()
    drives = (*arrival_notes(session.robot, session.recordings), *protection_notes(session))
    judgement = with_unlike_recordings(shown.problem, judgement)
    judgement = replace(judgement, notes=(*given.notes, *soft, *brakes, *endless, *drives, *judgement.notes))
    found = _result(session, given.files, judgement, rollout, time.perf_counter() - given.started)
    found = replace(found, replay=replay_of(shown.problem, changes))
    found = with_poses(found, robot, given.with_poses, given.places)
    # No experiment is planned for a floating base either, because its motion cannot be predicted.
    return DiagnosisWithoutPlan(found, None if between or robot.floating else explanation, given.started)


def _result(
    session: Session,
    files: tuple[str, ...],
    judgement: Judgement,
    rollout: Rollout,
    seconds: float,
) -> Diagnosis:
    """The diagnosis, assembled from the results of the stages."""
    return Diagnosis(
        verdict=judgement.verdict,
        robot=session.robot.name,
        recordings=files,
        joints=judgement.joints,
        band_hz=(0.0, float(session.cutoff_hz)),
        findings=judgement.findings,
        adjusted=judgement.adjusted,
        unexplained=judgement.unexplained,
        bounds=judgement.bounds,
        not_testable=judgement.not_testable,
        data_warnings=(
            *fault_warnings(session.recordings),
            *session.robot.warnings,
            *(
                remark
                for recording in session.recordings
                for remark in recording.remarks
                if not _is_explained(remark, judgement)
            ),
            *rollout.warnings,
            *judgement.warnings,
            *burst_notes(judgement.bursts, judgement.joints),
        ),
        next_experiment=None,
        rollout=rollout.json,
        seconds=seconds,
        version=__version__,
        evidence=with_simulated_motion(judgement.evidence, rollout, session.logs),
        notes=(*rollout.notes, *judgement.notes),
        wrong=wrong_with(session.recordings),
        gap=judgement.gap,
        minor=judgement.minor,
        numbers=judgement.numbers,
        run=uuid4().hex,
        ledger=judgement.ledger,
    )


def _is_explained(remark: Remark, judgement: Judgement) -> bool:
    """True for a warning that the torque of a joint is too early, if a slow drive found on that joint explains it."""
    if not isinstance(remark, LagSentence) or not remark.early:
        return False
    slow = (one for one in judgement.findings if any(number.unit == "s" for number in one.parameters.values()))
    return any(one.joint in (None, remark.joint) for one in slow)
