import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from by_night import by_night
from identification.diagnosis.judge.verdict import torques_may_be_noise
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose
from identification.stages import Announcement, Stage
from phantom_dyn import load_robot
from phantom_dyn.errors import LogError
from phantom_dyn.motion import Motion

# Effect, joint and parameters that a robot has and its model lacks.
INJECTED = [
    ("viscous_friction", "shoulder", {"coefficient": 0.4}),
    ("coulomb_friction", "elbow", {"torque": 0.3}),
    (
        "direction_dependent_friction",
        "elbow",
        {"torque_positive": 0.5, "torque_negative": 0.3, "coefficient_positive": 0.05, "coefficient_negative": 0.35},
    ),
    ("stribeck_friction", "elbow", {"coulomb_torque": 0.3, "static_torque": 0.9, "stribeck_velocity": 0.25}),
    ("torque_offset", "elbow", {"torque": 0.3}),
    ("torque_constant", "shoulder", {"ratio": 0.7}),
    ("torque_constant", "elbow", {"ratio": 1.4}),
    ("rotor_inertia", "elbow", {"inertia": 0.2}),
    ("payload", None, {"mass": 0.6, "center_x": 0.03, "center_y": 0.0, "center_z": -0.35}),
    ("parasitic_spring", "shoulder", {"stiffness": 6.0, "rest_position": 0.2}),
]

# Whole diagnoses; annotations are checked in those of other robots, in the files beside this one.
pytestmark = pytest.mark.whole

RUBBING = ("coulomb_friction", "elbow", (0.3,))


def places(diagnosis: Diagnosis) -> list[tuple[str, str | None]]:
    return [(finding.effect, finding.joint) for finding in diagnosis.findings]


@pytest.mark.parametrize(("effect", "joint", "theta"), by_night(INJECTED, 1, 3, 5, 8))
def test_an_effect_is_named_on_its_joint_and_nothing_else_is(diagnosed, effect, joint, theta):
    found = diagnosed((effect, joint, tuple(theta.values())))
    assert places(found) == [(effect, joint)]
    assert found.verdict == "explained"


@pytest.mark.parametrize("size", by_night([1e-9, 1.0], 0))
def test_a_torque_that_has_nothing_to_do_with_the_motion_explains_nothing(planar2, lab, rng, size):
    # Known truth: white noise stands in the columns of the torques. A model without mass would leave as little.
    recording = lab.recording(planar2, lab.motion(2, 3, swing=1.5))
    found = diagnose(planar2, (replace(recording, tau=size * rng.standard_normal(recording.q.shape)),))
    assert (found.verdict, found.findings, found.unexplained.law) == ("not_testable", (), None)
    assert torques_may_be_noise(found.joints)


@pytest.mark.parametrize(
    ("effect", "joint", "theta"), by_night([case for case in INJECTED if case[0] != "stribeck_friction"], 1, 4, 7)
)
def test_the_parameters_of_an_effect_come_back(diagnosed, effect, joint, theta):
    # Known truth; the places of a payload across the plane leave no trace.
    parameters = diagnosed((effect, joint, tuple(theta.values()))).findings[0].parameters
    for name, truth in theta.items():
        if name == "center_y":
            continue
        assert abs(parameters[name].value - truth) < max(4 * parameters[name].std, 0.01 * abs(truth))


@pytest.mark.parametrize("seed", by_night(range(6), 0))
def test_nothing_is_found_where_nothing_is_wrong(diagnosed, seed):
    found = diagnosed(seed=seed)
    assert found.findings == ()
    assert found.verdict == "no_gap"


@pytest.mark.parametrize("noise", by_night([0.0, 1e-5, 1e-4], 1))
def test_a_joint_that_is_held_has_no_friction_to_find(lab, planar2, rng, noise):
    # Known truth: no gap; the elbow is held, and its encoder has noise.
    motion = lab.motion(2)
    held = Motion(motion.t, motion.q * [1, 0], motion.v * [1, 0], motion.a * [1, 0])
    positions = held.q + noise * rng.standard_normal(held.q.shape) * [0, 1]
    found = diagnose(planar2, (replace(lab.recording(planar2, held), q=positions),))
    assert found.findings == ()
    assert {"viscous_friction", "coulomb_friction"} <= {n.effect for n in found.not_testable if n.joint == "elbow"}


