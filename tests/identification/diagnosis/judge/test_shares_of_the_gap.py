"""What findings close of the gap, and sizes that no robot has. Oracle: the contract's loss by hand, known truths."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fit.gap import ResidualSums, held_out_torque, residual_after, residual_sums
from identification.diagnosis.judge.findings.findings import (
    findings_of,
    size_remarks,
)
from identification.diagnosis.judge.findings.gate_state import GateContext, LoopState, Residuals
from identification.diagnosis.judge.findings.shown import shown_effects
from identification.diagnosis.judge.judged_band import JudgedBand, plain_search
from identification.diagnosis.judge.shares import least_shares_closed, residual_sums_with
from identification.diagnosis.noise.noise_floor import noise_floor
from identification.engine import contract_levels
from identification.words.note_words import sentences
from identification.words.notes_on_findings import _range, _sized
from phantom_dyn.effects.catalogue import effect_named


@pytest.fixture(scope="module")
def case(lab, planar2):
    """Friction on the elbow and an offset on the shoulder that the model lacks, shown and judged."""
    motion = lab.motion(2, 4, seconds=20.0)
    torque = -0.3 * np.sign(motion.v) * [0.0, 1.0] + np.array([0.4, 0.0])
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),))
    plain = plain_search(prepared.search, prepared.noise)
    chosen = frozenset([prepared.term("coulomb_friction", "elbow"), prepared.term("torque_offset", "shoulder")])
    floor = noise_floor(prepared.session, prepared.columns, prepared.noise)
    judged = JudgedBand(plain.problem, floor, floor)
    residuals = Residuals(lambda _: judged, lambda *_: np.full_like(judged.floor, np.inf), lambda _: True)
    shown = shown_effects(GateContext(prepared.search, plain, prepared.noise, residuals), LoopState.of(chosen))
    return shown, judged, residual_sums_with(plain, frozenset())


def mean_square(shown, judged, kept) -> float:
    """The contract's loss: mean over joints of the squared residual over the squared noise floor."""
    problem = shown.problem
    torque = held_out_torque(problem, kept, shown.plain.held_out_fit(kept))
    return float(
        np.mean(
            residual_sums(problem, judged.problem.session.in_judged_band(residual_after(problem, torque))).rms() ** 2
            / judged.floor**2
        )
    )


def test_what_a_finding_closes_is_what_is_lost_without_it_over_the_gap(case):
    shown, judged, within = case
    gap = float(np.mean(within.rms() ** 2 / judged.floor**2)) - 1.0
    for finding in (claim.finding for claim in findings_of(*case)):
        term = next(term for term in shown.chosen if term.effect_joint == (finding.effect, finding.joint))
        lost = mean_square(shown, judged, shown.chosen - {term}) - mean_square(shown, judged, shown.chosen)
        assert finding.gap_closed == pytest.approx(lost / gap, rel=1e-6)
        low, high = finding.gap_closed_interval
        assert low < finding.gap_closed < high
        assert high - low < 0.5


def test_where_the_mean_over_joints_is_within_the_floor_shares_are_of_what_the_findings_close(case):
    # A floor whose interval is so wide that the gap lies within it: what they close together is all of it.
    shown, judged, within = case
    wide = replace(judged, highest=1e3 * judged.floor)
    found = [claim.finding for claim in findings_of(shown, wide, within)]
    assert sum(finding.share for finding in found) == pytest.approx(1.0)
    assert all(abs(finding.gap_closed) < 1.5 for finding in found)


def test_two_findings_close_the_gap_of_what_was_put_in(case):
    # Known truth: nothing but the two is missing; an offset may be reported as its twin, a spring that rests far away.
    findings = [claim.finding for claim in findings_of(*case)]
    assert {finding.joint for finding in findings} == {"elbow", "shoulder"}
    assert sum(finding.gap_closed for finding in findings) == pytest.approx(1.0, abs=0.1)


def test_the_torque_without_a_finding_is_that_of_the_fit_without_it(case):
    shown, _, _ = case
    for claim in findings_of(*case):
        finding, torque = claim.finding, claim.without
        term = next(term for term in shown.chosen if term.effect_joint == (finding.effect, finding.joint))
        kept = shown.chosen - {term}
        expected = held_out_torque(shown.problem, kept, shown.plain.held_out_fit(kept))
        np.testing.assert_array_equal(torque[0], expected[0])


