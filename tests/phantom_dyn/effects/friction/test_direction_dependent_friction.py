import numpy as np
import pytest

from phantom_dyn.effects.friction.direction_dependent_friction import DirectionDependentFriction, two_way_law

THETA = np.array([0.5, 0.3, 0.11, 0.23])  # T+, T-, c+, c-


def test_the_torque_follows_the_law_of_its_direction(arm, operation):
    # Contract: -(T+ + c+ v) for v > 0, T- - c- v for v < 0.
    v = operation.v[:, 1]
    torque = DirectionDependentFriction().torque(arm, operation, "tilt", THETA)[:, 1]
    np.testing.assert_allclose(torque[v > 0], -(0.5 + 0.11 * v[v > 0]))
    np.testing.assert_allclose(torque[v < 0], 0.3 - 0.23 * v[v < 0])


def test_there_is_no_torque_at_rest(arm, operation):
    assert DirectionDependentFriction().torque(arm, operation, "turn", THETA)[0, 0] == 0.0


@pytest.mark.parametrize(("v", "torque"), [(2.0, -0.1 - 0.22), (-2.0, -0.1 + 0.46), (0.0, -0.1)])
def test_besides_the_mean_level_there_is_half_the_difference_and_the_slope_of_the_direction(v, torque):
    # By hand: half the difference of 0.5 and 0.3, and 0.11 or 0.23 times the speed.
    assert two_way_law(v, 0.1, 0.11, 0.23) == pytest.approx(torque)


def test_a_joint_at_rest_has_no_direction(arm, operation):
    # The first joint rests in the first state; what drags it either way needs a velocity.
    columns = DirectionDependentFriction().signature(arm, operation, "turn", ()).columns[:, 0]
    assert operation.v[0, 0] == 0.0
    assert not columns[0].any()
    np.testing.assert_array_equal(columns[1:, 0] + columns[1:, 1], np.sign(operation.v[1:, 0]))
