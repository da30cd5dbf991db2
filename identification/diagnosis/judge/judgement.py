"""Judges the effects that the search has chosen: gap, findings, detection limits and verdict, in the judged band."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from identification.diagnosis.columns.motion.standstill import uncertain_friction_variance
from identification.diagnosis.columns.operations import friction_torque_with
from identification.diagnosis.columns.session import Series
from identification.diagnosis.columns.terms import Term, merged
from identification.diagnosis.explanation import Explanation
from identification.diagnosis.fit.gap import (
    ResidualSums,
    held_out_torque,
    measured_torque,
    residual_after,
    residual_sums,
)
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.judge.bounds import detection_limits
from identification.diagnosis.judge.bursts import bursts_of, distinct_bursts
from identification.diagnosis.judge.coarse_encoders import CoarseRounding, coarse_findings, coarse_rounding
from identification.diagnosis.judge.evidence_samples import evidence_of
from identification.diagnosis.judge.file_numbers import fitted_numbers
from identification.diagnosis.judge.findings.findings import FindingWithout, findings_of, size_remarks
from identification.diagnosis.judge.findings.gate_state import GateContext, LoopState, Residuals, ShownEffects
from identification.diagnosis.judge.findings.remaining_gap import lowered_by_remaining_gap
from identification.diagnosis.judge.findings.shown import after_motion_gate, shown_effects
from identification.diagnosis.judge.findings.sound_sizes import all_plausible
from identification.diagnosis.judge.floors import (
    SENSORS,
    Floor,
    SensorFloors,
    floor_by_predictors,
    floor_by_sensors,
    sensor_floors,
)
from identification.diagnosis.judge.judged_band import JudgedBand, plain_search
from identification.diagnosis.judge.ledger import coarse_claims, ledger_of
from identification.diagnosis.judge.regimes import regime_split
from identification.diagnosis.judge.shares import closed_together, residual_sums_with
from identification.diagnosis.judge.strong_motion import largest_predictable_noise, predictable_noise
from identification.diagnosis.judge.verdict import adjusted, ordinary_effects_may_hide, unexplained, verdict
from identification.diagnosis.noise.discrepancy import drive_noise, slow_samples
from identification.diagnosis.result import Adjusted, Burst, Hidden, JointGap, Judgement, Unexplained
from identification.diagnosis.search.refinement import found_effects
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.stepwise import stepwise_search
from identification.gates.in_band import torque_is_there
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.array_types import Array, Bool, Float

# The residual of a joint in a regime is stated if the regime has more than this share of the joint's samples.
_LEAST_REGIME_SHARE = 0.01
# Standard deviations from the estimate of a hidden payload to its upper limit at 95 %.
_UPPER_LIMIT_DEVIATIONS = 2.0


def judgement_of(explanation: Explanation, progress: Progress) -> tuple[Judgement, ShownEffects]:
    """Gap, findings, detection limits and verdict of an explanation, and the effects that are shown, with their fits.

    Args:
        explanation: Effects that the search has chosen.
        progress: Is called at the beginning of each stage.
    """
    search, noise = explanation.search, explanation.in_band or explanation.noise
    session = search.problem.session
    shown, result = _shown_and_residual(explanation, plain_search(search, noise), noise)
    problem = shown.problem
    given = session.in_judged_band(problem.columns.residual)
    before, within = residual_sums(problem, given), residual_sums_with(shown.plain, frozenset())
    as_given = not shown.chosen and _fits_as_given(result, before, within)
    if as_given:
        result = replace(result, torque=problem.columns.model_torque, residual=given, whole=given)
        within = before
    rounding, judged, torque, residual = result.rounding, result.judged, result.torque, result.residual
    coarse = coarse_findings(session.robot, rounding, within, judged.floor)
    # Without the finding of a coarse encoder the model is the same: rounding changes only the readings.
    claims = [*findings_of(shown, judged, within), *(FindingWithout(finding, torque) for finding in coarse)]
    claims.sort(key=lambda claim: -claim.finding.gap_closed)
    major = [claim for claim in claims if not claim.minor]
    after = _without_rounding(residual_sums(problem, residual), rounding.total)
    bursts = _distinct_events(problem, result)
    structure = unexplained(shown.plain, shown.chosen, judged, residual, result.whole, result.floor.predictable)
    predictable = structure.fraction_of_explainable > 0.0
    by_regime = _by_regime(problem, result)
    joints = joint_gaps(problem, result.floor, before, within, after, by_regime, predictable=predictable)
    structure = _with_joint(_with_times(structure, bursts), problem, residual, joints)
    findings = tuple(lowered_by_remaining_gap(claim.finding, joints) for claim in major)
    minor = tuple(lowered_by_remaining_gap(claim.finding, joints) for claim in claims if claim.minor)
    progress(Announcement(Stage.BOUNDS))
    bounds, untested = detection_limits(
        merged(problem.columns.operations), search.of(shown.chosen), shown.plain, shown.chosen, result.floor.allowed
    )
    named, minor_effects = (frozenset((one.effect, one.joint) for one in some) for some in (findings, minor))
    moved = any(bool(use.any()) for use in problem.columns.usable)
    notes, may_hide = size_remarks(shown), ordinary_effects_may_hide(bounds)
    plausible = all_plausible(findings, notes)
    judgement = Judgement(
        verdict=verdict(joints, findings, structure, moved=moved, may_hide=may_hide, plausible=plausible),
        joints=joints,
        findings=findings,
        adjusted=() if as_given else with_hidden_payload(adjusted(problem, shown.named_fit), search, shown.chosen),
        unexplained=structure,
        bounds=bounds,
        not_testable=tuple(entry for entry in untested if (entry.effect, entry.joint) not in named),
        notes=notes,
        evidence=evidence_of(judged, given, torque, tuple(claim.without for claim in major)),
        gap=closed_together(judged, within, after),
        minor=minor,
        numbers=() if as_given else fitted_numbers(shown),
        bursts=bursts,
        # The ledger comes last, so that its fits cannot change the last digits of the other results.
        ledger=(*ledger_of(search, shown, judged, minor_effects), *coarse_claims(search, rounding)),
    )
    return judgement, shown


@dataclass(frozen=True)
class _ResidualAndFloor:
    """Residual of each log with a set of effects in the model, and the noise floor with which it is compared.

    Attributes:
        torque: Held-out torque of the model with the named effects for each log.
        residual: Residual with the named effects, in the judged band.
        whole: Residual with all effects, including structures without a name (they match no effect of the catalogue).
        friction_variance: Variance of the friction torque of joints that stand still, creep or reverse.
        rounding: Spurious torque of coarse encoders.
        floor: Noise floor of each joint.
        judged: The same floor, with the problem in the judged band.
    """

    torque: Series
    residual: Series
    whole: Series
    friction_variance: Series
    rounding: CoarseRounding
    floor: Floor
    judged: JudgedBand


def _shown_and_residual(
    explanation: Explanation, plain: Search, noise: Series
) -> tuple[ShownEffects, _ResidualAndFloor]:
    """The effects of an explanation that pass all gates of the judge, and the residual with these effects."""
    by_sensors = sensor_floors(plain.problem)

    @cache
    def without_predictable_noise(chosen: frozenset[Term]) -> _ResidualAndFloor:
        return _residual_of(explanation, plain, chosen, noise, by_sensors)

    @cache
    def result_of(chosen: frozenset[Term]) -> _ResidualAndFloor:
        return _with_predictable_noise(without_predictable_noise(chosen), plain, chosen, noise)

    def over_allowed(chosen: frozenset[Term], joints: Bool[Array, " nv"]) -> Float[Array, " nv"]:
        result = without_predictable_noise(chosen)
        size = np.where(joints, residual_sums(plain.problem, result.residual).rms(), 0.0)
        over_largest_noise = size / result.floor.raised_by(largest_predictable_noise(result.judged)).allowed
        if over_largest_noise.max() > 1.0:
            # There is a gap however large the predictable noise is, so its size, which takes long, is not computed.
            return over_largest_noise
        return size / _with_predictable_noise(result, plain, chosen, noise, joints).floor.allowed

    def has_structure(chosen: frozenset[Term], joints: Bool[Array, " nv"]) -> bool:
        result, names = result_of(chosen), plain.problem.session.robot.joint_names
        predictable = result.floor.predictable
        structure = unexplained(plain, chosen, result.judged, result.residual, result.whole, predictable, joints)
        events = _distinct_events(plain.problem, result)
        return structure.structured or any(joints[names.index(event.joint)] for event in events)

    residuals = Residuals(lambda chosen: result_of(chosen).judged, over_allowed, has_structure)
    context = GateContext(explanation.search, plain, noise, residuals)
    state = after_motion_gate(context, LoopState.of(explanation.chosen))
    result = result_of(state.shown)
    torque = torque_is_there(_torque_over_noise(result))
    if not torque.passed:
        # The measured torque is noise, so that no model can be tested with it.
        context.record.add_failed(explanation.chosen, torque)
        shown = shown_effects(context, LoopState.of(frozenset()))
        return shown, replace(result_of(shown.chosen), floor=result.floor, judged=result.judged)
    context.record.add_passed(state.shown, torque)
    if not state.shown and _above_noise(result) and not explanation.endless:
        # Disturbances above the judged band may have hidden effects inside the band from the search.
        state = LoopState.of(stepwise_search(plain, lambda _: None))
    shown = shown_effects(context, state)
    return shown, result_of(shown.chosen)


def _fits_as_given(result: _ResidualAndFloor, given: ResidualSums, within: ResidualSums) -> bool:
    """True if the residual of the given model may be noise, and is smaller than that of the adjusted model (within)."""
    equal_weights, floor = np.ones((1, len(given.counts))), result.floor
    smaller = given.loss(floor.value, equal_weights)[0] < within.loss(floor.value, equal_weights)[0]
    return bool(smaller and np.all(given.rms() <= floor.allowed))


def _torque_over_noise(result: _ResidualAndFloor) -> float:
    """Largest measured torque of a tested joint, divided by the upper end of the joint's noise floor."""
    torque = residual_sums(result.judged.problem, measured_torque(result.judged.problem))
    tested = torque.counts.any(axis=0)
    return float(np.max((torque.rms() / result.floor.high)[tested])) if tested.any() else np.inf


