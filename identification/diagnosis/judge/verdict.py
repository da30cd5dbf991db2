"""The unexplained residual, and the verdict that follows from it."""

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
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.regimes import regime_split
from identification.diagnosis.noise.noise_floor import rms
from identification.diagnosis.result import Adjusted, Bound, Finding, Hidden, JointGap, Unexplained
from identification.diagnosis.search.claims import rows_touched_by
from identification.diagnosis.search.search import Search
from identification.engine import contract_levels
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.model.inertia import body_name
from phantom_dyn.model.robot import Robot


def verdict(
    joints: tuple[JointGap, ...],
    findings: tuple[Finding, ...],
    left: Unexplained,
    *,
    moved: bool,
    hides: bool,
    plausible: bool = True,
) -> str:
    """The contract's verdict; it has to agree with the figures of every joint.

    Args:
        joints: Gap of each joint.
        findings: Named causes.
        left: The residual after them.
        moved: True if some joint moves in the recording.
        hides: True if ordinary friction, inertia or drive effects could hide in the noise.
        plausible: False if the size of a finding is implausible, so that its cause may be another one.
    """
    if not moved or torques_may_be_noise(joints):
        return "not_testable"
    clean = not left.structured and not left.times
    if not findings:
        # A joint that the given model explains has no gap, whatever the changes for other joints leave on it.
        if not clean or any(_least_residual(joint) > joint.allowed for joint in joints):
            return "unknown"
        known = all(joint.noise_is_known and not may_hide_gap(joint) for joint in joints if joint.hold_out_samples)
        return "no_gap" if known and not hides else "not_testable"
    little = not left.structured or left.fraction_of_explainable < rules.LITTLE_STRUCTURE
    if little and not left.times and all(nearly_closed(joint) for joint in joints):
        return "explained" if plausible else "partly_explained"
    floor = np.array([joint.noise_floor for joint in joints])
    within, after = (
        float(np.mean((np.array(residuals) / floor) ** 2))
        for residuals in ([joint.tolerated for joint in joints], [joint.rms_after for joint in joints])
    )
    return "partly_explained" if after - 1.0 < within - after else "unknown"


def torques_may_be_noise(joints: tuple[JointGap, ...]) -> bool:
    """True if the measured torque of every tested joint may be noise, as when columns of the log are mixed up."""
    judged = [joint for joint in joints if joint.hold_out_samples]
    return bool(judged) and all(joint.rms_torque is not None and joint.allowed >= joint.rms_torque for joint in judged)


def may_hide_gap(joint: JointGap) -> bool:
    """True if the residual of a joint is within the interval of its noise, but large enough to contain a gap.

    The interval is wide mostly because of uncertain friction: while a joint stands, creeps or reverses, its friction
    torque may have any value.
    """
    if joint.rms_torque is None:
        return False
    least = max(contract_levels.FLOORS_LEFT * joint.noise_floor, rules.OPEN_SHARE * joint.rms_torque)
    return _least_residual(joint) > least


def _least_residual(joint: JointGap) -> float:
    """Residual of a joint with the corrected model, or with the given one if only that residual is noise."""
    return joint.rms_before if joint.only_given_fits else joint.rms_after


def nearly_closed(joint: JointGap) -> bool:
    """True if the residual of a joint is at most 1.5 noise floors, or a tenth of its gap within the tolerances."""
    after, within = ((residual / joint.noise_floor) ** 2 for residual in (joint.rms_after, joint.tolerated))
    closed = after <= contract_levels.FLOORS_LEFT**2 or after - 1.0 <= contract_levels.GAP_LEFT * (within - 1.0)
    # A residual that may be noise and discrepancy is no gap, however uncertain the noise is.
    return closed or joint.rms_after <= joint.allowed


def ordinary_effects_hide(bounds: tuple[Bound, ...]) -> bool:
    """True if effects of friction, inertia or drives that are ordinary in size could all hide in this recording.

    An ordinary effect makes a tenth of the torque in this motion. Limits that are not known as a torque do not count.
    """
    known = [bound.of_torque for bound in bounds if bound.of_torque is not None]
    return bool(known) and min(known) > rules.ORDINARY_SHARE


