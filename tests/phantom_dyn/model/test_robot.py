from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from phantom_dyn import load_robot
from places import ROBOTS

PENDULUM = ROBOTS / "pendulum.urdf"


def test_the_model_is_a_private_copy():
    first = load_robot(PENDULUM)
    second = dataclasses.replace(first)
    first.model.armature[0] = 3.0
    assert second.model.armature[0] == 0.0


@pytest.mark.parametrize("name", ["viscous_friction", "coulomb_friction", "prismatic"])
def test_arrays_cannot_be_written_to(name):
    with pytest.raises(ValueError, match="read-only"):
        getattr(load_robot(PENDULUM), name)[0] = 1


def test_the_configuration_of_a_continuous_joint_is_cosine_and_sine():
    robot = load_robot("example:double_pendulum_continuous")
    q = robot.configuration(np.array([[0.3, -0.4]]))
    np.testing.assert_allclose(q, [[np.cos(0.3), np.sin(0.3), np.cos(-0.4), np.sin(-0.4)]])
