"""Positions more than a turn outside the range of their joint."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.checks.beyond_range import beyond_range
from identification.data.checks.check_recording import checked
from phantom_dyn.model.loading import load_robot
from places import ROBOTS


@pytest.fixture(scope="module")
def arm3():
    return load_robot(ROBOTS / "arm3.urdf")


def moved(recording, joint, shift):
    way = np.zeros(recording.q.shape[1])
    way[joint] = shift
    return replace(recording, q=recording.q + way)


@pytest.mark.parametrize("shift", [11.0, -11.0])
def test_a_joint_more_than_a_turn_outside_its_range_is_wrong_without_any_torque(clean, arm3, shift):
    recording = replace(moved(clean(robot=arm3), 1, shift), tau=None)
    (fault,) = checked(recording, arm3).wrong
    assert f"positions of {arm3.joint_names[1]} are where it cannot be" in fault.what
    assert "more than a turn outside" in fault.why


def test_degrees_that_are_inside_when_converted_get_their_entry(clean, arm3):
    recording = clean(robot=arm3)
    degrees = replace(recording, q=recording.q * [1.0, 180 / np.pi, 1.0], tau=None)
    name = arm3.joint_names[1]
    assert f"q.{name}: {{from: q.{name}, unit: deg}}" in checked(degrees, arm3).wrong[0].mend


@pytest.mark.parametrize("turns", [-2, 1, 3])
def test_an_encoder_that_counts_turns_is_not_wrong(clean, arm3, turns):
    assert beyond_range(moved(clean(robot=arm3), 1, 2 * np.pi * turns), arm3) == ()


@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_a_joint_less_than_a_turn_outside_is_left_to_other_checks(clean, arm3, shift):
    assert beyond_range(moved(clean(robot=arm3), 1, shift), arm3) == ()


def test_a_joint_without_a_range_may_turn_many_times(clean):
    robot = load_robot("example:ur5")
    free = replace(robot, model=robot.model)
    free.model.lowerPositionLimit[:], free.model.upperPositionLimit[:] = -np.inf, np.inf
    assert beyond_range(moved(clean(robot=free), 0, 40.0), free) == ()
