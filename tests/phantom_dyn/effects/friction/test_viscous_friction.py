import numpy as np

from phantom_dyn.effects.friction.viscous_friction import ViscousFriction


def test_the_torque_is_minus_c_v(arm, operation):
    # Contract: -c v.
    torque = ViscousFriction().torque(arm, operation, "tilt", np.array([0.7]))
    np.testing.assert_array_equal(torque, np.column_stack([0 * operation.t, -0.7 * operation.v[:, 1], 0 * operation.t]))


def test_friction_takes_energy_out(arm, operation):
    torque = ViscousFriction().torque(arm, operation, "slide", np.array([3.0]))
    assert np.all(torque[:, 2] * operation.v[:, 2] < 0)


def test_a_coefficient_takes_away_what_is_modelled_at_most(arm):
    # A finding may say that there is less than modelled, never that the whole feeds energy.
    assert ViscousFriction().parameters(arm, "tilt")[0].lower == -arm.viscous_friction[1]
