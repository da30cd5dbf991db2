"""Diagnosis of measured poses: claims, held-out poses, comparison."""

import json
from dataclasses import replace

import numpy as np
import pytest

from by_night import by_night
from identification.engine.claims import Claim
from identification.gates import ORDER
from identification.geometry.diagnose_poses import diagnose_poses
from identification.geometry.equations import Equations
from identification.geometry.result import GeometryResult
from identification.geometry.whitened import Noise, blocks_of, held_out_residual_of_rows, noise_of, whitened
from identification.reporting.comparison import compare, comparison_text
from identification.reporting.stored.diagnosis_files import json_text
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from identification.scenarios.measured_poses import diagnosis_of_poses
from identification.words.geometry_words import all_findings, verdict_sentences
from identification.words.ledger_words import why
from identification.words.note_words import sentences
from phantom_dyn.errors import LogError


def found_of(result: GeometryResult | None) -> dict[tuple[str, str, str], float]:
    assert result is not None
    return {(f.effect, f.joint, name): x.value for f in result.findings for name, x in f.parameters.items()}


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("joint", ["shoulder_lift_joint", "elbow_joint", "wrist_1_joint"])
def test_a_zero_is_found_within_two_tenths_of_a_milliradian(ur10, tracked, joint, turned):
    result = diagnose_poses(ur10, (tracked(11, zeros={joint: 0.003}, turned=turned),))
    assert found_of(result) == {("encoder_offset", joint, "offset"): pytest.approx(0.003, abs=2e-4)}


@pytest.mark.parametrize(("axis", "k"), [("x", 0), ("z", 2)])
def test_a_place_is_found_within_two_tenths_of_a_millimetre(ur10, tracked, axis, k):
    shift = 0.002 * np.eye(3)[k]
    result = diagnose_poses(ur10, (tracked(12, moves=[("elbow_joint", shift)]),))
    assert found_of(result) == {("link_geometry", "elbow_joint", axis): pytest.approx(0.002, abs=2e-4)}


def test_a_stiffness_is_found_within_ten_percent(ur10, tracked):
    result = diagnose_poses(ur10, (tracked(13, compliance={"shoulder_lift_joint": 1 / 3e4}),))
    found = found_of(result)
    assert set(found) == {("joint_elasticity", "shoulder_lift_joint", "compliance")}
    assert 1 / found["joint_elasticity", "shoulder_lift_joint", "compliance"] == pytest.approx(3e4, rel=0.1)


def test_a_zero_a_place_and_an_elasticity_are_found_together(ur10, tracked):
    recording = tracked(
        14,
        poses=80,
        zeros={"shoulder_lift_joint": 0.002},
        moves=[("wrist_1_joint", (0.001, 0, 0))],
        compliance={"elbow_joint": 1 / 1.5e4},
    )
    found = found_of(diagnose_poses(ur10, (recording,)))
    assert found == {
        ("encoder_offset", "shoulder_lift_joint", "offset"): pytest.approx(0.002, abs=2e-4),
        ("link_geometry", "wrist_1_joint", "x"): pytest.approx(0.001, abs=2e-4),
        ("joint_elasticity", "elbow_joint", "compliance"): pytest.approx(1 / 1.5e4, rel=0.1),
    }


def test_shares_add_up_to_what_is_closed(ur10, tracked):
    moves = [("elbow_joint", (0, 0, 0.002))]
    result = diagnose_poses(ur10, (tracked(15, zeros={"shoulder_lift_joint": 0.002}, moves=moves),))
    assert result is not None
    assert sum(one.share for one in result.findings) == pytest.approx(result.closed, abs=1e-9)


def test_the_rms_of_the_tip_falls_to_the_noise(ur10, tracked):
    result = diagnose_poses(ur10, (tracked(16, zeros={"elbow_joint": 0.003}),))
    assert result is not None
    (frame,) = result.frames
    assert frame.rms_before > 1e-3
    assert frame.rms_after == pytest.approx(np.sqrt(3) * 1e-4, rel=0.2)
    assert frame.noise_floor == pytest.approx(np.sqrt(3) * 1e-4, rel=0.2)


