from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.judge.verdict import (
    nearly_closed,
    ordinary_effects_may_hide,
    torques_may_be_noise,
    verdict,
)
from identification.diagnosis.result import Bound, JointGap, Unexplained

# Oracle: the contract's table, row by row. All floors are one, with an interval up to 1.1.
NOTHING = Unexplained(0.0, False, None, None)
BURST = Unexplained(0.0, False, "j1", None, ((1.0, 1.4),))


def structure(fraction: float) -> Unexplained:
    return Unexplained(fraction, True, "j1", "low_speed")


def joint(within: float, after: float, name: str = "j1") -> JointGap:
    return JointGap(name, "N m", within, after, 1.0, 100, rms_within_tolerance=within, noise_floor_interval=(0.9, 1.1))


def said(joints, findings=(), left=NOTHING, *, moved=True, hides=False) -> str:
    return verdict(tuple(joints), tuple(findings), left, moved=moved, may_hide=hides)


@pytest.mark.parametrize(
    ("after", "left", "hides", "expected"),
    [
        (1.09, NOTHING, False, "no_gap"),
        (0.5, NOTHING, False, "no_gap"),
        (1.09, NOTHING, True, "not_testable"),
        (1.11, NOTHING, False, "unknown"),
        (1.11, NOTHING, True, "unknown"),
        (1.0, structure(0.01), False, "unknown"),
        (1.0, structure(0.9), True, "unknown"),
        (1.0, BURST, False, "unknown"),
    ],
)
def test_without_a_finding_every_joint_has_to_be_within_its_noise(after, left, hides, expected):
    assert said([joint(1.0, 1.0), joint(after, after, "j2")], (), left, hides=hides) == expected


@pytest.mark.parametrize(("given", "expected"), [(1.09, "no_gap"), (1.11, "unknown")])
def test_a_joint_that_the_given_model_explains_has_no_gap_whatever_moves_for_others_leave(given, expected):
    assert said([joint(1.0, 1.0), replace(joint(1.3, 1.3, "j2"), rms_before=given)]) == expected


@pytest.mark.parametrize(
    ("source", "expected"), [("sensors", "no_gap"), ("repetitions", "no_gap"), ("none", "not_testable")]
)
def test_an_upper_limit_of_the_noise_never_shows_that_there_is_no_gap(source, expected):
    assert said([joint(1.0, 1.0), replace(joint(1.0, 1.0, "j2"), noise_floor_source=source)]) == expected


def test_a_joint_that_was_never_judged_does_not_need_a_known_noise():
    unseen = replace(joint(1.0, 1.0, "j2"), noise_floor_source="none", hold_out_samples=0)
    assert said([joint(1.0, 1.0), unseen]) == "no_gap"


@pytest.mark.parametrize(
    ("after", "torque", "expected"),
    [(2.0, 41.0, "no_gap"), (2.0, 39.0, "not_testable"), (1.5, 3.0, "no_gap"), (2.0, None, "no_gap")],
)
def test_what_only_friction_in_doubt_may_make_is_no_gap_up_to_a_twentieth_of_the_torque(after, torque, expected):
    # By hand: 1.5 noise floors and less are noise, whatever the torque.
    loud = replace(joint(after, after), noise_floor_interval=(0.9, 5.0), rms_torque=torque)
    assert said([joint(1.0, 1.0), loud]) == expected


@pytest.mark.parametrize(("after", "expected"), [(1.48, "no_gap"), (1.50, "unknown")])
def test_noise_and_discrepancy_together_are_what_may_be_left(after, expected):
    # By hand: squares of 1.1 and 1.0 add to that of 1.487.
    assert said([replace(joint(after, after), discrepancy=1.0)]) == expected


def test_what_may_be_noise_is_no_gap_however_uncertain_the_noise_is(made_up):
    loud = replace(joint(10.0, 4.0), noise_floor_interval=(0.1, 5.0))
    assert said([loud], made_up(findings=1).findings) == "explained"


@pytest.mark.parametrize(
    ("within", "after", "left", "expected"),
    [
        (10.0, 1.5, NOTHING, "explained"),
        (10.0, 1.5, structure(0.09), "explained"),
        (10.0, 1.5, structure(0.1), "partly_explained"),
        (10.0, 1.5, structure(0.5), "partly_explained"),
        (10.0, 1.5, BURST, "partly_explained"),
        (10.0, 3.3, NOTHING, "explained"),  # 9.89 of 99: just under a tenth of its own gap
        (10.0, 3.31, NOTHING, "partly_explained"),
        (10.0, 7.1, NOTHING, "partly_explained"),  # leaves 49.4, explains 49.6
        (10.0, 7.11, NOTHING, "unknown"),
        (10.0, 9.0, structure(0.9), "unknown"),
    ],
)
def test_with_findings_what_is_left_decides(made_up, within, after, left, expected):
    assert said([joint(within, after)], made_up(findings=1).findings, left) == expected


