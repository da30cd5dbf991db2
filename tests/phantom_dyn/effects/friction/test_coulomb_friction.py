import numpy as np

from phantom_dyn.effects.friction.coulomb_friction import CoulombFriction


def test_the_torque_is_minus_t_in_the_direction_of_motion(arm, operation):
    # Contract: -T s.
    torque = CoulombFriction().torque(arm, operation, "tilt", np.array([0.7]))[:, 1]
    np.testing.assert_array_equal(torque[operation.v[:, 1] > 0], -0.7)
    np.testing.assert_array_equal(torque[operation.v[:, 1] < 0], 0.7)


def test_there_is_no_torque_at_rest(arm, operation):
    assert CoulombFriction().torque(arm, operation, "turn", np.array([0.7]))[0, 0] == 0.0
