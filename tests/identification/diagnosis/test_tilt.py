# pyright: reportAttributeAccessIssue=false
"""Bases that stand tilted where gravity points along -y, as on the built-in haptic devices."""

import numpy as np
import pinocchio as pin
import pytest

import phantom_dyn as dyn
from by_night import by_night
from identification.diagnosis.result import Diagnosis
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.support.changed_robot import with_gravity
from phantom_dyn.model.robot import Robot

NOISE = 2e-4  # N m, a hundredth of the torque


@pytest.fixture(scope="module")
def phantom() -> Robot:
    robot = load_robot("phantom_1_5")
    np.testing.assert_array_equal(robot.model.gravity.linear, [0.0, -9.81, 0.0])
    return robot


def of_turned(robot: Robot, turn: tuple[float, float, float], lab, seed: int = 3) -> Diagnosis:
    """The diagnosis of a recording under gravity that is turned in the base; oracle for the turn: Pinocchio."""
    motion = lab.motion(robot.nv, seed, seconds=20.0, swing=0.8)
    there = with_gravity(robot, pin.exp3(np.array(turn)) @ robot.model.gravity.linear)
    lacking = inverse_dynamics(robot, motion) - inverse_dynamics(there, motion)
    return dyn.diagnose(robot, lab.recording(robot, motion, lacking, noise=NOISE, seed=seed))


@pytest.mark.whole
@pytest.mark.parametrize("turn", by_night([((0.08, 0.0, -0.05),), ((0.0, 0.0, 0.1),), ((0.1, 0.0, 0.0),)], 0))
def test_a_tilt_about_the_two_horizontal_axes_is_recovered_within_its_interval(phantom, lab, turn):
    first = of_turned(phantom, turn, lab).findings[0]
    assert (first.effect, first.joint) == ("base_tilt", None)
    for name, truth in zip(("roll", "yaw"), turn[::2], strict=True):
        found = first.parameters[name]
        assert abs(found.value - truth) < 2.5 * found.std < 0.01
    assert first.parameters["pitch"].value == 0.0


@pytest.mark.whole
def test_a_turn_about_gravity_is_no_gap_and_nothing_is_claimed(phantom, lab):
    diagnosis = of_turned(phantom, (0.0, 0.3, 0.0), lab)
    assert diagnosis.verdict == "no_gap"
    assert not diagnosis.findings
    # What would have been seen is a tilt about a horizontal axis.
    (bound,) = [bound for bound in diagnosis.bounds if bound.effect == "base_tilt"]
    assert bound.parameter in ("roll", "yaw")


@pytest.mark.whole
def test_a_tilt_about_the_axis_of_a_first_joint_is_reported_with_the_offset_of_its_encoder(lab):
    # Closed form: the first joint of the CEA branch turns about z, across gravity; its zero and the base turn alike.
    first = of_turned(load_robot("cea_branch"), (0.0, 0.0, 0.1), lab).findings[0]
    said = {(first.effect, first.joint)} | {(one.effect, one.joint) for rival in first.rivals for one in rival.effects}
    assert {("encoder_offset", "q1"), ("base_tilt", None)} <= said
    assert first.verdict == "one_of"
