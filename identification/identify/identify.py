"""Identifies the parameters of a robot from its recordings.

Each friction term acts on one joint. If two joints share a transmission, friction may depend on the motion of both.
Therefore, for joints with a large error on held-out data, every effect of the catalogue that acts on a pair of joints
is fitted too. A warning names the best one if it halves the error on held-out data.

A model file with larger errors on held-out data than the given model is not written.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.refusal import fault_warnings, require_right
from identification.diagnosis.columns.blocks import split_blocks
from identification.diagnosis.replay import Replay
from identification.estimators.estimator_list import Estimator, estimator_named
from identification.estimators.fit import Fit, relative_rms
from identification.estimators.iv import hausman_test
from identification.estimators.linear.cautions import About
from identification.estimators.weighted_least_squares import wls
from identification.export.check.checked_files import has_larger_residual, rms
from identification.identify.hold_out import (
    Split,
    caution,
    held_out_evidence,
    joint_errors,
    require_enough,
    split_logs,
)
from identification.identify.identifiability import body_table, excited_base, not_excited, parameters, unidentified
from identification.identify.identification import Export, IdentifiedModel, JointError
from identification.identify.identification_words import error_percent
from identification.identify.identified_model import (
    FullModel,
    JointTerms,
    effects_of_terms,
    exports,
    full_model,
    model_torque,
    robots_in_files,
    without_estimated,
)
from identification.regression.regressor import EffectOnJoint, Regressor, torque_regressor
from identification.regression.triangular import one_blas_thread
from identification.stages import Announcement, Progress, Stage
from identification.words.note_words import sentence
from identification.words.numbers_and_names import number
from phantom_dyn import __version__
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effects_of
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import EstimationError, IdentifiabilityError, ParameterError, listed
from phantom_dyn.model.robot import Robot

MISSED = 0.3
"""Relative error on held-out data above which a joint's parameters count as not reliable."""

# A warning names an effect on two joints only if it reduces the error of an unreliable joint of the two to this share.
_REDUCED = 0.5
# It must not increase the error of any joint by more than this factor, which allows for chance.
_INCREASED = 1.5
# Largest number of unreliable joints (worst first), and of effects on two joints (best first), that are examined.
_MOST = 4


@dataclass(frozen=True)
class Shared:
    """An effect on two joints that would reduce the errors of an identification.

    Attributes:
        effect: Effect of the catalogue.
        joints: The two joints.
        errors: Relative error of each joint on held-out data, with the effect.
    """

    effect: Effect
    joints: tuple[str, str]
    errors: tuple[float, float]


def missed(joints: Sequence[JointError]) -> tuple[JointError, ...]:
    """Joints with an error on held-out data above `MISSED`, the worst first."""
    return tuple(sorted((joint for joint in joints if joint.relative > MISSED), key=lambda joint: -joint.relative))


def shared_effects(
    robot: Robot, split: Split, effects: Sequence[EffectOnJoint], joints: Sequence[JointError]
) -> tuple[Shared, ...]:
    """Effects on two joints that halve the held-out error of an unreliable joint; each joint is named once.

    Args:
        robot: The robot that was fitted, without the friction and rotors that were estimated.
        split: Data for the fit, and held-out data.
        effects: Effects that were fitted.
        joints: Errors of every joint.
    """
    worst = [joint.joint for joint in missed(joints)[:_MOST]]
    if not worst:
        return ()
    before = np.array([joint.relative for joint in joints])
    out: list[Shared] = []
    for one in sorted(_tried(robot, split, effects, worst), key=lambda one: one.score)[:_MOST]:
        if any(joint in other.joints for joint in one.joints for other in out):
            continue
        errors = _held_out(robot, split, one.fit)
        rows = [robot.joint_names.index(joint) for joint in one.joints]
        reduced = any(errors[j] <= _REDUCED * before[j] for j in rows if robot.joint_names[j] in worst)
        if reduced and not np.any(errors > _INCREASED * before):
            out.append(Shared(one.effect, one.joints, (float(errors[rows[0]]), float(errors[rows[1]]))))
    return tuple(out)


@dataclass(frozen=True)
class _Tried:
    """A fit with one additional effect on two joints; a smaller score is better."""

    effect: Effect
    joints: tuple[str, str]
    fit: Fit
    score: float