def test_one_joint_with_much_left_is_enough_for_a_gap_that_is_only_partly_explained(made_up):
    joints = [joint(100.0, 1.0), joint(10.0, 3.4, "j2")]
    assert said(joints, made_up(findings=1).findings) == "partly_explained"


@pytest.mark.parametrize("found", [0, 1])
def test_where_nothing_moves_nothing_can_be_tested(made_up, found):
    findings = made_up(findings=1).findings[:found]
    assert said([joint(10.0, 10.0)], findings, structure(1.0), moved=False) == "not_testable"


def test_the_residual_of_the_given_model_counts_where_no_other_is_known():
    assert nearly_closed(JointGap("j1", "N m", 10.0, 3.3, 1.0, 100))
    assert not nearly_closed(JointGap("j1", "N m", 10.0, 3.4, 1.0, 100))


def bound(of_torque: float | None) -> Bound:
    return Bound("coulomb_friction", "j1", "torque", 0.1, "N m", of_torque)


def test_all_torques_may_be_noise_where_no_joint_that_was_judged_has_more_torque():
    quiet, loud = (JointGap("j1", "N m", 2.0, 2.0, 2.0, 100, rms_torque=torque) for torque in (2.1, 2.0))
    unjudged = JointGap("j2", "N m", 0.0, 0.0, 1.0, 0, rms_torque=0.0)
    assert torques_may_be_noise((loud, unjudged))
    assert not torques_may_be_noise((loud, quiet))
    assert not torques_may_be_noise((unjudged,))


def test_a_torque_within_the_interval_of_its_noise_is_noise_whatever_was_found(made_up):
    # By hand: noise of 2 up to 2.3, torques just inside and outside.
    inside, outside = (
        JointGap("j1", "N m", 9.0, 2.0, 2.0, 100, rms_torque=torque, noise_floor_interval=(1.8, 2.3))
        for torque in (2.29, 2.31)
    )
    assert said([inside], made_up(findings=1).findings) == "not_testable"
    assert said([outside], made_up(findings=1).findings) == "explained"


@pytest.mark.parametrize(
    ("shares", "hide"), [((0.2, 0.11), True), ((0.2, 0.1), False), ((None, 0.2), True), ((None,), False), ((), False)]
)
def test_ordinary_effects_hide_where_every_known_bound_is_above_a_tenth_of_the_torque(shares, hide):
    assert ordinary_effects_may_hide(tuple(bound(share) for share in shares)) is hide


@pytest.mark.parametrize(
    ("floor", "within", "after", "closed"),
    # By hand: one and a half floors, or a tenth of a gap in squares.
    [
        (0.5, 0.6, 0.75, True),
        (0.5, 0.8, 0.751, False),
        (4.0, 6.5, 6.0, True),
        (4.0, 6.5, 6.01, False),
        (0.5, 5.0, 1.65, True),  # 9.89 of 99
        (0.5, 5.0, 1.66, False),
        (4.0, 40.0, 13.2, True),
        (4.0, 40.0, 13.3, False),
    ],
)
def test_a_joint_is_nearly_closed_in_floors_of_its_own(floor, within, after, closed):
    gap = JointGap("j1", "N m", 99.0, after, floor, 100, rms_within_tolerance=within)
    assert nearly_closed(gap) is closed


@pytest.mark.parametrize(("after", "expected"), [(2.6, "partly_explained"), (2.7, "unknown")])
def test_losses_are_means_over_joints_in_floors_of_their_own(made_up, after, expected):
    # By hand: squares in floors of 4 and 58 within tolerance, of 4 and 27.04 or 29.16 after: of a mean gap of 30 are
    # 14.52 or 15.58 left.
    first = JointGap("j1", "N m", 9.0, 4.0, 2.0, 100, rms_within_tolerance=4.0)
    second = JointGap("j2", "N m", 9.0, after, 0.5, 100, rms_within_tolerance=np.sqrt(58.0) * 0.5)
    assert said([first, second], made_up(findings=1).findings) == expected


@pytest.mark.parametrize(("findings", "expected"), [(1, "partly_explained"), (0, "no_gap")])
def test_a_size_that_no_sound_robot_has_does_not_explain(made_up, findings, expected):
    found = made_up(findings=findings).findings
    assert verdict((joint(1.0, 1.0),), found, NOTHING, moved=True, may_hide=False, plausible=False) == expected
