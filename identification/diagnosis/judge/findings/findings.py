"""Chosen effects as findings: parameters, share of the gap closed, rivals, and notes on their sizes.

Sum of a drive: back-EMF, viscous friction and a late reference all give a torque proportional to the speed while the
joint follows its reference. A recording of a drive that is fed by a voltage shows only their sum. They are separated
only if motor constants, or a second gain of the loop, determine the others.

One-sided intervals: the estimate of a body may lie on the limit of possible bodies. Beyond it are bodies with a
negative mass or moment of inertia, or with a centre out of reach, so that the interval reaches to one side only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.data.changes import written_center
from identification.data.drives.joint_torque import per_speed
from identification.diagnosis.columns.motion.soft_friction import soft_joints
from identification.diagnosis.columns.session import Series
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import ResidualSums, held_out_torque
from identification.diagnosis.fit.possible_bodies import Body, bodies_of_term, places_among, possible_minimum
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.judge.findings.imitation import (
    OF_A_MODEL,
    UNCERTAIN,
    beside_imitation,
    imitation_of,
    is_inertial_or_scale,
    joints_on_lines,
    joints_with_computed_torque,
    with_limit,
)
from identification.diagnosis.judge.findings.missing_parts import missing_part_notes
from identification.diagnosis.judge.findings.parameters import base_parameters, finding_loadings, finding_parameters
from identification.diagnosis.judge.findings.possible_load import possible_load_notes
from identification.diagnosis.judge.findings.shown_numbers import (
    widened_by_rivals,
    widened_by_tolerances,
    with_unknown_marked,
)
from identification.diagnosis.judge.findings.sound_sizes import size_notes
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.shares import drawn_blocks, gap_of, residual_sums_with, shares_of
from identification.diagnosis.result import Finding
from identification.diagnosis.search.claims import rows_touched_by
from identification.engine.numerics.bounded import solve
from identification.gates.least_size import large_enough
from identification.notes import Code, Note, Said
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.effects.effect import Effect
from phantom_dyn.model.inertia import payload_body
from phantom_dyn.model.robot import Robot
from phantom_dyn.random_streams import random_stream

_DRAWS = 200  # random draws of the parameters; the ends of a 95 % interval are the fifth lowest and the fifth highest
# An interval is one-sided if the limit to possible bodies makes it narrower than this share of its unrestricted width.
_NARROWER = 0.8
_SAME_PLACE = 1e-4  # distance of two places of a payload [m] below which one number stands for both
_FAR_FROM_ONE = 0.25  # distance of a torque constant from one above which the motor itself is rarely the cause


def size_remarks(shown: Shown) -> tuple[Said, ...]:
    """Notes on the sizes of findings: sums of a drive, volts, one-sided intervals, missing parts, implausible sizes."""
    robot = shown.problem.session.robot
    out = list[Said]((*drive_sum_notes(shown), *volts_notes(shown), *one_sided_notes(shown), *center_notes(shown)))
    for term in ordered(shown.named):
        effect, own = term.effect, shown.full_fit.coefficients(term)
        assert isinstance(effect, Effect)
        if effect.inertial == "free":
            out += missing_part_notes(shown.problem, term, own)
            out += possible_load_notes(robot, term, own, shown.full_fit.presence_covariance(term))
        elif said := effect.remark(robot, term.joint, effect.from_coefficients(robot, term.joint, own, term.shape)):
            out.append(said)
    return (*out, *size_notes(shown))


def _simulator_of_law(robot: Robot, term: Term, coefficients: Float[Array, " k"]) -> str | None:
    """Simulator whose law of dry friction a finding follows; None if it follows the law of the catalogue."""
    assert isinstance(term.effect, Effect)
    if term.joint not in soft_joints(robot):
        return None
    theta = term.effect.from_coefficients(robot, term.joint, coefficients, term.shape)
    numbers = term.effect.model_numbers(robot, term.joint, theta)
    return "mujoco" if numbers.whole and numbers.coulomb else None


@dataclass(frozen=True)
class FindingWithout:
    """A finding, the torque of the corrected model without it, and whether it is too small to matter."""

    finding: Finding
    without: Series
    minor: bool = False


def findings_without(shown: Shown, judge: Judge, within: ResidualSums) -> tuple[FindingWithout, ...]:
    """Each named effect as a finding, with the torque of the model that has all other findings but not this one.

    Args:
        shown: The effects that passed all gates.
        judge: Problem and noise floor.
        within: Residual of the given model with the best changes within its tolerances.
    """
    plain, problem, chosen, floor = shown.plain, shown.problem, shown.chosen, judge.floor
    robot, after = problem.session.robot, residual_sums_with(plain, chosen)
    fitted = widened_by_rivals(widened_by_tolerances(shown.full_fit, plain, chosen), shown)
    once, drawn = np.ones((1, len(within.counts))), drawn_blocks(within)
    shares = shares_of(judge, plain, shown.named)
    lines, sines = joints_on_lines(problem.session), problem.session.in_one_sine
    compensated = joints_with_computed_torque(problem.session)

    def gap_share(lost: ResidualSums, weights: Float[Array, "R B"]) -> Float[Array, " R"]:
        return (lost.loss(floor, weights) - after.loss(floor, weights)) / gap_of(judge, within, after, weights)

    out = []
    for term in ordered(shown.named):
        lost = residual_sums_with(plain, chosen - {term})
        comparison = shown.comparisons[term]
        rows = rows_touched_by(problem, term)
        if not lines.isdisjoint(rows) or (is_inertial_or_scale(term) and not sines.isdisjoint(rows)):
            comparison = with_limit(beside_imitation(comparison, imitation_of(plain, chosen, term)), term, UNCERTAIN)
        if not compensated.isdisjoint(rows):
            comparison = with_limit(comparison, term, OF_A_MODEL)
        low, high = np.percentile(gap_share(lost, drawn), [2.5, 97.5])
        finding = Finding(
            effect=term.effect.name,
            joint=term.joint,
            regime=term.effect.regime,
            parameters=with_unknown_marked(finding_parameters(robot, term, fitted), problem.session, term.joint),
            gap_closed=float(gap_share(lost, once)[0]),
            gap_closed_interval=(float(low), float(high)),
            probability=comparison.probability,
            rivals=comparison.rivals,
            verdict="one_of" if comparison.rivals else "supported",
            loadings=finding_loadings(robot, term, fitted),
            share=shares[term],
            law=_simulator_of_law(robot, term, shown.full_fit.coefficients(term)),
        )
        more = np.sqrt(np.maximum(lost.rms() ** 2 - after.rms() ** 2, 0.0))
        large = large_enough(finding.gap_closed, float(np.max(more / floor)))
        plain.record.add_passed([term], large)
        others = shown.named - {term}
        torque = held_out_torque(problem, others, plain.held_out_fit(others))
        out.append(FindingWithout(finding, torque, minor=not large.passed))
    return tuple(out)


def drive_sum_notes(shown: Shown) -> tuple[Note, ...]:
    """A note on each voltage-driven joint with a finding of viscous friction or of a late reference.

    Args:
        shown: The findings, with the fit of all their parameters.
    """
    session = shown.problem.session
    robot, recordings = session.robot, session.recordings
    out = []
    for j, joint in enumerate(robot.joint_names):
        if not recordings or any(one.torque_from.get(joint) != "u" for one in recordings):
            continue
        gains = [0.0 if one.reference_gain is None else float(one.reference_gain[j]) for one in recordings]
        # Several gains of the controller would determine each part of the sum.
        one_gain = np.ptp(gains) <= 1e-3 * max(gains)
        slopes = {term: _per_speed_of(robot, term, j, gains[0]) for term in ordered(shown.named) if one_gain}
        found, loadings = 0.0, []
        for term, slope in ((term, slope) for term, slope in slopes.items() if slope is not None):
            (value,) = finding_parameters(robot, term, shown.full_fit).values()
            assert isinstance(value.value, float)
            found += slope * value.value
            loadings.append(slope * np.array(finding_loadings(robot, term, shown.full_fit)[0]))
        if loadings:
            back_emf, modelled = per_speed(robot.actuators[j]), float(robot.viscous_friction[j])
            std = float(np.linalg.norm(np.sum(loadings, axis=0)))
            numbers = {"sum": back_emf + modelled + found, "std": std, "back_emf": back_emf}
            unit = "N s/m" if robot.prismatic[j] else "N m s/rad"
            out.append(Note(Code.DRIVE_SUM, joint, {**numbers, "unit": unit, "late": gains[0] > 0}))
    return tuple(out)


def volts_notes(shown: Shown) -> tuple[Note, ...]:
    """A note on joints whose torques may be volts: their torque is scaled, and they have viscous friction.

    The voltage of a motor is its torque times resistance over torque constant, plus its speed times torque constant.
    The torque constant may also be a rival of a finding, as on a single joint a load may look like one.

    Args:
        shown: The findings, with the fit of all their parameters.
    """
    session = shown.problem.session
    named = [term for term in ordered(shown.named) if isinstance(term.effect, Effect) and term.joint]

    def joints_of(effect: str, number: str, is_large: Callable[[float], bool]) -> set[str]:
        own = [term for term in named if term.effect.name == effect]
        sizes = {term: finding_parameters(session.robot, term, shown.full_fit)[number].value for term in own}
        large = [str(term.joint) for term, size in sizes.items() if is_large(float(np.ravel(size)[0]))]
        return {joint for joints in large for joint in joints.split("+")}

    rivals = [rival for term in ordered(shown.named) for rival in shown.comparisons[term].rivals]
    scaled = joints_of("torque_constant", "ratio", lambda ratio: abs(ratio - 1.0) > _FAR_FROM_ONE)
    scaling = {term.effect.name for term in shown.plain.terms if term.effect.scales_joint}
    own = [one.joint for rival in rivals for one in rival.effects if one.joint and one.effect in scaling]
    as_rivals = {joint for joints in own for joint in joints.split("+")} - scaled
    computed = {joint for one in session.recordings for joint, source in one.torque_from.items() if source != "tau"}
    damped = joints_of("viscous_friction", "coefficient", lambda size: size > 0.0) - computed
    out = []
    for among, found in ((scaled, True), (as_rivals, False)):
        joints = [joint for joint in session.robot.joint_names if joint in among & damped]
        out += [Note(Code.PERHAPS_VOLTS, None, {"joints": joints, "found": found})] if joints else []
    return tuple(out)


def center_notes(shown: Shown) -> tuple[Note, ...]:
    """A note on each payload whose place a ``recordings.yaml`` counts from another frame than a finding does.

    Findings count from the joint that moves the link, known payloads from the payload frame that the user states.

    Args:
        shown: The findings, with the fit of all their parameters.
    """
    robot, out = shown.problem.session.robot, []
    for term in ordered(shown.named):
        found = finding_parameters(robot, term, shown.full_fit) if term.effect.inertial == "point mass" else {}
        place = [found[f"center_{axis}"] for axis in "xyz" if f"center_{axis}" in found]
        if not any(value.shown for value in place):
            continue
        # A part of the place that the motion does not show is written as zero, which leaves the same torque.
        center = np.array([value.numbers[0] for value in place])
        written = written_center(robot, center)
        if not np.allclose(written, center, rtol=0.0, atol=_SAME_PLACE):
            joint = str(robot.model.names[payload_body(robot)])
            out.append(Note(Code.CENTER_TO_WRITE, joint, {"frame": robot.payload_frame, "center": written.tolist()}))
    return tuple(out)


def _per_speed_of(robot: Robot, term: Term, row: int, gain: float) -> float | None:
    """Torque per speed that a unit of an effect's only parameter makes on a joint; None if it makes none.

    Args:
        robot: The given model.
        term: The effect.
        row: Index of the joint.
        gain: Torque per speed of the reference, by which the loop of the drive responds to a late reference.
    """
    effect, joint = term.effect, robot.joint_names[row]
    if not isinstance(effect, Effect) or effect.inertial is not None or term.joint not in (None, joint):
        return None
    if len(effect.parameters(robot, term.joint)) != 1:
        return None
    one: Float[Array, " 1"] = np.ones(1)
    late = effect.simulated(robot, term.joint, one).reference_delay
    if late is not None:
        return gain * float(late[row])
    return effect.model_numbers(robot, term.joint, one).viscous or None


def one_sided_notes(shown: Shown) -> tuple[Note, ...]:
    """A note on each finding of inertial parameters whose intervals end at the limit of possible bodies.

    Args:
        shown: The findings, with the fit of all their parameters.
    """
    free = [term for term in ordered(shown.named) if term.effect.inertial == "free"]
    intervals = [(term.joint, _one_sided_intervals(shown, term)) for term in free]
    return tuple(Note(Code.ONE_SIDED, joint, {"intervals": own}) for joint, own in intervals if own)


def _one_sided_intervals(shown: Shown, term: Term) -> list[tuple[str, float, float, str]]:
    """Name, lower end, upper end and unit of each one-sided interval of a finding's parameters.

    The intervals come from random draws of the estimate, each moved to the nearest possible body.
    """
    robot, fitted = shown.problem.session.robot, shown.full_fit
    at = fitted.slices_of(term).coefficients
    own, cov = fitted.x[at], fitted.cov[at, at]
    squares, axes = np.linalg.eigh(cov)
    # The symmetric root: other roots rotate with the rounding of the matrix.
    root = (axes * np.sqrt(np.maximum(squares, 0.0))) @ axes.T
    drawn = own + random_stream("bodies that can exist").standard_normal((_DRAWS, len(own))) @ root
    bodies = places_among(np.array(term.columns), bodies_of_term(robot, term))
    precision, unbounded = solve(cov, np.eye(len(own))), np.full(len(own), np.inf)
    nearest = np.array([_nearest(one, precision, unbounded, bodies) for one in drawn])
    stated, mix = base_parameters(robot, term)
    (low, high), unrestricted = (np.percentile(some @ mix.T, [2.5, 97.5], axis=0) for some in (nearest, drawn))
    width = unrestricted[1] - unrestricted[0]
    return [
        (one.name, float(low[k]), float(high[k]), one.unit)
        for k, one in enumerate(stated)
        if 0.0 < high[k] - low[k] < _NARROWER * width[k]
    ]


def _nearest(
    drawn: Float[Array, " k"],
    precision: Float[Array, "k k"],
    unbounded: Float[Array, " k"],
    bodies: list[tuple[Body, Int[Array, " 10"]]],
) -> Float[Array, " k"]:
    """The possible bodies nearest to a draw of the estimate, by the precision of the estimate."""
    if all(body.is_possible(drawn[at]) for body, at in bodies):
        return drawn
    best, _ = possible_minimum(precision, precision @ drawn, (-unbounded, unbounded), drawn, bodies)
    return best
