"""Samples behind the figures of a report, computed again from the finding's own law, Pinocchio and the motion."""

# pyright: reportAttributeAccessIssue=false
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.result import Diagnosis
from identification.pipeline import diagnose
from phantom_dyn.motion import Motion

ROTOR = 0.05  # kg m^2
# What the arm has and its model lacks. Neither looks like a torque that is late, which may move in any model.
LACKS = {"torque_offset": ("shoulder", (0.8,)), "parasitic_spring": ("elbow", (3.0, 0.2))}


@pytest.fixture(scope="module")
def arm(planar2, trusted):
    """The planar arm, trusted exactly, with a rotor on its elbow."""
    model = planar2.model.copy()
    model.armature = np.array([0.0, ROTOR])
    return trusted(replace(planar2, model=model))


@pytest.fixture(scope="module")
def found(lab, arm) -> Diagnosis:
    """Two recordings with an offset on the shoulder and a spring on the elbow."""

    def recorded(seed):
        motion = lab.motion(2, seed, swing=1.5)
        lacks = sum(lab.acting(arm, motion, effect, joint, *theta) for effect, (joint, theta) in LACKS.items())
        return lab.recording(arm, motion, lacks, seed=seed)

    return diagnose(arm, (recorded(3), recorded(4)))


@pytest.fixture(scope="module")
def evidence(found) -> Evidence:
    return found.evidence


def motion_of(evidence: Evidence) -> Motion:
    return Motion(evidence.t, evidence.q, evidence.v, evidence.a)


def links_alone(robot, evidence: Evidence) -> np.ndarray:
    """Pinocchio's inverse dynamics of the model without its rotors; it knows no friction."""
    model = robot.model.copy()
    model.armature = np.zeros(robot.nv)
    data = model.createData()
    return np.array([pin.rnea(model, data, *row) for row in zip(evidence.q, evidence.v, evidence.a, strict=True)])


def assert_close(found: np.ndarray, wanted: np.ndarray, share: float):
    """Root mean square of the difference within a share of what is wanted on the joint that has most."""
    size = np.sqrt(np.mean(wanted**2, axis=0))
    off = np.sqrt(np.mean((found - wanted) ** 2, axis=0))
    np.testing.assert_array_less(off, share * size.max() + 1e-12)


def test_all_samples_share_their_first_axis(evidence):
    shape = (len(evidence.t), 2)
    names = ("q", "v", "a", "tau_measured", "tau_before", "tau_after", "tau_transmitted")
    assert {name: getattr(evidence, name).shape for name in names} == dict.fromkeys(names, shape)
    assert [torque.shape for torque in evidence.tau_without] == [shape, shape]


def test_recordings_follow_each_other_with_a_second_between(evidence):
    steps = np.diff(evidence.t)
    assert steps.max() == pytest.approx(1.0)
    assert (steps > 0).all()
    assert (steps > 1.5 * np.median(steps)).sum() == 1


def test_what_a_finding_explains_is_the_step_from_the_model_without_it(lab, arm, found, evidence):
    # Known truth: nothing else moves in a trusted model, so the drive lacks just the finding's torque.
    assert {f.effect: f.joint for f in found.findings} == {effect: joint for effect, (joint, _) in LACKS.items()}
    for finding, without in zip(found.findings, evidence.tau_without, strict=True):
        joint, theta = LACKS[finding.effect]
        acting = lab.acting(arm, motion_of(evidence), finding.effect, joint, *theta)
        assert_close(evidence.tau_after - without, -acting, 0.05)


def test_the_model_without_all_findings_is_the_given_one(evidence):
    # What each of the two findings adds is added to the given model, once.
    added = sum(evidence.tau_after - without for without in evidence.tau_without)
    assert_close(evidence.tau_before + added, evidence.tau_after, 0.01)


def test_the_transmitted_torque_is_that_of_the_links_without_rotor_and_friction(arm, evidence):
    # The filter of the band has less to go by at either end of a recording.
    half = int(np.argmax(np.diff(evidence.t))) + 1
    inner = np.r_[10 : half - 10, half + 10 : len(evidence.t) - 10]
    assert_close(evidence.tau_transmitted[inner], links_alone(arm, evidence)[inner], 0.01)


def test_the_given_model_has_rotor_and_friction_beside_the_transmitted_torque(arm, evidence):
    # Closed form: I a + c v + T sign(v); the sign is smeared by the filter of the band, so near reversals is left out.
    own = arm.rotor_inertia * evidence.a + arm.viscous_friction * evidence.v
    own = own + arm.coulomb_friction * np.sign(evidence.v)
    fast = (np.abs(evidence.v) > 0.5 * np.abs(evidence.v).max(axis=0)).all(axis=1)
    assert fast.sum() > 20
    assert_close((evidence.tau_before - evidence.tau_transmitted)[fast], own[fast], 0.05)


@pytest.mark.parametrize(("regime", "share"), [("high_speed", 0.6), ("high_acceleration", 0.6)])
def test_times_of_a_regime_are_the_share_of_the_samples_in_it(evidence, regime, share):
    # The contract of the regimes: beyond 0.6 of what 95 % of the samples stay below.
    moved = np.abs(evidence.v if regime == "high_speed" else evidence.a)
    half = np.argmax(np.diff(evidence.t)) + 1  # limits belong to a recording
    parts = (moved[:half], moved[half:])
    inside = np.concatenate([part > share * np.percentile(part, 95, axis=0) for part in parts])
    assert [times[regime] for times in evidence.regime_times] == pytest.approx(inside.mean(axis=0), abs=0.02)


def test_shares_of_a_regime_are_those_of_the_squared_gap_in_it(evidence):
    gap = (evidence.tau_measured - evidence.tau_before) ** 2
    half = np.argmax(np.diff(evidence.t)) + 1
    speed = np.abs(evidence.v)
    inside = np.concatenate([s > 0.6 * np.percentile(s, 95, axis=0) for s in (speed[:half], speed[half:])])
    wanted = (gap * inside).sum(axis=0) / gap.sum(axis=0)
    assert [shares["high_speed"] for shares in evidence.regime_shares] == pytest.approx(wanted, abs=0.02)


def test_times_have_the_regimes_of_the_shares_and_lie_between_none_and_all(evidence):
    assert [set(times) for times in evidence.regime_times] == [set(shares) for shares in evidence.regime_shares]
    assert all(0.0 <= time <= 1.0 for times in evidence.regime_times for time in times.values())


def test_what_is_left_of_the_corrected_model_is_noise(found, evidence):
    left = np.sqrt(np.mean((evidence.tau_measured - evidence.tau_after) ** 2, axis=0))
    assert left == pytest.approx([joint.noise_floor for joint in found.joints], rel=0.2)


def test_the_gap_that_is_left_on_a_joint_is_what_the_corrected_model_leaves(found, evidence):
    left = np.sqrt(np.mean((evidence.tau_measured - evidence.tau_after) ** 2, axis=0))
    assert [joint.rms_after for joint in found.joints] == pytest.approx(left, rel=0.1)


def test_the_sample_period_is_that_of_the_recordings(evidence):
    assert evidence.sample_period == pytest.approx(1.0 / 200.0)