def _tried(robot: Robot, split: Split, effects: Sequence[EffectOnJoint], worst: Sequence[str]) -> list[_Tried]:
    """Fits of every effect on every pair with one of the worst joints; for several shapes, only the best fit."""
    operation = Operation.of(robot, split.train[0].motion, split.train[0].tau)
    on_pairs = [effect for effect in effects_of(robot) if effect.scope == "pair"]
    out = []
    for effect in on_pairs:
        for place in effect.places(robot):
            first, _, second = (place or "").partition("+")
            if {first, second}.isdisjoint(worst) or effect.untestable(robot, operation, place) is not None:
                continue
            shapes = effect.shapes(robot, operation, place)
            fits = [_fit(robot, split, (*effects, (effect, place, shape))) for shape in shapes]
            found = [_Tried(effect, (first, second), fit, _score(fit)) for fit in fits if fit is not None]
            if found:
                out.append(min(found, key=lambda one: one.score))
    return out


def _fit(robot: Robot, split: Split, effects: Sequence[EffectOnJoint]) -> Fit | None:
    """Weighted least squares; None if it fails."""
    try:
        return wls(torque_regressor(robot, split.train, effects))
    except (EstimationError, IdentifiabilityError):
        return None


def _score(fit: Fit) -> float:
    """Sum over the joints of the logarithm of the fit's relative error."""
    return float(np.nansum(np.log(np.maximum(fit.relative_error, 1e-9))))


def _held_out(robot: Robot, split: Split, fit: Fit) -> Float[Array, " nv"]:
    """Relative error of each joint on held-out data, shape ``(nv,)``; NaN without torque."""
    measured = np.concatenate([Regressor.in_band(log, log.tau) for log in split.test])
    residual = measured - np.concatenate([Regressor.in_band(log, fit.predict(robot, log.motion)) for log in split.test])
    return relative_rms(residual, measured)


def missed_sentences(joints: Sequence[JointError], shared: Sequence[Shared]) -> tuple[str, ...]:
    """Warnings on joints with a large error on held-out data; empty if there are none.

    Args:
        joints: Errors of every joint.
        shared: Effects on two joints that would reduce these errors.
    """
    poor = missed(joints)
    if not poor:
        return ()
    named = listed([f"{joint.joint} ({error_percent(joint.relative)})" for joint in poor])
    out = [
        f"The torque error on held-out data is above {100 * MISSED:.0f} % on {named}: do not rely on the parameters or "
        "the model files there before the cause is found; phantom-dyn diagnose looks for it."
    ]
    for one in shared:
        first, second = one.joints
        errors = " and ".join(error_percent(error) for error in one.errors)
        out.append(
            f"Friction moves with both {first} and {second}: {one.effect.words.name} ({one.effect.words.meaning}) "
            f"would lower their errors to {errors}, and no parameter here describes it; phantom-dyn diagnose estimates "
            "it."
        )
    return tuple(out)


_SHOWN = 6  # largest number of names that a warning lists
_FAR = 2.0  # warn if possible bodies need a larger change of a base parameter, in standard deviations


@one_blas_thread()  # with more threads, the last digits would depend on the machine
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
    """Base parameters, friction and drives of a robot, with errors on held-out data and model files for simulation.

    Args:
        robot: The given model; inertias that the data do not determine are taken from it.
        recordings: Recordings for the fit. Without ``hold_out``, the last one of several recordings is held out, or the
            end of a single one.
        hold_out: Held-out recordings.
        estimator: Name of an estimator in `identification.estimators.estimator_list`.
        terms: Unknowns of every joint in addition to inertias; by default viscous and Coulomb friction and offset.
        folder: Folder of the model files, to which paths of meshes are relative; by default the working folder.
        config: The robot's ``robot.yaml``; None for the one in the folder of the robot's file.
        progress: Called at the start of each stage.

    Raises:
        LogError: If a recording cannot be used, or is certainly wrong (unless it was read with ``anyway``).
        IdentifiabilityError: If the recordings excite too few parameters.
        EstimationError: If the estimator fails.
        ParameterError: If no estimator has this name, or the robot has a floating base.
    """
    started = time.perf_counter()
    entry = estimator_named(estimator)
    _require_bolted_down(robot)
    require_right((*recordings, *hold_out))
    progress(Announcement(Stage.FILTERING))
    _require_no_forces(entry, (*recordings, *hold_out))
    split = split_logs(robot, recordings, hold_out)
    terms = JointTerms() if terms is None else terms
    effects = effects_of_terms(robot, terms)
    fitted = without_estimated(robot, terms)
    progress(Announcement(Stage.IDENTIFIABILITY))
    excited = excited_base(fitted, split.train[0], effects)
    require_enough(robot, split, excited.rank)
    progress(Announcement(Stage.ESTIMATION, detail={"estimator": estimator}))
    regressor = torque_regressor(fitted, split.train, effects)
    fit = entry.fit(regressor)
    # The test needs references and controllers for the instruments, which recordings for other estimators may lack.
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
    warnings = (
        *fault_warnings(every),
        *missed_sentences(errors, shared),
        *robot.warnings,
        *(sentence(finding) for recording in every for finding in recording.remarks),
        *_lacking_excitation(fit, excited.rank, not_excited(fit.base, excited)),
        *caution(split),
        *(one.sentence for one in fit.cautions if one.about is not About.SEPARATION),
        *([full.words] if not full.possible or full.moved > _FAR else []),
    )
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
        warnings=tuple(dict.fromkeys(warnings)),
        evidence=evidence,
        seconds=time.perf_counter() - started,
        version=__version__,
    )


