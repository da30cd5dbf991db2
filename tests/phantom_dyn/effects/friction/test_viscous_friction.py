import numpy as np

from phantom_dyn.effects.friction.viscous_friction import ViscousFriction


def test_the_torque_is_minus_c_v(arm, operation):
    # Contract: -c v.
    torque = ViscousFriction().torque(arm, operation, "tilt", np.array([0.7]))
    np.testing.assert_array_equal(torque, np.column_stack([0 * operation.t, -0.7 * operation.v[:, 1], 0 * operation.t]))
