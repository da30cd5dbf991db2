"""Makes a finding of each shown effect: parameters, closed share of the gap, rivals, and notes on its size.

Two notes need an explanation:

- Sum of a drive. While a joint follows its reference, back-EMF, viscous friction and a late reference all cause a
  torque proportional to the speed. A voltage-driven recording shows only the sum of the three. Motor constants, or
  recordings with another gain of the loop, separate them.
- One-sided intervals. The estimate of inertial parameters may be at the limit of possible bodies. Beyond it, bodies
  have a negative mass or moment of inertia, or a centre of mass out of reach, so the interval has one side only.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identification.data.changes import written_center
from identification.data.drives.joint_torque import per_speed
from identification.diagnosis.columns.motion.soft_friction import soft_joints
from identification.diagnosis.columns.session import Series
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import ResidualSums, held_out_torque
from identification.diagnosis.fit.possible_bodies import Body, bodies_of_term, positions_of_bodies, possible_minimum
from identification.diagnosis.judge.findings.gate_state import ShownEffects
from identification.diagnosis.judge.findings.held_torque import held_references_imitate, is_viscous
from identification.diagnosis.judge.findings.imitation import (
    LARGEST_PROBABILITY,
    imitation_of,
    is_inertial_or_scale,
    joints_on_lines,
    joints_with_computed_torque,
    joints_with_unmodelled_forces,
    with_imitation,
    with_limit,
)
from identification.diagnosis.judge.findings.missing_parts import missing_part_notes
from identification.diagnosis.judge.findings.parameters import (
    base_parameters,
    finding_loadings,
    finding_parameters,
    sum_notes,
)
from identification.diagnosis.judge.findings.possible_load import possible_load_notes
from identification.diagnosis.judge.findings.shown_numbers import (
    widened_by_rivals,
    widened_by_tolerances,
    with_unknown_marked,
)
from identification.diagnosis.judge.findings.sound_sizes import size_notes
from identification.diagnosis.judge.findings.untestable_rivals import with_untestable_rivals
from identification.diagnosis.judge.judged_band import JudgedBand
from identification.diagnosis.judge.shares import drawn_blocks, gap_of, residual_sums_with, shares_of
from identification.diagnosis.result import Finding
from identification.diagnosis.search.claims import rows_of_term
from identification.engine import contract_levels
from identification.engine.numerics.bounded import solve
from identification.gates.least_size import large_enough
from identification.notes import Code, Note, Remark
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.effects.effect import Effect
from phantom_dyn.model.inertia import payload_body
from phantom_dyn.model.robot import Robot
from phantom_dyn.random_streams import random_stream

_DRAWS = 200  # random draws of the parameters; the ends of a 95 % interval are the fifth lowest and the fifth highest
# An interval counts as one-sided if the limit to possible bodies reduces it to less than this share of its width.
_ONE_SIDED_SHARE = 0.8
_SAME_POSITION = 1e-4  # positions of a payload in two frames count as equal within this distance [m]
# If a ratio of torque constants differs from one by more, a wrong constant is an improbable cause.
_FAR_FROM_ONE = 0.25


def size_remarks(shown: ShownEffects) -> tuple[Remark, ...]:
    """Notes on the sizes of findings, such as one-sided intervals, missing parts and implausible sizes."""
    robot = shown.problem.session.robot
    of_drives = (*drive_sum_notes(shown), *volts_notes(shown), *held_torque_notes(shown))
    out = list[Remark]((*of_drives, *one_sided_notes(shown), *center_notes(shown)))
    for term in ordered(shown.named):
        effect, own = term.effect, shown.full_fit.coefficients(term)
        assert isinstance(effect, Effect)
        if effect.inertial == "free":
            out += sum_notes(robot, term)
            out += missing_part_notes(shown.problem, term, own)
            out += possible_load_notes(robot, term, own, shown.full_fit.presence_covariance(term))
        elif remark := effect.remark(robot, term.joint, effect.from_coefficients(robot, term.joint, own, term.shape)):
            out.append(remark)
    return (*out, *size_notes(shown))


def _simulator_of_law(robot: Robot, term: Term, coefficients: Float[Array, " k"]) -> str | None:
    """Name of the simulator whose law of dry friction a finding follows; None if it follows the catalogue's law."""
    assert isinstance(term.effect, Effect)
    if term.joint not in soft_joints(robot):
        return None
    theta = term.effect.from_coefficients(robot, term.joint, coefficients, term.shape)
    numbers = term.effect.model_numbers(robot, term.joint, theta)
    return "mujoco" if numbers.whole and numbers.coulomb else None


@dataclass(frozen=True)
class FindingWithout:
    """A finding, the torque of the corrected model without this finding, and whether it is too small to matter."""

    finding: Finding
    without: Series
    minor: bool = False