def test_the_zero_of_the_first_joint_is_not_claimed_as_the_robot_may_stand_turned(ur10, tracked):
    result = diagnose_poses(ur10, (tracked(17, zeros={"shoulder_pan_joint": 0.01}),))
    assert result is not None
    assert (result.verdict, result.findings) == ("no_gap", ())
    why = {one.joint: one.why for one in result.not_testable if one.effect == "encoder_offset"}
    assert why["shoulder_pan_joint"] == "it is the same as another pose of the robot in the axes of what measured"
    assert why["wrist_3_joint"] == "it is the same as another pose of the target on its frame"


def test_places_along_parallel_axes_are_one_of(ur10, tracked):
    result = diagnose_poses(ur10, (tracked(18, moves=[("elbow_joint", (0, 0.002, 0))]),))
    assert result is not None
    (finding,) = result.findings
    places = {(finding.effect, finding.joint)} | {(p.effect, p.joint) for r in finding.rivals for p in r.places}
    # The axes of these joints are parallel: a shift along them is the same wherever it is.
    axes = ("shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint")
    assert places == {("link_geometry", joint) for joint in axes}
    assert finding.verdict == "one_of"


@pytest.mark.parametrize("seed", by_night(range(100, 106), 0, 1))
def test_a_robot_that_is_right_is_not_blamed(ur10, tracked, seed):
    result = diagnose_poses(ur10, (tracked(seed, poses=20 + 10 * (seed % 3), turned=bool(seed % 2)),))
    assert result is not None
    assert (result.verdict, result.findings, result.minor) == ("no_gap", (), ())


def test_poses_that_are_stamped_late_are_reported_and_taken_out(ur10, tracked, slow_motion):
    t, q = slow_motion
    result = diagnose_poses(ur10, (tracked(19, q=q, t=t, late=0.03, zeros={"elbow_joint": 0.002}),))
    assert result is not None
    (late,) = result.delays
    assert late.delay == pytest.approx(0.03, abs=5e-4)
    assert found_of(result)["encoder_offset", "elbow_joint", "offset"] == pytest.approx(0.002, abs=2e-4)


def test_poses_at_rest_have_no_delay(ur10, tracked):
    result = diagnose_poses(ur10, (tracked(20),))
    assert result is not None
    assert result.delays == ()


def test_a_tracker_that_was_moved_between_recordings_is_no_finding(ur10, tracked):
    recordings = tuple(replace(tracked(seed, poses=30), file=f"{seed}.csv") for seed in (21, 22))
    result = diagnose_poses(ur10, recordings)
    assert result is not None
    assert result.verdict == "no_gap"
    assert [one.file for one in result.fitted if one.what == "base"] == ["21.csv", "22.csv"]


def test_a_few_poses_that_stray_are_left_out_and_reported(ur10, tracked):
    recording = tracked(23, zeros={"elbow_joint": 0.002})
    p = recording.positions["tool0"].copy()
    p[7] += 0.05
    result = diagnose_poses(ur10, (replace(recording, positions={"tool0": p}),))
    assert result is not None
    (warning,) = sentences(result.warnings)
    assert warning == "poses.csv: 1 measured pose lies more than six noise levels from all others and were left out."
    assert found_of(result)["encoder_offset", "elbow_joint", "offset"] == pytest.approx(0.002, abs=2e-4)


def test_repeated_poses_say_the_noise_by_themselves(ur10, tracked):
    q = np.repeat(np.random.default_rng(24).uniform(-1.5, 1.5, (30, 6)), 3, axis=0)
    result = diagnose_poses(ur10, (tracked(24, q=q),))
    assert result is not None
    (frame,) = result.frames
    assert frame.noise_floor_source == "repetitions"
    assert frame.noise_floor == pytest.approx(np.sqrt(3) * 1e-4, rel=0.2)


