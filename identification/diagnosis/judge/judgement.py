"""Gap, findings, detection limits and verdict of an explanation, all measured in the judged band.

Changes of masses within tolerance may hide a payload. A load on a linkage is shared by many masses, and may exceed the
tolerance of any one mass, so that its largest possible mass comes from a fit together with the tolerance parameters.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from identification.diagnosis.columns.motion.standstill import uncertain_friction_variance
from identification.diagnosis.columns.operations import friction_with
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
from identification.diagnosis.judge.findings.bench import Bench, Residuals, Shown, State
from identification.diagnosis.judge.findings.findings import FindingWithout, findings_without, size_remarks
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
from identification.diagnosis.judge.judged_band import Judge, plain_search
from identification.diagnosis.judge.ledger import coarse_claims, ledger_of
from identification.diagnosis.judge.moved_by_noise import largest_predictable_noise, predictable_noise
from identification.diagnosis.judge.regimes import regime_split
from identification.diagnosis.judge.shares import closed_together, residual_sums_with
from identification.diagnosis.judge.verdict import adjusted, ordinary_effects_hide, unexplained, verdict
from identification.diagnosis.noise.discrepancy import drive_noise, slow_samples
from identification.diagnosis.result import Adjusted, Burst, Hidden, JointGap, Judgement, Unexplained
from identification.diagnosis.search.refinement import found_effects
from identification.diagnosis.search.search import Search
from identification.diagnosis.search.stepwise import stepwise_search
from identification.gates.in_band import torque_is_there
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.array_types import Array, Bool, Float

# Smallest share of a joint's samples in a regime for which its residual is stated.
_FEW = 0.01
# Standard deviations from the estimate of a hidden payload to its upper limit at 95 %.
_DEVIATIONS = 2.0


def judgement_of(explanation: Explanation, progress: Progress) -> tuple[Judgement, Shown]:
    """Gap, findings, detection limits and verdict of an explanation, and the fits behind them."""
    search, noise = explanation.search, explanation.in_band or explanation.noise
    session = search.problem.session
    shown, left = _shown_and_residual(explanation, plain_search(search, noise), noise)
    problem = shown.problem
    given = session.in_judged_band(problem.columns.residual)
    before, within = residual_sums(problem, given), residual_sums_with(shown.plain, frozenset())
    as_given = not shown.chosen and _fits_as_given(left, before, within)
    if as_given:
        left, within = replace(left, torque=problem.columns.model_torque, residual=given, whole=given), before
    rounding, judge, torque, residual, whole = left.rounding, left.judge, left.torque, left.residual, left.whole
    claims = [
        *findings_without(shown, judge, within),
        # A coarse reading adds spurious torque and does not change the model.
        *(FindingWithout(finding, torque) for finding in coarse_findings(session.robot, rounding, within, judge.floor)),
    ]
    claims.sort(key=lambda claim: -claim.finding.gap_closed)
    kept = [claim for claim in claims if not claim.minor]
    findings = tuple(claim.finding for claim in kept)
    minor = tuple(claim.finding for claim in claims if claim.minor)
    after = _without_rounding(residual_sums(problem, residual), rounding.total)
    bursts = _distinct_events(problem, left)
    left_over = unexplained(shown.plain, shown.chosen, judge, residual, whole, left.floor.predictable)
    foreseen = left_over.fraction_of_explainable > 0.0
    joints = joint_gaps(problem, left.floor, before, within, after, _by_regime(problem, left), foreseen=foreseen)
    left_over = _with_joint(_with_times(left_over, bursts), problem, residual, joints)
    progress(Announcement(Stage.BOUNDS))
    bounds, untested = detection_limits(
        merged(problem.columns.operations), search.of(shown.chosen), shown.plain, shown.chosen, left.floor.allowed
    )
    named, minor_effects = (frozenset((one.effect, one.joint) for one in some) for some in (findings, minor))
    moved = any(bool(use.any()) for use in problem.columns.usable)
    notes, hides = size_remarks(shown), ordinary_effects_hide(bounds)
    plausible = all_plausible(findings, notes)
    judgement = Judgement(
        verdict=verdict(joints, findings, left_over, moved=moved, hides=hides, plausible=plausible),
        joints=joints,
        findings=findings,
        adjusted=() if as_given else with_hidden_payload(adjusted(problem, shown.named_fit), search, shown.chosen),
        unexplained=left_over,
        bounds=bounds,
        not_testable=tuple(entry for entry in untested if (entry.effect, entry.joint) not in named),
        notes=notes,
        evidence=evidence_of(judge, given, torque, tuple(claim.without for claim in kept)),
        gap=closed_together(judge, within, after),
        minor=minor,
        numbers=() if as_given else fitted_numbers(shown),
        bursts=bursts,
        # Last of all, so that its fits cannot change the last digits of the other results.
        ledger=(*ledger_of(search, shown, judge, minor_effects), *coarse_claims(search, rounding)),
    )
    return judgement, shown


@dataclass(frozen=True)
class _ResidualAndFloor:
    """Residual of each log's torque after a set of effects, and the noise floor with which it is compared.

    Attributes:
        torque: Torque of the corrected model for each log.
        residual: Residual after the named effects, in the judged band.
        whole: Residual after all effects, fitted torques that match no effect of the catalogue included.
        friction_variance: Variance of the friction torque where joints stand, creep or reverse.
        rounding: Spurious torque of coarse readings.
        floor: Noise floor of each joint.
        judge: The same floor, with the problem in the judged band.
    """

    torque: Series
    residual: Series
    whole: Series
    friction_variance: Series
    rounding: CoarseRounding
    floor: Floor
    judge: Judge


def _shown_and_residual(explanation: Explanation, plain: Search, noise: Series) -> tuple[Shown, _ResidualAndFloor]:
    """The effects of an explanation that pass all gates of the judge, and their residual."""
    sensed = sensor_floors(plain.problem)

    @cache
    def without_predictable(chosen: frozenset[Term]) -> _ResidualAndFloor:
        return _residual_of(explanation, plain, chosen, noise, sensed)

    @cache
    def left_by_all(chosen: frozenset[Term]) -> _ResidualAndFloor:
        return _with_predictable_noise(without_predictable(chosen), plain, chosen, noise)

    def over_allowed(chosen: frozenset[Term], joints: Bool[Array, " nv"]) -> Float[Array, " nv"]:
        left = without_predictable(chosen)
        size = np.where(joints, residual_sums(plain.problem, left.residual).rms(), 0.0)
        certain = size / left.floor.raised_by(largest_predictable_noise(left.judge)).allowed
        if certain.max() > 1.0:
            # Above the largest noise that is possible: the predictable part, which takes long, is not needed.
            return certain
        return size / _with_predictable_noise(left, plain, chosen, noise, joints).floor.allowed

    def has_structure(chosen: frozenset[Term], joints: Bool[Array, " nv"]) -> bool:
        left, names = left_by_all(chosen), plain.problem.session.robot.joint_names
        over = unexplained(plain, chosen, left.judge, left.residual, left.whole, left.floor.predictable, joints)
        events = _distinct_events(plain.problem, left)
        return over.structured or any(joints[names.index(event.joint)] for event in events)

    residuals = Residuals(lambda chosen: left_by_all(chosen).judge, over_allowed, has_structure)
    bench = Bench(explanation.search, plain, noise, residuals)
    state = after_motion_gate(bench, State.of(explanation.chosen))
    left = left_by_all(state.shown)
    torque = torque_is_there(_torque_over_noise(left))
    if not torque.passed:
        # The measured torque is noise, so that no model can be tested with it.
        bench.record.add_failed(explanation.chosen, torque)
        shown = shown_effects(bench, State.of(frozenset()))
        return shown, replace(left_by_all(shown.chosen), floor=left.floor, judge=left.judge)
    bench.record.add_passed(state.shown, torque)
    if not state.shown and _above_noise(left) and not explanation.endless:
        # Disturbances above the judged band may hide effects inside it from the search.
        state = State.of(stepwise_search(plain, lambda _: None))
    shown = shown_effects(bench, state)
    return shown, left_by_all(shown.chosen)


def _fits_as_given(left: _ResidualAndFloor, given: ResidualSums, within: ResidualSums) -> bool:
    """True if the given model leaves noise, and less than the model adjusted within tolerance on held-out blocks."""
    once, floor = np.ones((1, len(given.counts))), left.floor
    less = given.loss(floor.value, once)[0] < within.loss(floor.value, once)[0]
    return bool(less and np.all(given.rms() <= floor.allowed))


def _torque_over_noise(left: _ResidualAndFloor) -> float:
    """The largest measured torque of a tested joint, over the upper end of its noise floor."""
    torque = residual_sums(left.judge.problem, measured_torque(left.judge.problem))
    judged = torque.counts.any(axis=0)
    return float(np.max((torque.rms() / left.floor.high)[judged])) if judged.any() else np.inf


def _above_noise(left: _ResidualAndFloor) -> bool:
    """True if the residual of any joint is above its noise floor."""
    return bool(np.any(residual_sums(left.judge.problem, left.whole).rms() > left.floor.high))


def _residual_of(
    explanation: Explanation, plain: Search, chosen: frozenset[Term], noise: Series, sensed: SensorFloors
) -> _ResidualAndFloor:
    """Residual after a set of effects, and the noise floor without the noise that moves the joint.

    A flexible model can predict that noise from the motion.
    """
    problem, session, named = plain.problem, plain.problem.session, frozenset(term for term in chosen if term.named)
    torque = held_out_torque(problem, named, plain.held_out_fit(named))
    residual = whole = session.in_judged_band(residual_after(problem, torque))
    if named != chosen:
        predicted = held_out_torque(problem, chosen, plain.held_out_fit(chosen))
        whole = session.in_judged_band(residual_after(problem, predicted))
    friction_variance = _friction_variance(plain, chosen)
    floor = floor_by_predictors(problem, noise, whole, friction_variance, explanation.encoders)
    floor = floor_by_sensors(floor, sensed, problem, noise, whole, friction_variance)
    rounding = coarse_rounding(problem, explanation.coarse, floor.value, noise)
    floor = floor.without(rounding.total)
    judge = Judge(problem, floor.value, floor.high, floor.discrepancy)
    return _ResidualAndFloor(torque, residual, whole, friction_variance, rounding, floor, judge)


def _with_predictable_noise(
    left: _ResidualAndFloor,
    plain: Search,
    chosen: frozenset[Term],
    noise: Series,
    joints: Bool[Array, " nv"] | None = None,
) -> _ResidualAndFloor:
    """The residual, with a noise floor that includes the noise that moves the joint, which models can predict.

    Args:
        left: The residual, with a floor that lacks this noise.
        plain: Plain fits in the judged band.
        chosen: The effects after which this residual is left.
        noise: Noise of each log's torque.
        joints: Joints whose floor includes it, ``(nv,)``; None: all.
    """
    size = np.where(True if joints is None else joints, residual_sums(plain.problem, left.whole).rms(), 0.0)
    floor = left.floor.raised_by(predictable_noise(left.judge, plain, chosen, noise, size))
    return replace(left, floor=floor, judge=replace(left.judge, highest=floor.high))


def _friction_variance(plain: Search, chosen: frozenset[Term]) -> Series:
    """Variance of the friction torque in the judged band, which is uncertain while joints stand, creep or reverse."""
    columns, session = plain.problem.columns, plain.problem.session
    found = found_effects(plain.held_out_fit(chosen), chosen)
    return tuple(
        uncertain_friction_variance(session.robot, log, friction_with(operation, found), std)
        for log, operation, std in zip(session.logs, columns.operations, columns.reversal_std, strict=True)
    )


def _without_rounding(found: ResidualSums, square: Float[Array, " nv"]) -> ResidualSums:
    """Squared residuals less the mean square of the spurious torque of coarse readings."""
    return replace(found, squares=np.maximum(found.squares - square * found.counts, 0.0))


def _with_joint(left: Unexplained, problem: Problem, residual: Series, joints: tuple[JointGap, ...]) -> Unexplained:
    """The residual, with the joint that is furthest above its noise floor, unless its structure names a joint."""
    above = [0.0 if joint.only_given_fits else joint.rms_after / joint.allowed for joint in joints]
    if left.joint is not None or max(above) <= 1.0:
        return left
    row = int(np.argmax(above))
    return replace(left, joint=joints[row].joint, regime=regime_split(problem, residual, row).best)


def _distinct_events(problem: Problem, left: _ResidualAndFloor) -> tuple[Burst, ...]:
    """Events: short times with a residual far above that of other times."""
    return distinct_bursts(
        bursts_of(problem, left.whole, left.friction_variance), problem, left.whole, left.floor.allowed
    )


def _with_times(left: Unexplained, bursts: tuple[Burst, ...]) -> Unexplained:
    """The residual, with the times of events, and the joint of the largest one, unless its structure names a joint."""
    if not bursts:
        return left
    joint = max(bursts, key=lambda burst: burst.ratio).joint if left.joint is None else left.joint
    return replace(left, joint=joint, times=tuple((burst.start, burst.stop) for burst in bursts))


def _by_regime(problem: Problem, left: _ResidualAndFloor) -> tuple[tuple[float, float], ...]:
    """Residual of each joint beyond noise where it creeps or reverses, and elsewhere, root mean square."""
    session = problem.session
    slow = tuple(slow_samples(session, k)[log.samples] for k, log in enumerate(session.logs))
    slow_part = tuple(np.where(mask, part, 0.0) for part, mask in zip(left.residual, slow, strict=True))
    moving_part = tuple(part - own for part, own in zip(left.residual, slow_part, strict=True))
    share = residual_sums(problem, tuple(mask.astype(float) for mask in slow)).rms() ** 2
    shares = np.stack([share, 1.0 - share])
    both = np.stack([residual_sums(problem, part).rms() ** 2 for part in (slow_part, moving_part)])
    squares = both / np.maximum(shares, 1e-12) - left.floor.high**2
    # Nothing is known of joints without held-out samples.
    known = (shares > _FEW) & (squares > 0.0)
    return tuple((creeping, moving) for creeping, moving in np.sqrt(np.where(known, squares, 0.0)).T.tolist())


def joint_gaps(
    problem: Problem,
    floor: Floor,
    before: ResidualSums,
    within: ResidualSums,
    after: ResidualSums,
    by_regime: tuple[tuple[float, float], ...] | None = None,
    *,
    foreseen: bool = False,
) -> tuple[JointGap, ...]:
    """Gap of each joint: of the given model, within its tolerances, and of the corrected model.

    Args:
        problem: Robot and recordings.
        floor: Noise floor of each joint.
        before: Residual of the given model.
        within: Residual of the best changes within its tolerances.
        after: Residual of the corrected model.
        by_regime: Residual of each joint beyond noise at reversals and elsewhere, `JointGap.left`; None: not known.
        foreseen: True if a flexible model predicts a part of the residual, so that it is not the noise of drives.
    """
    robot, torque = problem.session.robot, residual_sums(problem, measured_torque(problem)).rms()
    of_drive = 0.0 if foreseen else drive_noise(robot, torque)
    # Repetitions show the noise of the drive, too. Gates compare with less: the torque of an effect is not random.
    highest = np.where(np.array(floor.source) == SENSORS, np.maximum(floor.high, of_drive), floor.high)
    out = []
    for j, joint in enumerate(robot.joint_names):
        noise, tolerated, left = float(floor.value[j]), float(within.rms()[j]), float(after.rms()[j])
        gap = (tolerated / noise) ** 2 - 1.0
        closed = (tolerated**2 - left**2) / noise**2 / gap if tolerated > floor.allowed[j] else None
        out.append(
            JointGap(
                joint,
                robot.torque_units[j],
                float(before.rms()[j]),
                left,
                noise,
                # Samples where friction is uncertain have small weights, so that their sum may be below one.
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
    """The changes within tolerance, with the heaviest payload that could hide behind masses at their limits.

    Args:
        changes: Changes found so far, each with the mass that it alone may hide.
        search: Fits a payload together with the tolerance parameters.
        chosen: The findings; if one of them is a payload or sets the body that carries it free, none is hidden.
    """
    loads = [term for term in search.terms if term.effect.inertial == "point mass"]
    masses = {
        change: change.hides.size
        for change in changes
        if change.at_limit and change.hides is not None and change.hides.kind == "payload"
    }
    # Beside free inertial parameters of its body a payload has no columns of its own.
    if not loads or not masses or not search.can_join(chosen, loads[0]):
        return changes
    found = search.held_out_fit(chosen | {loads[0]})
    mass = loads[0].columns[0]
    at = int(np.searchsorted(found.active, mass))
    most = float(found.theta[mass]) + _DEVIATIONS * float(np.sqrt(found.cov[at, at]))
    if not max(masses.values()) < most < np.inf:
        return changes
    return tuple(replace(one, hides=Hidden("payload", most)) if one in masses else one for one in changes)