def _above_noise(result: _ResidualAndFloor) -> bool:
    """True if the residual of any joint is above the upper end of its noise floor."""
    return bool(np.any(residual_sums(result.judged.problem, result.whole).rms() > result.floor.high))


def _residual_of(
    explanation: Explanation, plain: Search, chosen: frozenset[Term], noise: Series, by_sensors: SensorFloors
) -> _ResidualAndFloor:
    """Residual with a set of effects in the model, and the noise floor without the predictable part of the noise."""
    problem, session, named = plain.problem, plain.problem.session, frozenset(term for term in chosen if term.named)
    torque = held_out_torque(problem, named, plain.held_out_fit(named))
    residual = whole = session.in_judged_band(residual_after(problem, torque))
    if named != chosen:
        predicted = held_out_torque(problem, chosen, plain.held_out_fit(chosen))
        whole = session.in_judged_band(residual_after(problem, predicted))
    friction_variance = _friction_variance(plain, chosen)
    floor = floor_by_predictors(problem, noise, whole, friction_variance, explanation.encoders)
    floor = floor_by_sensors(floor, by_sensors, problem, noise, whole, friction_variance)
    rounding = coarse_rounding(problem, explanation.coarse, floor.value, noise)
    floor = floor.without(rounding.total)
    judged = JudgedBand(problem, floor.value, floor.high, floor.discrepancy)
    return _ResidualAndFloor(torque, residual, whole, friction_variance, rounding, floor, judged)