def test_an_error_that_no_term_explains_is_unknown(ur10, tracked):
    # A joint read with an error that repeats eight times a turn: no zero, no place, no elasticity.
    recording = tracked(25, poses=300, misread=lambda q: q + 0.002 * np.sin(8 * q) * (np.arange(6) == 1))
    repeated = np.repeat(np.random.default_rng(25).uniform(-1.5, 1.5, (40, 6)), 3, axis=0)
    twice = tracked(26, q=repeated, misread=lambda q: q + 0.002 * np.sin(8 * q) * (np.arange(6) == 1))
    result = diagnose_poses(ur10, (recording, replace(twice, file="repeated.csv")))
    assert result is not None
    assert result.structured
    assert result.verdict in ("unknown", "partly_explained")


def test_a_log_without_poses_has_no_geometry(ur10, tracked):
    assert diagnose_poses(ur10, (replace(tracked(27), positions={}),)) is None


def test_a_frame_that_no_joint_moves_is_refused(ur10, tracked):
    recording = tracked(28)
    still = replace(recording, positions={"base_link": recording.positions["tool0"]})
    with pytest.raises(LogError, match="No joint of ur10 moves base_link: name a frame behind a joint"):
        diagnose_poses(ur10, (still,))


@pytest.mark.parametrize("seed", by_night(range(30, 35), 0))
def test_sizes_that_would_have_been_seen_are_a_little_above_what_the_noise_hides(ur10, tracked, seed):
    result = diagnose_poses(ur10, (tracked(29),))
    assert result is not None
    bound = next(one.below for one in result.bounds if (one.effect, one.joint) == ("encoder_offset", "elbow_joint"))
    seen = diagnose_poses(ur10, (tracked(seed, zeros={"elbow_joint": 1.2 * bound}),))
    assert seen is not None
    assert seen.findings
    assert bound < 5e-4


ELBOW = ("encoder_offset", "elbow_joint")


@pytest.fixture
def shifted(ur10, tracked):
    """Poses of an arm whose elbow reads 3 mrad too much."""
    return diagnosis_of_poses(ur10, (tracked(11, zeros={"elbow_joint": 0.003}),))


def of(diagnosis, effect: str, joint: str) -> Claim:
    (claim,) = [one for one in diagnosis.ledger if [(at.effect, at.joint) for at in one.effects] == [(effect, joint)]]
    return claim


def test_what_is_found_has_passed_chance_and_size(shifted):
    assert shifted.geometry.findings
    claim = of(shifted, *ELBOW)
    assert (claim.outcome, claim.judged_by) == ("claimed", "poses")
    assert [result.gate for result in claim.gates] == ["more than chance", "large enough"]
    assert all(result.passed for result in claim.gates)
    assert claim.figures["closes"] == pytest.approx(shifted.geometry.closed, rel=1e-6)


def test_what_is_not_found_has_failed_its_last_gate_and_no_other(shifted):
    others = [claim for claim in shifted.ledger if claim.outcome != "claimed"]
    assert 0 < len(others) <= 10
    for claim in others:
        passed = [result.passed for result in claim.gates]
        assert passed == [True] * (len(passed) - 1) + [False]
        places = [ORDER[result.gate] for result in claim.gates]
        assert places == sorted(places)


def test_what_would_be_claimed_without_a_finding_is_displaced_by_it(shifted):
    claim = of(shifted, "encoder_offset", "shoulder_lift_joint")
    assert claim.outcome == "displaced"
    assert [(at.effect, at.joint) for at in claim.instead] == [ELBOW]
    assert claim.figures["floors_more"] > 0.1


def test_a_robot_that_is_right_has_a_ledger_without_claims(ur10, tracked):
    found = diagnosis_of_poses(ur10, (tracked(21),))
    assert {claim.outcome for claim in found.ledger} == {"not_claimed"}
    assert {claim.gates[-1].gate for claim in found.ledger} == {"more than chance"}


def test_the_ledger_of_poses_is_read_from_the_file_as_it_was_written(shifted, tmp_path):
    file = tmp_path / "diagnosis.json"
    file.write_text(json_text(shifted))
    assert {entry["judged_by"] for entry in json.loads(file.read_text())["ledger"]} == {"poses"}
    read, made = (
        [(claim.effects, claim.outcome, claim.judged_by) for claim in one.ledger]
        for one in (read_diagnosis(file), shifted)
    )
    assert read == made


