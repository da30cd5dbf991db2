"""The whole line of a diagnosis, stage by stage: data, explanation, judgement, rollout, next experiment, result."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from uuid import uuid4

import numpy as np

from identification.data.changes import Change
from identification.data.recording import Recording
from identification.data.refusal import fault_warnings, require_right, wrong_with
from identification.data.stretches import is_long, note_on_length, stretches
from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.known_geometry import as_known, of_torques, places_of_loops, with_known_places
from identification.diagnosis.columns.session import Session, session_of
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.explanation import Explanation, explained
from identification.diagnosis.judge.bursts import burst_notes
from identification.diagnosis.judge.file_numbers import replay_of
from identification.diagnosis.judge.judgement import judged
from identification.diagnosis.judge.user_words import with_user_words
from identification.diagnosis.result import Diagnosis, Finding, Judgement
from identification.geometry.measured import has_poses
from identification.geometry.pins import KnownPlaces
from identification.next_experiment.proposal import Proposal
from identification.notes import Code, Note, Said
from identification.regression.triangular import one_blas_thread
from identification.rollout.compare import Rollout
from identification.rollout.rollout import Explained, rollout_of
from identification.scenarios.gain_or_load import either, scales_by_friction, with_scaled_gains
from identification.scenarios.known_changes import named_by_recording
from identification.scenarios.measured_poses import diagnosis_of_poses, with_poses
from identification.scenarios.motion_limits import limited_to_motion
from identification.scenarios.torque_or_motion import moved_by_controllers, torque_or_motion
from identification.stages import Announcement, Progress, Stage
from phantom_dyn import __version__
from phantom_dyn.errors import LogError, UsageError
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class Prepared:
    """What a diagnosis works on: of long recordings the stretches that it uses, and nothing of the rest.

    Attributes:
        robot: The model that is judged.
        seen: What fits may see.
        unseen: What no fit sees.
        known: Effects on torques that belong to the given model already.
        changes: What is known to be different between the recordings, those held out at the end; empty: nothing.
        tracked: Recordings with measured poses, if there are any.
        places: Places of a closed chain that earlier poses have shown.
        files: Names of all recordings.
        notes: On what is used of long ones.
        started: On the clock that counts the seconds of a diagnosis.
    """

    robot: Robot
    seen: tuple[Recording, ...]
    unseen: tuple[Recording, ...]
    known: tuple[KnownEffect, ...]
    changes: tuple[Change, ...]
    tracked: tuple[Recording, ...]
    places: KnownPlaces | None
    files: tuple[str, ...]
    notes: tuple[Said, ...]
    started: float


# With more threads sums come in another order, and the last digits would depend on the machine.
@one_blas_thread()
def prepared(
    robot: Robot,
    recordings: tuple[Recording, ...],
    *,
    hold_out: tuple[Recording, ...] = (),
    known: tuple[KnownEffect, ...] = (),
    changes: tuple[Change, ...] = (),
) -> Prepared:
    """What a diagnosis works on; whoever lets the recordings go then frees the memory of hours.

    Args:
        robot: This and the others as of `diagnose`.
        recordings: .
        hold_out: .
        known: .
        changes: .

    Raises:
        LogError: If a recording cannot be used, or is certainly wrong and not to be judged anyway.
    """
    started = time.perf_counter()
    every = (*recordings, *hold_out)
    require_right(every)
    robot = with_known_places(robot, known)
    tracked = as_known(robot, every, known)
    if changes and any(one.poses_alone for one in every):
        raise LogError(
            "A log of poses without torque was given with --recordings, which is about torques: diagnose it by itself."
        )
    recordings, hold_out = (tuple(one for one in some if not one.poses_alone) for some in (recordings, hold_out))
    # What changed is known of whole recordings.
    seen, unseen = (recordings, hold_out) if changes else (_stretches(recordings), _stretches(hold_out))
    return Prepared(
        robot,
        seen,
        unseen,
        of_torques(known),
        changes,
        tracked if has_poses(tracked) else (),
        places_of_loops(robot, known),
        files=tuple(recording.file for recording in every),
        notes=() if changes else tuple(note_on_length(one) for one in (*recordings, *hold_out) if is_long(one)),
        started=started,
    )


def diagnose(
    robot: Robot,
    recordings: tuple[Recording, ...],
    *,
    hold_out: tuple[Recording, ...] = (),
    known: tuple[KnownEffect, ...] = (),
    changes: tuple[Change, ...] = (),
    progress: Progress = lambda _: None,
) -> Diagnosis:
    """Say where the gap between robot and recordings lies, what causes it, and how far it shrinks.

    Args:
        robot: The model that is judged.
        recordings: What fits may see; they are judged on blocks that they have not seen.
        hold_out: Recordings that no fit sees; if there are any, all figures are those on them.
        known: Effects that belong to the given model already.
        changes: What is known to be different between the recordings, those held out at the end; empty: nothing.
        progress: Takes the stages.

    Raises:
        LogError: If a recording cannot be used, or is certainly wrong and not to be judged anyway.
    """
    given = prepared(robot, recordings, hold_out=hold_out, known=known, changes=changes)
    return diagnose_prepared(given, progress)


@one_blas_thread()
def diagnose_prepared(given: Prepared, progress: Progress = lambda _: None) -> Diagnosis:
    """As `diagnose`, of recordings that are prepared.

    Args:
        given: See `prepared`.
        progress: Takes the stages.

    Raises:
        LogError: If a recording cannot be used.
    """
    robot, changes = given.robot, given.changes
    if not given.seen:
        progress(Announcement(Stage.FITTING_POSES))
        return diagnosis_of_poses(robot, given.tracked, given.places)
    progress(Announcement(Stage.FILTERING))
    session = session_of(robot, given.seen, given.unseen, known=given.known, changes=changes)
    explanation = explained(session, progress)
    progress(Announcement(Stage.RIVALS_COMPARED))
    judgement, shown = judged(explanation, progress)
    progress(Announcement(Stage.LAW))
    if judgement.unexplained.structured:
        from identification.diagnosis.law.find_law import with_law  # a dozen modules, which few runs need

        judgement = with_law(judgement, shown)
    progress(Announcement(Stage.SIMULATION))
    floor = np.array([joint.noise_floor for joint in judgement.joints])
    rollout = rollout_of(Explained(shown.problem, shown.named, shown.found, floor))
    judgement = borne_out_by_motion(limited_to_motion(judgement, session.recordings, rollout, robot), rollout)
    proposal = Proposal()
    if session.differences.own:
        # Rivals between recordings are about what changed, which no further motion of one of them separates.
        judgement = with_user_words(named_by_recording(judgement, session), robot)
    else:
        judgement = with_user_words(judgement, robot)
        proposal = _proposed(explanation, judgement.findings, progress)
    soft = (Note(Code.SOFT_FRICTION),) if session.robot.soft_friction else ()
    judgement = replace(judgement, notes=(*given.notes, *soft, *judgement.notes))
    seconds = time.perf_counter() - given.started
    found = _result(session, given.files, judgement, rollout, proposal, seconds)
    found = replace(found, replay=replay_of(shown.problem, changes))
    return with_poses(found, robot, given.tracked, given.places)


def diagnose_logs(
    robot: Robot,
    read: Callable[[bool], tuple[Recording, ...]],
    *,
    held_out: int = 0,
    known: tuple[KnownEffect, ...] = (),
    motion_only: bool = False,
    progress: Progress = lambda _: None,
) -> tuple[Robot, Diagnosis]:
    """Diagnosis of recordings by their torque; without one by that of the controllers, or in positions at rest.

    Args:
        robot: The model that is judged.
        read: The recordings, by whether a torque is needed.
        held_out: How many of them, from the last, no fit sees.
        known: Effects that belong to the given model already.
        motion_only: True if a torque that was recorded is not to be used.
        progress: Takes the stages.

    Returns:
        The robot that was judged, with the gains of its controllers, and the diagnosis.

    Raises:
        UsageError: If something is given that does not go with recordings at rest.
        LogError: If a recording cannot be used.
    """
    driven, recordings, motion = torque_or_motion(robot, read, motion_only=motion_only)
    if motion:
        from identification.scenarios.at_rest.diagnose_at_rest import diagnose_at_rest, judged_at_rest

        if judged_at_rest(driven, recordings):
            if known or held_out:
                raise UsageError(
                    f"{recordings[0].file}: it is judged at rest, where every rest is held out in turn, so that "
                    "held-out recordings and effects of an earlier diagnosis (--hold-out, --with) do not go with it; "
                    "leave them out"
                )
            return driven, diagnose_at_rest(driven, recordings)
        return diagnose_controlled(driven, recordings, held_out=held_out, known=known, progress=progress)
    count = len(recordings) - held_out
    given = prepared(driven, recordings[:count], hold_out=recordings[count:], known=known)
    del recordings
    return driven, diagnose_prepared(given, progress)


def diagnose_controlled(
    robot: Robot,
    recordings: tuple[Recording, ...],
    *,
    held_out: int = 0,
    known: tuple[KnownEffect, ...] = (),
    progress: Progress = lambda _: None,
) -> tuple[Robot, Diagnosis]:
    """The robot with the gains of its controllers, and the diagnosis by the torque that these ask for.

    Where gains are estimated and friction speaks for higher ones, both readings are diagnosed.

    Args:
        robot: The model that is judged; gains that it does not state are estimated.
        recordings: With references, or with voltages that give a torque.
        held_out: How many of them, from the last, no fit sees.
        known: Effects that belong to the given model already.
        progress: Takes the stages.

    Raises:
        LogError: If a recording cannot be used, or the motion tells no gain.
    """
    driven, moved = moved_by_controllers(robot, recordings)
    count = len(moved) - held_out
    first = diagnose(driven, moved[:count], hold_out=moved[count:], known=known, progress=progress)
    scales = scales_by_friction(driven, moved, first.findings)
    if not scales:
        return driven, first
    higher, again = with_scaled_gains(driven, moved, scales)
    second = diagnose(higher, again[:count], hold_out=again[count:], known=known, progress=progress)
    leads, found = either(first, second, scales)
    return higher if leads else driven, found


def _proposed(explanation: Explanation, findings: tuple[Finding, ...], progress: Progress) -> Proposal:
    progress(Announcement(Stage.NEXT_EXPERIMENT))
    if not any(finding.rivals for finding in findings):
        return Proposal()
    from identification.next_experiment.advise import proposed  # with all that plans motions

    return proposed(explanation, findings)


def _stretches(recordings: tuple[Recording, ...]) -> tuple[Recording, ...]:
    return tuple(part for recording in recordings for part in stretches(recording))


def borne_out_by_motion(judgement: Judgement, rollout: Rollout) -> Judgement:
    """The same, but a gap of unknown cause where a model whose torque shows none does not move as the robot does."""
    if judgement.verdict != "no_gap" or max(rollout.strays.values(), default=0.0) < rules.STRAYS_FAR:
        return judgement
    joint = max(rollout.strays, key=lambda name: rollout.strays[name])
    return replace(judgement, verdict="unknown", unexplained=replace(judgement.unexplained, joint=joint))


def _result(
    session: Session,
    files: tuple[str, ...],
    judgement: Judgement,
    rollout: Rollout,
    proposal: Proposal,
    seconds: float,
) -> Diagnosis:
    """Everything that the stages have found, in the shape of the contract."""
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
            *(said for recording in session.recordings for said in recording.said),
            *rollout.warnings,
            *judgement.warnings,
            *burst_notes(judgement.bursts, judgement.joints),
        ),
        next_experiment=proposal.experiment,
        rollout=rollout.json,
        seconds=seconds,
        version=__version__,
        evidence=judgement.evidence,
        notes=(*rollout.notes, *judgement.notes, *proposal.notes),
        next_motion=proposal.motion,
        wrong=wrong_with(session.recordings),
        gap=judgement.gap,
        minor=judgement.minor,
        numbers=judgement.numbers,
        run=uuid4().hex,
        ledger=judgement.ledger,
    )