def _with_predictable_noise(
    result: _ResidualAndFloor,
    plain: Search,
    chosen: frozenset[Term],
    noise: Series,
    joints: Bool[Array, " nv"] | None = None,
) -> _ResidualAndFloor:
    """The residual, with the predictable part of the noise (noise that moves the joint) added to the noise floor.

    Args:
        result: The residual, with the noise floor without this part.
        plain: Plain fits in the judged band.
        chosen: The effects in the model.
        noise: Noise of each log's torque.
        joints: Joints to whose floor the part is added, ``(nv,)``; None: all.
    """
    size = np.where(True if joints is None else joints, residual_sums(plain.problem, result.whole).rms(), 0.0)
    floor = result.floor.raised_by(predictable_noise(result.judged, plain, chosen, noise, size))
    return replace(result, floor=floor, judged=replace(result.judged, highest=floor.high))


def _friction_variance(plain: Search, chosen: frozenset[Term]) -> Series:
    """Variance of the friction torque, in the judged band, of joints that stand still, creep or reverse."""
    columns, session = plain.problem.columns, plain.problem.session
    found = found_effects(plain.held_out_fit(chosen), chosen)
    return tuple(
        uncertain_friction_variance(session.robot, log, friction_torque_with(operation, found), std)
        for log, operation, std in zip(session.logs, columns.operations, columns.reversal_std, strict=True)
    )