def findings_of(shown: ShownEffects, judged: JudgedBand, within: ResidualSums) -> tuple[FindingWithout, ...]:
    """Each named effect as a finding, with the torque of the corrected model without this finding.

    Args:
        shown: The effects that passed all gates.
        judged: Problem and noise floor of the judged band.
        within: Residual of the model adjusted within its tolerances.
    """
    plain, problem, chosen, floor = shown.plain, shown.problem, shown.chosen, judged.floor
    robot, after = problem.session.robot, residual_sums_with(plain, chosen)
    fitted = widened_by_rivals(widened_by_tolerances(shown.full_fit, plain, chosen), shown)
    equal_weights, drawn = np.ones((1, len(within.counts))), drawn_blocks(within)
    shares = shares_of(judged, plain, shown.named)
    on_lines, in_sines = joints_on_lines(problem.session), problem.session.in_one_sine
    computed_torque = joints_with_computed_torque(problem.session)
    unmodelled = joints_with_unmodelled_forces(robot)

    def gap_share(without: ResidualSums, weights: Float[Array, "R B"]) -> Float[Array, " R"]:
        return (without.loss(floor, weights) - after.loss(floor, weights)) / gap_of(judged, within, after, weights)

    out = []
    for term in ordered(shown.named):
        without = residual_sums_with(plain, chosen - {term})
        comparison = shown.comparisons[term]
        rows = rows_of_term(problem, term)
        if not on_lines.isdisjoint(rows) or (is_inertial_or_scale(term) and not in_sines.isdisjoint(rows)):
            comparison = with_imitation(comparison, imitation_of(plain, chosen, term))
            comparison = with_limit(comparison, term, LARGEST_PROBABILITY)
        if not computed_torque.isdisjoint(rows):
            comparison = with_limit(comparison, term, contract_levels.DOUBTED)
        own = shown.full_fit.coefficients(term)
        if not unmodelled.isdisjoint(rows) or held_references_imitate(problem.session, term, own):
            comparison = replace(comparison, probability=min(comparison.probability, contract_levels.DOUBTED))
        comparison = with_untestable_rivals(problem, term, own, comparison)
        low, high = np.percentile(gap_share(without, drawn), [2.5, 97.5])
        finding = Finding(
            effect=term.effect.name,
            joint=term.joint,
            regime=term.effect.regime,
            parameters=with_unknown_marked(finding_parameters(robot, term, fitted), problem.session, term.joint),
            gap_closed=float(gap_share(without, equal_weights)[0]),
            gap_closed_interval=(float(low), float(high)),
            probability=comparison.probability,
            rivals=comparison.rivals,
            verdict="one_of" if comparison.rivals else "supported",
            loadings=finding_loadings(robot, term, fitted),
            share=shares[term],
            law=_simulator_of_law(robot, term, own),
        )
        growth = np.sqrt(np.maximum(without.rms() ** 2 - after.rms() ** 2, 0.0))
        large = large_enough(finding.gap_closed, float(np.max(growth / floor)))
        plain.record.add_passed([term], large)
        others = shown.named - {term}
        torque = held_out_torque(problem, others, plain.held_out_fit(others))
        out.append(FindingWithout(finding, torque, minor=not large.passed))
    return tuple(out)