def unexplained(
    plain: Search,
    chosen: frozenset[Term],
    judge: Judge,
    residual: Series,
    whole: Series,
    of_sound: Float[Array, " nv"] | None = None,
    joints: Bool[Array, " nv"] | None = None,
) -> Unexplained:
    """Share of the explainable gap that is not explained, with joint and regime of the residual if it has structure.

    Args:
        plain: Plain fits in the judged band.
        chosen: The effects that are shown.
        judge: Problem and floor of the gap.
        residual: Residual after the named effects, in the judged band.
        whole: Residual after all effects, structures without a name included.
        of_sound: Largest residual of each joint with a sound model that a flexible model predicts, ``(nv,)``; None if
            it predicts none.
        joints: The joints whose residual counts; None: all.
    """
    floor, problem, session = judge.floor, plain.problem, judge.problem.session
    counted = np.ones(len(floor), dtype=bool) if joints is None else joints
    nameless = frozenset(
        term for term in chosen if not term.named and counted[list(rows_touched_by(problem, term))].any()
    )
    flexible = tuple(w - p for w, p in zip(whole, flexible_prediction(problem, whole), strict=True))
    predicted = tuple(r - s for r, s in zip(residual, flexible, strict=True))
    tolerated = residual_after(problem, held_out_torque(problem, frozenset(), plain.held_out_fit(frozenset())))
    within, after, smooth = (
        replace(sums, squares=np.where(counted, sums.squares, 0.0))
        for sums in (residual_sums(problem, each) for each in (session.in_judged_band(tolerated), residual, flexible))
    )
    once = np.ones((1, len(after.counts)))
    allowed, left, best = (float(s.loss(floor, once)[0]) for s in (within, after, smooth))
    gains = (after.squares - smooth.squares) / floor**2
    total = gains.sum(axis=1)
    error = float(np.sqrt(len(total)) * total.std()) + 1e-12
    lasting = left - best > rules.STRUCTURE_SHARE * left and total.sum() > rules.STRUCTURE_ERRORS * error
    # The error of a sound model is predictable, too, and so is the friction of its joints while they stand or creep.
    foreseen = np.sqrt(np.maximum(gains.sum(axis=0), 0.0) / np.maximum(after.counts.sum(axis=0), 1e-12)) * floor
    beyond = of_sound is None or bool(np.any(foreseen > of_sound))
    structured = bool(nameless) or bool(beyond and (lasting or left - best > rules.PLAIN_STRUCTURE * left))
    # The part that changes within the tolerances explain is no gap.
    explainable = allowed - min(best, left)
    fraction = float(np.clip((left - best) / explainable, 0.0, 1.0)) if explainable > 0 else 0.0
    joint, regime = None, None
    if structured:
        row = int(np.argmax(gains.sum(axis=0)))
        joint = session.robot.joint_names[row]
        of_structures = (term.effect.regime for term in ordered(nameless) if term.joint == joint)
        regime = next(of_structures, None) or regime_split(judge.problem, predicted, row).best
    return Unexplained(fraction, structured, joint, regime)


def flexible_prediction(problem: Problem, residual: Series) -> Series:
    """Held-out prediction of the residual by a flexible regression on the state; zero where it does not help."""
    columns = problem.columns
    out = [np.zeros_like(r) for r in residual]
    for j in range(len(columns.rows)):
        x = [state_features(columns, log, k, j) for k, log in enumerate(problem.session.logs)]
        y, use = [r[:, j] for r in residual], [u[:, j] for u in columns.usable]
        predictions = ridge_predictions(x, y, use, problem.blocks, problem.grams.fold)
        predicted, error = min(predictions, key=lambda prediction: prediction[1])
        if error < rms([v[m] for v, m in zip(y, use, strict=True)]) ** 2:
            for k, p in enumerate(predicted):
                out[k][:, j] = p
    return tuple(out)


def adjusted(problem: Problem, found: Fitted) -> tuple[Adjusted, ...]:
    """Changes of the model within its tolerances that exceed two standard deviations, or are at their limit."""
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
    """The larger error of the model that may hide behind a change at its limit."""
    masses = {body_name(robot, k): robot.model.inertias[k].mass for k in range(1, robot.model.njoints)}
    body, _, quantity = parameter.name.rpartition(" ")
    if quantity == "mass" and body in masses:
        return Hidden("payload", float(parameter.bound * masses[body]))
    return Hidden("change", float(parameter.bound))
