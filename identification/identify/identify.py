"""From a robot and its recordings to an identification.

Model files of an identification that would leave more on held-out data than the given model are not handed out.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.refusal import fault_warnings, require_right
from identification.diagnosis.columns.blocks import split_blocks
from identification.diagnosis.replay import Replay
from identification.estimators.estimator_list import Estimator, estimator_named
from identification.estimators.fit import Fit
from identification.estimators.iv import hausman_test
from identification.estimators.linear.cautions import About
from identification.export.proof.judged_files import leaves_more, rms
from identification.identify.exports import exports, robots_in_files
from identification.identify.hold_out import caution, held_out_evidence, joint_errors, require_enough, split_logs
from identification.identify.identifiability import body_table, excited_base, not_excited, parameters, unidentified
from identification.identify.identification import Export, IdentifiedModel
from identification.identify.identified_model import (
    FullModel,
    JointTerms,
    effects_of,
    full_model,
    model_torque,
    without_estimated,
)
from identification.identify.missed_joints import missed_sentences, shared_effects
from identification.regression.regressor import Regressor, torque_regressor
from identification.regression.triangular import one_blas_thread
from identification.stages import Announcement, Progress, Stage
from identification.words.note_words import sentence
from identification.words.numbers_and_names import number
from phantom_dyn import __version__
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot

_SHOWN = 6  # names in a warning
_FAR = 2.0  # standard deviations: a warning says if a base parameter was moved further to make bodies possible


@one_blas_thread()  # with more, the last digits would depend on the machine
def identify(
    robot: Robot,
    recordings: tuple[Recording, ...],
    *,
    hold_out: tuple[Recording, ...] = (),
    estimator: str = "wls",
    terms: JointTerms | None = None,
    folder: Path | None = None,
    config: Path | None = None,
    progress: Progress = lambda _: None,
) -> IdentifiedModel:
    """Base parameters, friction and drives of a robot, judged on held-out data, with a model to simulate.

    Args:
        robot: Its inertias are the reference of what the data do not determine.
        recordings: For the fit; the end of a single one, or the last of several, is held out.
        hold_out: Recordings to judge on; then all of ``recordings`` are for the fit.
        estimator: A name of `identification.estimators.estimator_list`.
        terms: What is unknown of every joint beside the rigid body; by default viscous and Coulomb friction and offset.
        folder: Where the model files will lie, for the places of meshes; the working folder by default.
        config: The robot's ``robot.yaml``, None for the one beside its file.
        progress: Takes the stages.

    Raises:
        LogError: If a recording cannot be used, or is certainly wrong and not to be judged anyway.
        IdentifiabilityError: If the recordings excite too little.
        EstimationError: If the estimator fails.
        ParameterError: If there is no such estimator, or the robot is not bolted down.
    """
    started = time.perf_counter()
    entry = estimator_named(estimator)
    _require_bolted_down(robot)
    require_right((*recordings, *hold_out))
    progress(Announcement(Stage.FILTERING))
    _require_no_forces(entry, (*recordings, *hold_out))
    split = split_logs(robot, recordings, hold_out)
    terms = JointTerms() if terms is None else terms
    effects = effects_of(robot, terms)
    fitted = without_estimated(robot, terms)
    progress(Announcement(Stage.IDENTIFIABILITY))
    excited = excited_base(fitted, split.train[0], effects)
    require_enough(robot, split, excited.rank)
    progress(Announcement(Stage.ESTIMATION, detail={"estimator": estimator}))
    regressor = torque_regressor(fitted, split.train, effects)
    fit = entry.fit(regressor)
    # Both sides of the test are at hand where instruments are, and only there: they may fail for other estimators.
    bias = hausman_test(regressor).sentence() if estimator == "iv" else ""
    progress(Announcement(Stage.HELD_OUT))
    evidence = held_out_evidence(robot, fitted, fit, split.test)
    errors = joint_errors(robot, evidence.measured, evidence.predicted, evidence.given, fit.relative_error)
    shared = shared_effects(fitted, split, effects, errors)
    progress(Announcement(Stage.POSSIBLE_INERTIAS))
    full = full_model(robot, fitted, fit)
    progress(Announcement(Stage.MODEL_FILES))
    files = exports(full, robot, split.train[0].motion, folder=folder or Path.cwd(), config=config)
    files = without_worse_files(files, robots_in_files(full, robot), robot, split.test, split.cutoff_hz)
    base, others = parameters(fit)
    every = (*recordings, *hold_out)
    lacking = not_excited(fit.base, excited)
    return IdentifiedModel(
        robot=robot.name if robot.source == "" else Path(robot.source).name,
        recordings=tuple(Path(recording.file).name for recording in every),
        estimator=estimator,
        terms=terms.friction,
        band_hz=(0.0, split.cutoff_hz),
        samples=fit.samples,
        rank=fit.rank,
        excitable=excited.rank,
        condition=fit.cond,
        bias=bias,
        base=base,
        others=others,
        unidentified=unidentified(fit.base, excited),
        bodies=body_table(fitted, fit.base, excited),
        held_out=split.words,
        joints=errors,
        departure=tuple(_departure(full, fitted, fit, split.test).tolist()),
        full_words=full.words,
        exports=files,
        warnings=tuple(
            dict.fromkeys(
                (
                    *fault_warnings(every),
                    *missed_sentences(errors, shared),
                    *robot.warnings,
                    *(sentence(said) for recording in every for said in recording.said),
                    *_lacking_excitation(fit, excited.rank, lacking),
                    *caution(split),
                    *(one.sentence for one in fit.cautions if one.about is not About.SEPARATION),
                    *([full.words] if not full.possible or full.moved > _FAR else []),
                )
            )
        ),
        evidence=evidence,
        seconds=time.perf_counter() - started,
        version=__version__,
    )


def _require_bolted_down(robot: Robot) -> None:
    """Refuse a robot whose feet need torques that no estimator knows of."""
    if robot.floating:
        raise ParameterError(
            f"{robot.name} is not bolted down (base: floating), and identify takes robots that are: diagnose it, or "
            "record it on a rig with base: fixed."
        )


def _require_no_forces(entry: Estimator, recordings: Sequence[Recording]) -> None:
    """Refuse measured forces where the loop is simulated: there nothing pushes the robot."""
    pushed = [recording.file for recording in recordings if recording.forces]
    if pushed and entry.simulates:
        raise ParameterError(
            f"{pushed[0]} has measured forces (columns f.), and the estimator {entry.name} simulates the robot without "
            "any: take wls or irls, or a recording without contact."
        )


def _lacking_excitation(fit: Fit, excitable: int, lacking: tuple[str, ...]) -> tuple[str, ...]:
    if not lacking:
        return ()
    some = ", ".join(lacking[:_SHOWN]) + (", ..." if len(lacking) > _SHOWN else "")
    return (
        f"The recording separates {fit.rank} of the {excitable} parameters that motion of this robot can separate; it "
        f"lacks {some}: record a motion that moves every joint, in several postures.",
    )


def _departure(full: FullModel, fitted: Robot, fit: Fit, logs: tuple[Log, ...]) -> Float[Array, " nv"]:
    """Root mean square, per joint, of the torque by which the full model differs from the fit."""
    off = [Regressor.in_band(log, model_torque(full, log.motion) - fit.predict(fitted, log.motion)) for log in logs]
    return np.sqrt(np.mean(np.concatenate(off) ** 2, axis=0))


def without_worse_files(
    files: tuple[Export, ...], robots: Mapping[str, Robot], given: Robot, logs: tuple[Log, ...], cutoff_hz: float
) -> tuple[Export, ...]:
    """The files; of one that leaves more than the given model on any joint the reason in the place of its text.

    Args:
        files: Model files.
        robots: What each of them holds, by its name.
        given: The robot as its file states it.
        logs: That the fit has not seen.
        cutoff_hz: Edge of the band of the fit.
    """
    weights = tuple(np.repeat(log.valid_in_band[:, None].astype(float), given.nv, axis=1) for log in logs)
    parts = tuple((block.log, block.core, block.stop) for block in split_blocks(logs, cutoff_hz))
    replay = Replay(given, logs, (), cutoff_hz, parts, weights)
    before = replay.squares(lambda k: inverse_dynamics(given, logs[k].motion))
    out = []
    for file in files:
        robot = robots[file.file]
        left = replay.squares(lambda k, robot=robot: inverse_dynamics(robot, logs[k].motion))
        worse = leaves_more(left, before)
        if file.text and worse.any():
            after, had = rms(left), rms(before)
            j = int(np.argmax(np.where(worse, after / np.maximum(had, 1e-300), 0.0)))
            unit = given.torque_units[j]
            reason = (
                f"Not written: on {given.joint_names[j]} it would leave {number(after[j])} {unit} on held-out data, "
                f"where the given model leaves {number(had[j])} {unit}."
            )
            file = replace(file, text="", left_out=(reason,))
        out.append(file)
    return tuple(out)