def drive_sum_notes(shown: ShownEffects) -> tuple[Note, ...]:
    """A note on the sum of a drive for each voltage-driven joint with viscous friction or a late reference as finding.

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
        if not np.ptp(gains) <= 1e-3 * max(gains):
            # Several gains of the controller determine each part of the sum.
            continue
        found, loadings = 0.0, []
        for term in ordered(shown.named):
            slope = _per_speed_of(robot, term, j, gains[0])
            if slope is None:
                continue
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


def volts_notes(shown: ShownEffects) -> tuple[Note, ...]:
    """A note on joints whose recorded torque may be a voltage, because it is scaled and includes viscous friction.

    The voltage of a motor is torque times resistance over torque constant, plus speed times torque constant. Taken for
    a torque, it looks like a wrong torque constant with viscous friction. The torque constant may be a finding or a
    rival of one, because on a single joint a load may have a similar torque.

    Args:
        shown: The findings, with the fit of all their parameters.
    """
    session = shown.problem.session
    named = [term for term in ordered(shown.named) if isinstance(term.effect, Effect) and term.joint]

    def joints_with(effect: str, parameter: str, is_large: Callable[[float], bool]) -> set[str]:
        """Joints with a finding of an effect whose parameter is large; a place ``a+b`` is of two joints."""
        own = [term for term in named if term.effect.name == effect]
        sizes = {term: finding_parameters(session.robot, term, shown.full_fit)[parameter].value for term in own}
        places = [str(term.joint) for term, size in sizes.items() if is_large(float(np.ravel(size)[0]))]
        return {joint for place in places for joint in place.split("+")}

    scaled = joints_with("torque_constant", "ratio", lambda ratio: abs(ratio - 1.0) > _FAR_FROM_ONE)
    rivals = [rival for term in ordered(shown.named) for rival in shown.comparisons[term].rivals]
    scaling = {term.effect.name for term in shown.plain.terms if term.effect.scales_joint}
    places = [one.joint for rival in rivals for one in rival.effects if one.joint and one.effect in scaling]
    scaled_by_rivals = {joint for place in places for joint in place.split("+")} - scaled
    not_torque = {joint for one in session.recordings for joint, source in one.torque_from.items() if source != "tau"}
    damped = joints_with("viscous_friction", "coefficient", lambda size: size > 0.0) - not_torque
    out = []
    for candidates, found in ((scaled, True), (scaled_by_rivals, False)):
        joints = [joint for joint in session.robot.joint_names if joint in candidates & damped]
        out += [Note(Code.PERHAPS_VOLTS, None, {"joints": joints, "found": found})] if joints else []
    return tuple(out)


def held_torque_notes(shown: ShownEffects) -> tuple[Note, ...]:
    """A note on joints whose viscous friction may be a torque read at a fixed time after each held reference.

    Args:
        shown: The findings, with the fit of all their parameters.
    """
    session, fitted = shown.problem.session, shown.full_fit
    viscous = [term for term in shown.named if is_viscous(session.robot, term)]
    imitated = {term.joint for term in viscous if held_references_imitate(session, term, fitted.coefficients(term))}
    joints = [joint for joint in session.robot.joint_names if joint in imitated]
    return (Note(Code.HELD_TORQUE, None, {"joints": joints}),) if joints else ()


def center_notes(shown: ShownEffects) -> tuple[Note, ...]:
    """A note on each found payload whose position has other numbers in a ``recordings.yaml``.

    Findings state the position in the frame of the joint that moves the link. A ``recordings.yaml`` states it in the
    payload frame of the robot.

    Args:
        shown: The findings, with the fit of all their parameters.
    """
    robot, out = shown.problem.session.robot, []
    for term in ordered(shown.named):
        found = finding_parameters(robot, term, shown.full_fit) if term.effect.inertial == "point mass" else {}
        coordinates = [found[f"center_{axis}"] for axis in "xyz" if f"center_{axis}" in found]
        if not any(value.shown for value in coordinates):
            continue
        # Coordinates that the motion does not determine are near zero by their prior. They do not change the torque.
        center = np.array([value.numbers[0] for value in coordinates])
        written = written_center(robot, center)
        if not np.allclose(written, center, rtol=0.0, atol=_SAME_POSITION):
            joint = str(robot.model.names[payload_body(robot)])
            out.append(Note(Code.CENTER_TO_WRITE, joint, {"frame": robot.payload_frame, "center": written.tolist()}))
    return tuple(out)


def _per_speed_of(robot: Robot, term: Term, row: int, gain: float) -> float | None:
    """Torque per speed on a joint for one unit of an effect's only parameter; None if there is no such torque.

    ``gain`` is the torque per unit of the reference [N m/rad or N/m]; zero if the torque does not depend on references.
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


def one_sided_notes(shown: ShownEffects) -> tuple[Note, ...]:
    """A note on each finding of inertial parameters with intervals that end at the limit of possible bodies.

    Args:
        shown: The findings, with the fit of all their parameters.
    """
    free = [term for term in ordered(shown.named) if term.effect.inertial == "free"]
    intervals = [(term.joint, _one_sided_intervals(shown, term)) for term in free]
    return tuple(Note(Code.ONE_SIDED, joint, {"intervals": own}) for joint, own in intervals if own)


def _one_sided_intervals(shown: ShownEffects, term: Term) -> list[tuple[str, float, float, str]]:
    """Name, lower end, upper end and unit of each one-sided interval of a finding's parameters.

    The intervals are those of random draws of the estimate, each replaced by the nearest possible body.
    """
    robot, fitted = shown.problem.session.robot, shown.full_fit
    at = fitted.slices_of(term).coefficients
    own, cov = fitted.x[at], fitted.cov[at, at]
    squares, axes = np.linalg.eigh(cov)
    # The symmetric root is unique; other roots depend on the rounding of the matrix.
    root = (axes * np.sqrt(np.maximum(squares, 0.0))) @ axes.T
    drawn = own + random_stream("bodies that can exist").standard_normal((_DRAWS, len(own))) @ root
    bodies = positions_of_bodies(np.array(term.columns), bodies_of_term(robot, term))
    precision, unbounded = solve(cov, np.eye(len(own))), np.full(len(own), np.inf)
    nearest = np.array([_nearest(one, precision, unbounded, bodies) for one in drawn])
    stated, mix = base_parameters(robot, term)
    low, high = np.percentile(nearest @ mix.T, [2.5, 97.5], axis=0)
    low_of_draws, high_of_draws = np.percentile(drawn @ mix.T, [2.5, 97.5], axis=0)
    width = high_of_draws - low_of_draws
    return [
        (one.name, float(low[k]), float(high[k]), one.unit)
        for k, one in enumerate(stated)
        if 0.0 < high[k] - low[k] < _ONE_SIDED_SHARE * width[k]
    ]


def _nearest(
    drawn: Float[Array, " k"],
    precision: Float[Array, "k k"],
    unbounded: Float[Array, " k"],
    bodies: list[tuple[Body, Int[Array, " 10"]]],
) -> Float[Array, " k"]:
    """The possible bodies that are nearest to a draw of the estimate; distances are weighted by ``precision``."""
    if all(body.is_possible(drawn[at]) for body, at in bodies):
        return drawn
    best, _ = possible_minimum(precision, precision @ drawn, (-unbounded, unbounded), drawn, bodies)
    return best
