"""A Delta robot, whose loops are closed numerically, from a recording to what it lacks. Oracle: the effect that was
simulated."""

import numpy as np
import pytest

import phantom_dyn as dyn
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS

pytestmark = pytest.mark.whole


@pytest.fixture(scope="module")
def delta() -> Robot:
    return dyn.load_robot(ROBOTS / "delta.xml", config=ROBOTS / "delta.yaml")


def diagnosed(delta: Robot, effects: list):
    """Diagnosis of eight seconds of sines in all three drives."""
    t = np.arange(0, 8, 0.008)
    speed, k = np.array([0.9, 1.3, 1.7]), np.arange(3)
    q = 0.35 * np.sin(np.outer(t, speed)) + 0.2 * (np.sin(np.outer(t, 2.9 * speed) + k) - np.sin(k))
    v = np.gradient(q, t, axis=0)
    robot = dyn.simulate(delta, Motion(t, q, v, np.gradient(v, t, axis=0)), effects=effects)
    return dyn.diagnose(delta, robot.recording(position_noise=1e-6, torque_noise=0.005))


@pytest.mark.nightly
def test_a_delta_as_modelled_has_no_gap(delta):
    assert diagnosed(delta, []).verdict == "no_gap"


def test_a_load_on_the_platform_is_found_with_its_mass(delta):
    load = ("payload", None, {"mass": 0.3, "center_x": 0.0, "center_y": 0.0, "center_z": 0.0})
    (finding,) = diagnosed(delta, [load]).findings
    assert finding.effect == "payload"
    assert finding.parameters["mass"].value == pytest.approx(0.3, abs=0.03)


@pytest.mark.nightly
def test_friction_of_a_passive_joint_is_found_there(delta):
    (finding,) = diagnosed(delta, [("coulomb_friction", "swing0", {"torque": 0.05})]).findings
    assert (finding.effect, finding.joint) == ("coulomb_friction", "swing0")
    assert finding.parameters["torque"].value == pytest.approx(0.05, abs=0.002)