def _without_rounding(found: ResidualSums, square: Float[Array, " nv"]) -> ResidualSums:
    """Squared residuals minus the mean square of the spurious torque of coarse encoders, but not below zero."""
    return replace(found, squares=np.maximum(found.squares - square * found.counts, 0.0))


def _with_joint(
    structure: Unexplained, problem: Problem, residual: Series, joints: tuple[JointGap, ...]
) -> Unexplained:
    """The description of the residual, with the joint that exceeds its noise most if no joint was named before."""
    above = [0.0 if joint.only_given_fits else joint.rms_after / joint.allowed for joint in joints]
    if structure.joint is not None or max(above) <= 1.0:
        return structure
    row = int(np.argmax(above))
    return replace(structure, joint=joints[row].joint, regime=regime_split(problem, residual, row).best)


def _distinct_events(problem: Problem, result: _ResidualAndFloor) -> tuple[Burst, ...]:
    """Events: short times with a residual far above that of other times."""
    bursts = bursts_of(problem, result.whole, result.friction_variance)
    return distinct_bursts(bursts, problem, result.whole, result.floor.allowed)


def _with_times(structure: Unexplained, bursts: tuple[Burst, ...]) -> Unexplained:
    """The description of the residual, with the times of events, and the joint of the largest if none was named."""
    if not bursts:
        return structure
    joint = max(bursts, key=lambda burst: burst.ratio).joint if structure.joint is None else structure.joint
    return replace(structure, joint=joint, times=tuple((burst.start, burst.stop) for burst in bursts))


def _by_regime(problem: Problem, result: _ResidualAndFloor) -> tuple[tuple[float, float], ...]:
    """Root mean square of each joint's residual beyond noise: first where it creeps or reverses, then elsewhere."""
    session = problem.session
    slow = tuple(slow_samples(session, k)[log.samples] for k, log in enumerate(session.logs))
    slow_part = tuple(np.where(mask, part, 0.0) for part, mask in zip(result.residual, slow, strict=True))
    moving_part = tuple(part - own for part, own in zip(result.residual, slow_part, strict=True))
    share = residual_sums(problem, tuple(mask.astype(float) for mask in slow)).rms() ** 2
    shares = np.stack([share, 1.0 - share])
    both = np.stack([residual_sums(problem, part).rms() ** 2 for part in (slow_part, moving_part)])
    squares = both / np.maximum(shares, 1e-12) - result.floor.high**2
    beyond_noise = (shares > _LEAST_REGIME_SHARE) & (squares > 0.0)
    return tuple((creeping, moving) for creeping, moving in np.sqrt(np.where(beyond_noise, squares, 0.0)).T.tolist())


