"""Chosen effects as findings: parameters, share of the gap that each closes, and rivals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.diagnosis.columns.motion.soft_friction import soft_joints
from identification.diagnosis.columns.session import Series
from identification.diagnosis.columns.terms import Term, ordered
from identification.diagnosis.fit.gap import Sums, held_out_torque, residual_after, sums
from identification.diagnosis.judge.findings.bench import Shown
from identification.diagnosis.judge.findings.drive_sums import drive_sums
from identification.diagnosis.judge.findings.missing_parts import (
    missing_part_notes,
)
from identification.diagnosis.judge.findings.one_sided import one_sided
from identification.diagnosis.judge.findings.parameters import finding_loadings, finding_parameters
from identification.diagnosis.judge.findings.shown_numbers import only_shown
from identification.diagnosis.judge.findings.sound_sizes import size_notes
from identification.diagnosis.judge.findings.wider_deviations import with_other_causes, with_other_tolerances
from identification.diagnosis.judge.judged_band import Judge
from identification.diagnosis.judge.shares import drawn_blocks, gap_of, shares_of
from identification.diagnosis.result import Finding
from identification.diagnosis.search.claims import rows_of
from identification.diagnosis.search.imitation import (
    along_lines,
    beside_imitation,
    imitated_by,
    of_a_model,
    of_every_motion,
    of_weights,
    on_a_line,
)
from identification.gates.least_size import large_enough
from identification.notes import Said
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.effect import Effect
from phantom_dyn.model.robot import Robot


def remarks(shown: Shown) -> tuple[Said, ...]:
    """Notes on what the sizes of findings say of the robot, and on each size that no sound robot has."""
    robot, out = shown.problem.session.robot, list[Said]((*drive_sums(shown), *one_sided(shown)))
    for term in ordered(shown.named):
        effect, own = term.effect, shown.joint_fit.coefficients(term)
        assert isinstance(effect, Effect)
        if effect.inertial == "free":
            out += missing_part_notes(shown.problem, term, own)
            continue
        remark = effect.remark(robot, term.joint, effect.from_coefficients(robot, term.joint, own, term.shape))
        out += [remark] if remark else []
    out += size_notes(shown)
    return tuple(out)


def _law(robot: Robot, term: Term, coefficients: Float[Array, " k"]) -> str | None:
    """The simulator whose own law dry friction follows that a joint of a MuJoCo file was found to have."""
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


def findings_without(shown: Shown, judge: Judge, within: Sums) -> tuple[FindingWithout, ...]:
    """Each named effect with its share, its gap closed and rivals, and the torque of the other named ones without it.

    Args:
        shown: The effects that are shown.
        judge: Of the gap.
        within: What the best moves within the tolerances leave.
    """
    plain, chosen = shown.plain, shown.chosen
    fitted = with_other_causes(with_other_tolerances(shown.joint_fit, plain, chosen), shown)
    robot = plain.problem.session.robot
    problem, floor, found = plain.problem, judge.floor, plain.evaluate(chosen)
    after = sums(problem, judge.narrow(residual_after(problem, held_out_torque(problem, chosen, found))))
    drawn = drawn_blocks(within)
    once = np.ones((1, len(within.counts)))
    shares = shares_of(judge, plain, shown.named)
    lines, sines = along_lines(problem.session), problem.session.in_one_sine
    compensated = of_weights(problem.session)
    out = []
    for term in ordered(chosen):
        if not term.named:
            continue
        others = frozenset(other for other in chosen if other.named and other is not term)
        without = plain.evaluate(chosen - {term})
        torque = held_out_torque(problem, chosen - {term}, without)
        lost = sums(problem, judge.narrow(residual_after(problem, torque)))

        def closed(weights: Float[Array, "R B"], lost: Sums = lost) -> Float[Array, " R"]:
            gap = gap_of(judge, within, after, weights)
            return (lost.loss(floor, weights) - after.loss(floor, weights)) / gap

        standing = shown.standings[term]
        rows = rows_of(problem, term)
        if not lines.isdisjoint(rows) or (of_every_motion(term) and not sines.isdisjoint(rows)):
            standing = on_a_line(beside_imitation(standing, imitated_by(plain, chosen, term)), term)
        if not compensated.isdisjoint(rows):
            standing = of_a_model(standing, term)
        low, high = np.percentile(closed(drawn), [2.5, 97.5])
        finding = Finding(
            effect=term.effect.name,
            joint=term.joint,
            regime=term.effect.regime,
            parameters=only_shown(finding_parameters(robot, term, fitted), problem.session, term.joint),
            gap_closed=float(closed(once)[0]),
            gap_closed_interval=(float(low), float(high)),
            probability=standing.probability,
            rivals=standing.rivals,
            verdict="one_of" if standing.rivals else "supported",
            loadings=finding_loadings(robot, term, fitted),
            share=shares[term],
            law=_law(robot, term, shown.joint_fit.coefficients(term)),
        )
        more = np.sqrt(np.maximum(lost.rms() ** 2 - after.rms() ** 2, 0.0))
        large = large_enough(finding.gap_closed, float(np.max(more / floor)))
        plain.record.kept([term], large)
        if others != chosen - {term}:
            torque = held_out_torque(problem, others, plain.evaluate(others))
        out.append(FindingWithout(finding, torque, minor=not large.passed))
    return tuple(out)