@pytest.mark.parametrize("share", [0.99, 1.01])
@pytest.mark.parametrize("floors", [0.99, 1.01])
def test_a_finding_is_minor_that_closes_little_and_raises_no_joint(case, monkeypatch, share, floors):
    # By hand: limits at what the one that closes most of the gap closes, and raises the joint that it raises most.
    shown, judged, _ = case
    most = max((claim.finding for claim in findings_of(*case)), key=lambda finding: finding.gap_closed)
    term = next(term for term in shown.chosen if term.effect_joint == (most.effect, most.joint))
    squares = []
    for kept in (shown.chosen - {term}, shown.chosen):
        torque = held_out_torque(shown.problem, kept, shown.plain.held_out_fit(kept))
        squares.append(
            residual_sums(
                shown.problem, judged.problem.session.in_judged_band(residual_after(shown.problem, torque))
            ).rms()
            ** 2
        )
    raised = float(np.sqrt(np.maximum(squares[0] - squares[1], 0.0) / judged.floor**2).max())
    monkeypatch.setattr(contract_levels, "MINOR_SHARE", share * most.gap_closed)
    monkeypatch.setattr(contract_levels, "MINOR_FLOORS", floors * raised)
    minor = {claim.finding.effect: claim.minor for claim in findings_of(*case)}
    assert minor[most.effect] is (share > 1.0 and floors > 1.0)


def test_sizes_of_a_sound_robot_are_not_doubted(case):
    assert size_remarks(case[0]) == ()


def test_a_friction_beyond_the_limit_of_its_drive_is_doubted(case):
    # Known truth: 0.3 N m on a drive that is said to give 0.1.
    shown = case[0]
    session = shown.problem.session
    weak = tuple(replace(one, torque_limit=0.1) for one in session.robot.actuators)
    session = replace(session, robot=replace(session.robot, actuators=weak))
    plain = replace(shown.plain, problem=replace(shown.problem, session=session))
    doubts = sentences(size_remarks(replace(shown, plain=plain)))
    said = next(doubt for doubt in doubts if "coulomb friction" in doubt)
    assert said.startswith("The torque of coulomb friction on elbow comes out as 0.")
    assert "is not plausible (" in said
    assert said.endswith("a joint whose friction is more than its drive can give does not move.")


@pytest.mark.parametrize(
    ("plausible", "unit", "words"),
    [
        ((0.0, 5.0), "N m", "0 to 5 N m is"),
        ((0.5, 2.0), "1", "0.5 to 2 is"),
        ((0.0, None), "N m", "at least 0 N m is"),
        ((None, 5.0), "N m", "at most 5 N m is"),
    ],
)
def test_a_range_is_reported_by_its_ends(plausible, unit, words):
    assert _range(*plausible, unit) == words


def test_a_size_is_reported_with_its_unit_to_three_digits():
    assert _sized(1.23456, "kg") == "1.23 kg"
    assert _sized(1.23456, "1") == "1.23"


def closing(quiet, gains):
    """Least that friction of the elbow closes, over what it closes, where it takes so much off each block."""
    term = quiet.term("coulomb_friction", "elbow")
    counts = np.full((len(gains), 2), 100.0)

    def left(chosen):
        more = np.zeros(len(gains)) if term in chosen else np.asarray(gains, dtype=float)
        return ResidualSums(np.column_stack([100.0 + 100.0 * more, np.full(len(gains), 100.0)]), counts)

    return least_shares_closed(left, frozenset([term]), np.ones(2))[term]


@pytest.mark.parametrize(
    ("gains", "least"),
    [
        ([1.0] * 8, 1.0),
        # By hand: a draw without the block, of which there are (7/8)^8 = 34 %, closes nothing.
        ([8.0, *[0.0] * 7], 0.0),
        # A number that a file can hold, below what the gate allows.
        ([-0.5] * 8, -1.0),
    ],
    ids=["the same in every block", "in one block alone", "nothing"],
)
def test_the_least_that_is_closed_is_that_of_the_worst_usual_draw_of_blocks(quiet, gains, least):
    assert closing(quiet, gains) == pytest.approx(least)


def test_what_opens_the_gap_in_many_blocks_is_not_sure(quiet):
    assert closing(quiet, [6.0, *[-0.5] * 7]) < -0.1


def test_a_near_twin_is_not_asked(quiet):
    late = quiet.term("viscous_friction", "elbow")
    twin = replace(late, effect=effect_named("reference_delay"))
    counts = np.full((4, 2), 100.0)
    assert least_shares_closed(lambda _: ResidualSums(counts, counts), frozenset([late, twin]), np.ones(2)) == {}