def joint_gaps(
    problem: Problem,
    floor: Floor,
    before: ResidualSums,
    within: ResidualSums,
    after: ResidualSums,
    by_regime: tuple[tuple[float, float], ...] | None = None,
    *,
    predictable: bool = False,
) -> tuple[JointGap, ...]:
    """Gap of each joint: residuals of the given, the adjusted and the corrected model, with the noise floor.

    Args:
        problem: Robot and recordings.
        floor: Noise floor of each joint.
        before: Residual of the given model.
        within: Residual of the model adjusted within its tolerances.
        after: Residual of the corrected model.
        by_regime: `JointGap.left` of each joint; None: not known.
        predictable: True if a flexible model predicts a part of the residual. Then the residual is not noise of drives,
            and the interval of the floor does not include such noise.
    """
    robot, torque = problem.session.robot, residual_sums(problem, measured_torque(problem)).rms()
    of_drive = 0.0 if predictable else drive_noise(robot, torque)
    # The interval of the floor includes noise of drives that their sensors do not show. Floors from repetitions include
    # it already. Gates use the floor without it, because they test torques that are not random.
    highest = np.where(np.array(floor.source) == SENSORS, np.maximum(floor.high, of_drive), floor.high)
    out = []
    for j, joint in enumerate(robot.joint_names):
        noise, tolerated, corrected = float(floor.value[j]), float(within.rms()[j]), float(after.rms()[j])
        gap = (tolerated / noise) ** 2 - 1.0
        closed = (tolerated**2 - corrected**2) / noise**2 / gap if tolerated > floor.allowed[j] else None
        out.append(
            JointGap(
                joint,
                robot.torque_units[j],
                float(before.rms()[j]),
                corrected,
                noise,
                # Samples with uncertain friction have small weights: the sum of few weights may be below one.
                int(np.ceil(after.counts[:, j].sum())),
                rms_torque=float(torque[j]) if robot.actuators[j].drive_known else None,
                rms_within_tolerance=tolerated,
                noise_floor_interval=(float(floor.low[j]), float(highest[j])),
                noise_floor_source=floor.source[j],
                discrepancy=None if floor.discrepancy is None else float(floor.discrepancy[j]),
                closed=closed,
                left=None if by_regime is None else by_regime[j],
            )
        )
    return tuple(out)


def with_hidden_payload(changes: tuple[Adjusted, ...], search: Search, chosen: frozenset[Term]) -> tuple[Adjusted, ...]:
    """The changes within tolerance, with the heaviest payload that masses at their limits may conceal together.

    One mass at its limit may conceal a payload of at most its tolerance. On a linkage several masses share the weight
    of a load, so that they may conceal a heavier one. Its largest mass comes from a fit of a payload and the tolerance
    parameters together.

    Args:
        changes: Changes within tolerance, each with the payload that it may conceal alone.
        search: Fits a payload together with the tolerance parameters.
        chosen: The findings. Nothing is concealed if they contain a payload or free parameters of the body that
            carries it.
    """
    loads = [term for term in search.terms if term.effect.inertial == "point mass"]
    masses = {
        change: change.hides.size
        for change in changes
        if change.at_limit and change.hides is not None and change.hides.kind == "payload"
    }
    if not loads or not masses or not search.can_join(chosen, loads[0]):
        return changes
    found = search.held_out_fit(chosen | {loads[0]})
    # The first column of a payload is its mass.
    column = loads[0].columns[0]
    at = int(np.searchsorted(found.active, column))
    most = float(found.theta[column]) + _UPPER_LIMIT_DEVIATIONS * float(np.sqrt(found.cov[at, at]))
    if not max(masses.values()) < most < np.inf:
        return changes
    return tuple(replace(one, hides=Hidden("payload", most)) if one in masses else one for one in changes)