def test_rotor_inertia_within_its_tolerance_is_adjusted_and_no_finding(lab, planar2):
    # Known truth: 8 % more rotor inertia than modelled, with a tolerance of 10 %.
    model = planar2.model.copy()
    model.armature = np.array([0.0, 0.2])
    robot = replace(planar2, model=model)
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = lab.acting(robot, motion, "rotor_inertia", "elbow", 0.016)
    found = diagnose(robot, (lab.recording(robot, motion, torque, noise=0.01),))
    assert found.verdict == "no_gap"
    assert found.findings == ()
    change = {item.quantity: item.change for item in found.adjusted}["elbow rotor inertia"]
    assert change == pytest.approx(0.08, abs=0.02)


def test_friction_within_its_tolerance_is_adjusted_and_no_finding(lab, planar2):
    # Known truth: 8 % more Coulomb friction on the elbow, within two tolerances of 5 %.
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = -0.08 * 0.2 * np.sign(motion.v) * [0.0, 1.0]
    found = diagnose(planar2, (lab.recording(planar2, motion, torque, noise=0.01),))
    assert found.findings == ()
    assert {a.quantity: a.change for a in found.adjusted}["elbow Coulomb friction"] == pytest.approx(0.08, abs=0.02)


def test_the_gap_that_an_effect_closes_is_nearly_all_where_the_model_is_trusted(lab, planar2, trusted):
    # Nothing else may move, so without the effect the whole gap is there again.
    robot = trusted(planar2)
    motion = lab.motion(2, 3, seconds=20.0)
    torque = -0.5 * motion.v * [0.0, 1.0]
    found = diagnose(robot, (lab.recording(robot, motion, torque),))
    (finding,) = found.findings
    assert finding.gap_closed == pytest.approx(1.0, abs=0.03)
    low, high = finding.gap_closed_interval
    assert low <= finding.gap_closed <= high
    assert high - low < 0.1


def test_the_gap_of_each_joint_falls_to_its_noise(diagnosed):
    shoulder, elbow = diagnosed(RUBBING).joints
    assert elbow.rms_before > 3 * elbow.noise_floor
    for left, joint in ((elbow.rms_after, elbow), (shoulder.rms_before, shoulder)):
        low, high = joint.noise_floor_interval
        assert 0.85 * low < left < 1.15 * high


def test_probabilities_of_a_finding_its_rivals_and_causes_outside_the_catalogue_sum_to_one(diagnosed):
    for effect, joint, theta in (INJECTED[3], INJECTED[8]):
        findings = diagnosed((effect, joint, tuple(theta.values()))).findings
        assert findings
        for finding in findings:
            total = finding.probability + sum(rival.probability for rival in finding.rivals)
            # Known truth: the cause is in the catalogue.
            assert 0.9 < total < 1.0 + 1e-9
            assert finding.verdict == ("one_of" if finding.rivals else "supported")


def test_a_recording_that_no_fit_sees_is_what_is_judged(lab, planar2):
    # Known truth: the effect is in both recordings.
    motions = [lab.motion(2, seed) for seed in (3, 4)]
    seen, unseen = (
        lab.recording(planar2, motion, -0.3 * np.sign(motion.v) * [0.0, 1.0], seed=k)
        for k, motion in enumerate(motions)
    )
    found = diagnose(planar2, (seen, unseen), held_out=1)
    assert places(found) == [("coulomb_friction", "elbow")]
    # Of two recordings of one length: samples of the second alone are counted.
    assert found.joints[1].hold_out_samples < 0.5 * len(found.evidence.t)
    assert found.joints[1].rms_after == pytest.approx(found.joints[1].noise_floor, rel=0.2)


