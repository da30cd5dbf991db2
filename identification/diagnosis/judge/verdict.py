"""Decides the verdict of a diagnosis, and describes the residual that the findings do not explain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.columns.session import Series
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.columns.tolerance_parameters import ToleranceParameter
from identification.diagnosis.fit.fitting import Fitted
from identification.diagnosis.fit.flexible import ridge_predictions, state_features
from identification.diagnosis.fit.gap import held_out_torque, residual_after, residual_sums
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.judged_band import JudgedBand
from identification.diagnosis.judge.regimes import regime_split
from identification.diagnosis.noise.noise_floor import rms
from identification.diagnosis.result import Adjusted, Bound, Finding, Hidden, JointGap, Unexplained
from identification.diagnosis.search.claims import rows_of_term
from identification.diagnosis.search.search import Search
from identification.engine import contract_levels
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.model.inertia import body_name
from phantom_dyn.model.robot import Robot


def verdict(
    joints: tuple[JointGap, ...],
    findings: tuple[Finding, ...],
    structure: Unexplained,
    *,
    moved: bool,
    may_hide: bool,
    plausible: bool = True,
) -> str:
    """The verdict of a diagnosis; it has to agree with the gap of each joint.

    Args:
        joints: Gap of each joint.
        findings: Named causes.
        structure: The residual that the findings do not explain.
        moved: True if some joint moves in the recording.
        may_hide: True if ordinary effects of friction, inertia or drives could be too small to be seen in the noise.
        plausible: False if the size of a finding is implausible, so that the finding may be the wrong cause.
    """
    if not moved or torques_may_be_noise(joints):
        return "not_testable"
    clean = not structure.structured and not structure.times
    if not findings:
        if not clean or any(_least_residual(joint) > joint.allowed for joint in joints):
            return "unknown"
        tested = [joint for joint in joints if joint.hold_out_samples]
        no_gap_hidden = all(joint.noise_is_known and not may_hide_gap(joint) for joint in tested)
        return "no_gap" if no_gap_hidden and not may_hide else "not_testable"
    little_structure = not structure.structured or structure.fraction_of_explainable < rules.LITTLE_STRUCTURE
    if little_structure and not structure.times and all(nearly_closed(joint) for joint in joints):
        return "explained" if plausible else "partly_explained"
    # In units of squared noise floors, noise alone is one: do the findings close more of the gap than remains?
    within = float(np.mean(np.array([joint.tolerated / joint.noise_floor for joint in joints]) ** 2))
    after = float(np.mean(np.array([joint.rms_after / joint.noise_floor for joint in joints]) ** 2))
    return "partly_explained" if after - 1.0 < within - after else "unknown"


def torques_may_be_noise(joints: tuple[JointGap, ...]) -> bool:
    """True if the measured torque of each tested joint may be noise, for example because columns are mixed up."""
    tested = [joint for joint in joints if joint.hold_out_samples]
    return bool(tested) and all(joint.rms_torque is not None and joint.allowed >= joint.rms_torque for joint in tested)


def may_hide_gap(joint: JointGap) -> bool:
    """True if the residual of a joint is so large that it may contain a gap although it may also be noise.

    This happens if the interval of the noise is wide, mostly because the friction of a joint that stands still, creeps
    or reverses is uncertain.
    """
    if joint.rms_torque is None:
        return False
    least = max(contract_levels.FLOORS_LEFT * joint.noise_floor, rules.OPEN_SHARE * joint.rms_torque)
    return _least_residual(joint) > least


def _least_residual(joint: JointGap) -> float:
    """Residual of a joint with the corrected model, or with the given model if only the latter may be noise.

    The corrected model is fitted to all joints, so that a gap on other joints may increase the residual of this one.
    """
    return joint.rms_before if joint.only_given_fits else joint.rms_after


def nearly_closed(joint: JointGap) -> bool:
    """True if the residual of a joint is at most 1.5 noise floors, or a tenth of its gap within the tolerances."""
    after, within = ((residual / joint.noise_floor) ** 2 for residual in (joint.rms_after, joint.tolerated))
    closed = after <= contract_levels.FLOORS_LEFT**2 or after - 1.0 <= contract_levels.GAP_LEFT * (within - 1.0)
    # A residual that may be noise and discrepancy is no gap, however uncertain the noise is.
    return closed or joint.rms_after <= joint.allowed


def ordinary_effects_may_hide(bounds: tuple[Bound, ...]) -> bool:
    """True if no effect of ordinary size, which makes a tenth of the torque, would be seen in this recording.

    Detection limits that are not known as a torque do not count.
    """
    known = [bound.of_torque for bound in bounds if bound.of_torque is not None]
    return bool(known) and min(known) > rules.ORDINARY_SHARE


def unexplained(
    plain: Search,
    chosen: frozenset[Term],
    judged: JudgedBand,
    residual: Series,
    whole: Series,
    predictable_if_sound: Float[Array, " nv"] | None = None,
    joints: Bool[Array, " nv"] | None = None,
) -> Unexplained:
    """Describes the residual: the part that a flexible regression on the state predicts, with its joint and regime.

    The predicted part is called structure, because a missing effect may cause it. Its size is a share of the
    explainable gap: the decrease of the loss by named effects and structure together.

    Args:
        plain: Plain fits in the judged band.
        chosen: The effects that are shown.
        judged: Problem and noise floor of the judged band.
        residual: Residual with the named effects in the model, in the judged band.
        whole: Residual with all effects in the model, structures without a name included.
        predictable_if_sound: Largest predictable part of each joint's residual with a sound model, root mean square,
            ``(nv,)``; None: any predictable part counts.
        joints: The joints whose residual counts; None: all.
    """
    floor, problem, session = judged.floor, plain.problem, judged.problem.session
    counted = np.ones(len(floor), dtype=bool) if joints is None else joints
    nameless = frozenset(term for term in chosen if not term.named and counted[list(rows_of_term(problem, term))].any())
    # Here "flexible" is the residual after the flexible regression.
    flexible = tuple(r - p for r, p in zip(whole, flexible_prediction(problem, whole), strict=True))
    predicted = tuple(r - f for r, f in zip(residual, flexible, strict=True))
    tolerated = residual_after(problem, held_out_torque(problem, frozenset(), plain.held_out_fit(frozenset())))
    sums_within, sums_after, sums_flexible = (
        replace(sums, squares=np.where(counted, sums.squares, 0.0))
        for sums in (residual_sums(problem, each) for each in (session.in_judged_band(tolerated), residual, flexible))
    )
    equal_weights = np.ones((1, len(sums_after.counts)))
    within, after, best = (
        float(sums.loss(floor, equal_weights)[0]) for sums in (sums_within, sums_after, sums_flexible)
    )
    gains = (sums_after.squares - sums_flexible.squares) / floor**2
    by_block = gains.sum(axis=1)
    error = float(np.sqrt(len(by_block)) * by_block.std()) + 1e-12
    significant = by_block.sum() > rules.STRUCTURE_ERRORS * error
    large = after - best > rules.STRUCTURE_SHARE * after
    most = after - best > rules.PLAIN_STRUCTURE * after
    # The error of a sound model is predictable, too, and so is the friction of joints while they stand still or creep.
    counts = np.maximum(sums_after.counts.sum(axis=0), 1e-12)
    predictable = np.sqrt(np.maximum(gains.sum(axis=0), 0.0) / counts) * floor
    beyond_sound = predictable_if_sound is None or bool(np.any(predictable > predictable_if_sound))
    # A structure without a name counts only if it lowers the loss in the judged band.
    structured = (bool(nameless) and best < after) or bool(beyond_sound and ((large and significant) or most))
    # The part that changes within the tolerances explain is no gap.
    explainable = within - min(best, after)
    fraction = float(np.clip((after - best) / explainable, 0.0, 1.0)) if explainable > 0 else 0.0
    joint, regime = None, None
    if structured:
        row = int(np.argmax(gains.sum(axis=0)))
        joint = session.robot.joint_names[row]
        of_structures = (term.effect.regime for term in ordered(nameless) if term.joint == joint)
        regime = next(of_structures, None) or regime_split(judged.problem, predicted, row).best
    return Unexplained(fraction, structured, joint, regime)


def flexible_prediction(problem: Problem, residual: Series) -> Series:
    """Prediction of the residual on held-out blocks by a flexible regression on the state.

    The prediction is zero on joints whose squared residual it does not decrease.
    """
    columns = problem.columns
    out = [np.zeros_like(own) for own in residual]
    for j in range(len(columns.rows)):
        features = [state_features(columns, log, k, j) for k, log in enumerate(problem.session.logs)]
        target, use = [own[:, j] for own in residual], [usable[:, j] for usable in columns.usable]
        predictions = ridge_predictions(features, target, use, problem.blocks, problem.grams.fold)
        predicted, error = min(predictions, key=lambda prediction: prediction[1])
        if error < rms([own[mask] for own, mask in zip(target, use, strict=True)]) ** 2:
            for k, own in enumerate(predicted):
                out[k][:, j] = own
    return tuple(out)


def adjusted(problem: Problem, found: Fitted) -> tuple[Adjusted, ...]:
    """Changes of the model within its tolerances that are larger than two standard deviations, or at their limit."""
    std = np.sqrt(np.diag(found.cov))[: len(problem.fitted_nuisances)]
    out = []
    for k, deviation in zip(problem.fitted_nuisances, std, strict=True):
        parameter, change = problem.columns.tolerance_parameters[k], found.theta[k]
        at_limit = bool(abs(change) > rules.AT_LIMIT * parameter.bound)
        if parameter.relative and (at_limit or abs(change) > 2 * deviation):
            hides = hidden_change(problem.session.robot, parameter) if at_limit else None
            out.append(Adjusted(parameter.name, float(change), parameter.sigma, at_limit, hides))
    return tuple(out)


def hidden_change(robot: Robot, parameter: ToleranceParameter) -> Hidden:
    """The larger error of the model that a change at its limit may conceal.

    A mass at its limit may conceal a payload of the same size; other quantities may differ by more than the limit.
    """
    masses = {body_name(robot, k): robot.model.inertias[k].mass for k in range(1, robot.model.njoints)}
    body, _, quantity = parameter.name.rpartition(" ")
    if quantity == "mass" and body in masses:
        return Hidden("payload", float(parameter.bound * masses[body]))
    return Hidden("change", float(parameter.bound))
