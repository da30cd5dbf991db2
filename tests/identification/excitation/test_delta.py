# pyright: reportAttributeAccessIssue=false
"""A Delta robot: linear loops that keep its platform level, numerical ones that close two of its legs."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from identification.excitation.closable import CLEAR, ordinary_postures
from identification.excitation.excite import excite
from identification.excitation.limits import limits_of
from identification.excitation.motion_shapes import FourierSeries
from phantom_dyn import load_robot
from phantom_dyn.loops.singularity import distance_from_singularity
from phantom_dyn.model.robot import Robot
from places import ROBOTS

# Base, platform, arm and rod [m].
BASE, PLATFORM, ARM, ROD = 0.15, 0.05, 0.2, 0.4


@pytest.fixture(scope="module")
def delta() -> Robot:
    return load_robot(ROBOTS / "delta.xml", config=ROBOTS / "delta.yaml")


def platform(robot: Robot, posture: np.ndarray) -> pin.SE3:
    """Place of the platform's centre."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, robot.configuration(posture[None])[0])
    return data.oMf[robot.model.getFrameId("tip")]


def test_three_drives_move_a_delta(delta):
    assert delta.joint_names == ("drive0", "drive1", "drive2")
    assert len(delta.passive_names) == 8


def test_the_platform_is_a_rod_away_from_each_elbow_and_level(delta):
    # Closed form of a Delta: circles of the elbows about the base, moved inwards by the platform.
    for posture in ordinary_postures(delta, 20):
        place = platform(delta, posture)
        np.testing.assert_allclose(place.rotation, np.eye(3), atol=1e-9)
        for k, angle in enumerate(posture):
            out = np.array([np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3), 0.0])
            elbow = (BASE - PLATFORM + ARM * np.cos(angle)) * out - ARM * np.sin(angle) * np.array([0.0, 0.0, 1.0])
            assert np.linalg.norm(place.translation - elbow) == pytest.approx(ROD, abs=1e-6)


@pytest.mark.nightly
@pytest.mark.whole
def test_an_exciting_motion_of_a_delta_stays_clear_of_a_singularity(delta):
    limits = limits_of(delta, velocity=3.0, acceleration=40.0)
    design = excite(delta, FourierSeries(4.0, 2), limits=limits, starts=2)
    motion = design.motion(300.0)
    assert distance_from_singularity(delta.solutions.at(motion.q).inverse).min() >= CLEAR
    assert np.abs(motion.v).max() <= 3.0
    assert design.condition < 0.5 * design.start