def _require_bolted_down(robot: Robot) -> None:
    """Raise an error for a robot with a floating base, whose contact forces are not known."""
    if robot.floating:
        raise ParameterError(
            f"{robot.name} is not bolted down (base: floating), and identify takes robots that are: diagnose it, or "
            "record it on a rig with base: fixed."
        )


def _require_no_forces(entry: Estimator, recordings: Sequence[Recording]) -> None:
    """Raise an error if forces were measured and the estimator simulates the robot, which it does without forces."""
    pushed = [recording.file for recording in recordings if recording.forces]
    if pushed and entry.simulates:
        raise ParameterError(
            f"{pushed[0]} has measured forces (columns f.), and the estimator {entry.name} simulates the robot without "
            "any: take wls or irls, or a recording without contact."
        )


def _lacking_excitation(fit: Fit, excitable: int, lacking: tuple[str, ...]) -> tuple[str, ...]:
    """A warning on parameters that this recording does not identify, although another motion would."""
    if not lacking:
        return ()
    named = ", ".join(lacking[:_SHOWN]) + (", ..." if len(lacking) > _SHOWN else "")
    return (
        f"The recording separates {fit.rank} of the {excitable} parameters that motion of this robot can separate; it "
        f"lacks {named}: record a motion that moves every joint, in several postures.",
    )


def _departure(full: FullModel, fitted: Robot, fit: Fit, logs: tuple[Log, ...]) -> Float[Array, " nv"]:
    """For each joint, root mean square of the difference between the torques of full model and fit, shape ``(nv,)``."""
    differences = [
        Regressor.in_band(log, model_torque(full, log.motion) - fit.predict(fitted, log.motion)) for log in logs
    ]
    return np.sqrt(np.mean(np.concatenate(differences) ** 2, axis=0))


def without_worse_files(
    files: tuple[Export, ...], robots: Mapping[str, Robot], given: Robot, logs: tuple[Log, ...], cutoff_hz: float
) -> tuple[Export, ...]:
    """The files; a file with a larger error than the given model on some joint has no text, but a sentence why.

    Args:
        files: Model files.
        robots: The robot that each file describes, by the file's name.
        given: The robot as its file states it.
        logs: Held-out logs.
        cutoff_hz: Edge of the band of the fit [Hz].
    """
    weights = tuple(np.repeat(log.valid_in_band[:, None].astype(float), given.nv, axis=1) for log in logs)
    parts = tuple((block.log, block.core, block.stop) for block in split_blocks(logs, cutoff_hz))
    replay = Replay(given, logs, (), cutoff_hz, parts, weights)
    before = replay.squares(lambda k: inverse_dynamics(given, logs[k].motion))
    out = []
    for file in files:
        robot = robots[file.file]
        remaining = replay.squares(lambda k, robot=robot: inverse_dynamics(robot, logs[k].motion))
        worse = has_larger_residual(remaining, before)
        if file.text and worse.any():
            after, of_given = rms(remaining), rms(before)
            j = int(np.argmax(np.where(worse, after / np.maximum(of_given, 1e-300), 0.0)))
            unit = given.torque_units[j]
            reason = (
                f"Not written: on {given.joint_names[j]} it would leave {number(after[j])} {unit} on held-out data, "
                f"where the given model leaves {number(of_given[j])} {unit}."
            )
            file = replace(file, text="", left_out=(reason,))
        out.append(file)
    return tuple(out)