def test_a_law_that_is_in_no_catalogue_is_not_explained(lab, planar2):
    # Known truth: a torque with the speed and the cosine of a position that no effect has, and white noise of 0.05 N m,
    # which is all that the sensors leave however little of the rest a predictor foresees.
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    torque = 2.0 * np.cos(6 * motion.q) * motion.v * [0.0, 1.0]
    found = diagnose(planar2, (lab.recording(planar2, motion, torque),))
    elbow = found.joints[1]
    assert elbow.noise_floor == pytest.approx(0.05 * np.sqrt(found.band_hz[1] / 100.0), rel=0.2)
    assert elbow.rms_after > 100.0 * elbow.noise_floor
    assert found.unexplained.joint == "elbow"
    assert found.verdict in {"unknown", "partly_explained"}


def test_the_order_of_joints_does_not_matter(lab, planar2, tmp_path):
    # The same arm whose file lists the elbow first; names and numbers stay with their joints.
    source = Path(planar2.source).read_text()
    joints = re.findall(r"  <joint .*?</joint>\n", source, flags=re.DOTALL)
    links = re.findall(r"  <link name=\"(?:upper|lower)\">.*?</link>\n", source, flags=re.DOTALL)
    turned = source.replace(joints[0] + joints[1], joints[1] + joints[0]).replace("".join(links), "".join(links[::-1]))
    assert turned != source
    file = tmp_path / "planar2.urdf"
    file.write_text(turned)
    other = load_robot(file)
    motion = lab.motion(2, 3)
    recording = lab.recording(planar2, motion, -0.3 * np.sign(motion.v) * [0.0, 1.0])
    order = [planar2.joint_names.index(name) for name in other.joint_names]
    moved = replace(recording, joint_names=other.joint_names, q=recording.q[:, order], tau=recording.tau[:, order])
    assert places(diagnose(other, (moved,))) == [("coulomb_friction", "elbow")]


def test_a_recording_that_is_too_short_to_hold_data_back_is_refused(lab, planar2):
    motion = lab.motion(2, 3, seconds=2.0)
    with pytest.raises(LogError, match=r"sim\.csv.* too short .*record at least ten seconds of motion"):
        diagnose(planar2, (lab.recording(planar2, motion),))


def test_warnings_of_robot_and_recording_are_passed_on_and_progress_is_announced_by_stage(lab, planar2):
    announced: list[Announcement] = []
    recording = replace(lab.recording(planar2, lab.motion(2)), warnings=("sim.csv: 3 repeated rows were dropped",))
    robot = replace(planar2, warnings=("planar2.urdf breaks the triangle inequality",))
    found = diagnose(robot, (recording,), progress=announced.append)
    assert found.data_warnings == (*robot.warnings, *recording.warnings)
    stages = [one.stage for one in announced]
    assert stages[0] is Stage.FILTERING
    assert Stage.NOISE in stages


def test_evidence_holds_the_samples_in_the_band(diagnosed):
    found = diagnosed(RUBBING)
    evidence = found.evidence
    assert evidence.tau_measured.shape == evidence.tau_after.shape == (len(evidence.t), 2)
    rest = (evidence.tau_measured - evidence.tau_after)[:, 1]
    assert np.sqrt(np.mean(rest**2)) == pytest.approx(found.joints[1].rms_after, rel=0.1)


def test_a_finding_where_the_file_states_forces_that_the_model_leaves_out_is_uncertain(planar2, lacking):
    recording = lacking(("coulomb_friction", "elbow", (0.3,)), ("coulomb_friction", "shoulder", (0.3,)))
    found = diagnose(replace(planar2, unmodelled=frozenset({"elbow"})), (recording,)).findings
    # 0.5 is the largest probability that docs/files.md states.
    assert {one.joint: one.probability for one in found} == {"elbow": 0.5, "shoulder": pytest.approx(1.0, abs=0.02)}
