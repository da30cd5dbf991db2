"""Next experiments of a five-bar, whose loop is closed numerically."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.signals import low_pass
from identification.diagnosis.explanation import Explanation
from identification.diagnosis.noise.noise_floor import estimate_noise
from identification.diagnosis.result import EffectAt, Finding, Rival
from identification.excitation.closable import CLEAR
from identification.next_experiment.advise import proposed
from identification.next_experiment.candidates import candidates, design_of, exciting, safe_limits
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.loops.singularity import distance_from_singularity
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS


@pytest.fixture(scope="module")
def five_bar() -> Robot:
    return load_robot(ROBOTS / "fivebar.xml")


def swinging(robot: Robot, reach: float) -> Log:
    """Both arms swing as sines of 0.5 and 0.4 Hz about the start."""
    t, w = np.arange(2000) / 200.0, np.pi * np.array([1.0, 0.8])
    angle = t[:, None] * w
    motion = Motion(t, reach * np.sin(angle), reach * w * np.cos(angle), -reach * w**2 * np.sin(angle))
    tau = inverse_dynamics(robot, motion)
    return Log("swing.csv", robot.joint_names, motion, tau, low_pass(20.0, 200.0), np.ones(len(t), dtype=bool))


def distances(robot: Robot, motion: Motion) -> np.ndarray:
    return distance_from_singularity(robot.solutions.at(motion.q).inverse)


@pytest.mark.nightly
@pytest.mark.whole
def test_every_candidate_closes_the_loop_and_stays_clear_of_a_singularity(five_bar, rng):
    limits = safe_limits(five_bar, (swinging(five_bar, 0.8),))
    problem = design_of(five_bar, limits)
    drawn = candidates(problem, duration=8.0, count=8, rng=rng)
    assert len(drawn) == 8
    for one in (*drawn, exciting(problem, 8.0, rng)):
        motion = one.motion(300.0)
        assert distances(five_bar, motion).min() > limits.clear - 0.01
        assert (np.abs(inverse_dynamics(five_bar, motion)) < 1.05 * limits.torque).all()


def test_a_robot_that_was_recorded_nearer_to_a_singularity_may_go_there_again(five_bar):
    near = swinging(five_bar, 0.1)
    q = near.motion.q * [11.0, -11.0]
    near = Log("near.csv", near.joint_names, Motion(near.motion.t, q, 0 * q, 0 * q), near.tau, near.band, near.valid)
    found = float(distances(five_bar, near.motion).min())
    assert 0.02 < found < CLEAR - 0.02
    assert safe_limits(five_bar, (near,)).clear == pytest.approx(found)
    assert safe_limits(five_bar, (swinging(five_bar, 0.3),)).clear == CLEAR


@pytest.mark.whole
def test_friction_of_a_passive_joint_is_separated_from_that_of_a_drive(lab, five_bar):
    motion = lab.motion(2, 3, swing=0.3)
    torque = lab.acting(five_bar, motion, "coulomb_friction", "left_elbow", 0.02)
    ready = lab.prepared(five_bar, (lab.recording(five_bar, motion, torque, noise=0.02),))
    noise = estimate_noise(ready.session, ready.columns)[0]
    chosen = frozenset([ready.term("coulomb_friction", "left_elbow")])
    rivals = (Rival((EffectAt("coulomb_friction", "left"),), 0.3),)
    finding = Finding("coulomb_friction", "left_elbow", "everywhere", {}, 0.8, (0.7, 0.9), 0.7, rivals, "one_of")
    found = proposed(Explanation(ready.search, chosen, noise), (finding,))
    assert found.experiment is not None
    assert found.experiment["separates"] == [["coulomb_friction", "left_elbow"], ["coulomb_friction", "left"]]
    assert distances(five_bar, found.motion).min() > CLEAR - 0.01