def test_why_speaks_of_poses(shifted):
    (named,) = why(shifted, "encoder_offset", "elbow_joint")
    assert named.sentence.startswith("An encoder offset on elbow_joint is named: it passed all 2 gates")
    (other,) = why(shifted, "encoder_offset", "shoulder_lift_joint")
    assert "it is not named because an encoder offset on elbow_joint closes" in other.sentence


@pytest.fixture
def equations(rng) -> Equations:
    """Two hundred poses with three nuisances and four terms."""
    rows = 600
    nuisance, columns = rng.standard_normal((rows, 3)), rng.standard_normal((rows, 4))
    left = nuisance @ [1.0, 2.0, 3.0] + columns @ [0.5, 0, 0, 0] + 0.1 * rng.standard_normal(rows)
    return Equations(left, nuisance, columns, (), np.repeat(np.arange(200), 3), np.zeros(rows, dtype=int))


UNITS, NAMES = ("m",) * 4, ("a", "b", "c", "d")


def _whitened(equations: Equations):
    block, kept = equations.pose // 20, np.ones(600, dtype=bool)
    return whitened(equations, np.zeros(4), Noise(np.ones(2), np.ones(2), 500.0), block, kept, (UNITS, NAMES))


def test_losses_are_those_of_fits_that_have_not_seen_the_block(equations):
    found = _whitened(equations)
    matrix, y, block = np.hstack([equations.nuisance, equations.columns[:, [0, 2]]]), equations.residual, found.block
    expected = []
    for b in range(10):
        values = np.linalg.lstsq(matrix[block != b], y[block != b])[0]
        expected.append(np.sum((y[block == b] - matrix[block == b] @ values) ** 2))
    np.testing.assert_allclose(blocks_of(found).losses((0, 2)), expected, rtol=1e-8)


def test_what_is_left_of_each_pose_squares_up_to_the_losses(equations):
    found = _whitened(equations)
    blocks = blocks_of(found)
    left = held_out_residual_of_rows(found, blocks, (1,))
    sums = [np.sum(left[found.block == b] ** 2) for b in range(10)]
    np.testing.assert_allclose(blocks.losses((1,)), sums, rtol=1e-8)


def test_noise_is_what_all_columns_together_leave(equations):
    noise = noise_of(equations, UNITS, NAMES, np.zeros(2, dtype=bool), np.ones(600, dtype=bool))
    assert noise.sigma[0] == pytest.approx(0.1, rel=0.1)
    assert noise.degrees_of_freedom == pytest.approx(600 - 7)


def test_noise_that_lasts_counts_for_as_many_poses_fewer(equations, rng):
    # First order with 0.8 from pose to pose: variances of means grow by (1 + 0.8) / (1 - 0.8) = 9.
    slow = np.zeros((4000, 3))
    for k in range(1, 4000):
        slow[k] = 0.8 * slow[k - 1] + rng.standard_normal(3)
    n = 12000
    long = Equations(
        slow.ravel(), np.ones((n, 1)), np.zeros((n, 4)), (), np.repeat(np.arange(4000), 3), np.zeros(n, dtype=int)
    )
    noise = noise_of(long, UNITS, NAMES, np.ones(2, dtype=bool), np.ones(n, dtype=bool))
    assert noise.correlation_time[0] == pytest.approx(9.0, rel=0.3)


@pytest.fixture
def both(ur10, tracked):
    """Of a robot that is right and one with a wrong zero."""
    recordings = (tracked(50), tracked(51, zeros={"elbow_joint": 0.003}))
    return [diagnosis_of_poses(ur10, (recording,)) for recording in recordings]


def test_a_zero_that_poses_show_is_a_change_between_diagnoses(both):
    said = comparison_text(compare(both, ["before", "after"]))
    assert "The verdict changed: no gap -> explained." in said
    assert "An encoder offset on elbow_joint, offset: not found -> 0.00" in said


def test_the_verdict_of_poses_alone_says_nothing_of_torques(both):
    assert all(verdict_sentences(one).startswith("Measured poses: tool0 is off by") for one in both)


def test_findings_in_poses_are_listed_like_those_in_torque(both):
    (finding,) = all_findings(both[1])
    assert (finding.effect, finding.joint, finding.regime) == ("encoder_offset", "elbow_joint", "posture")
