from __future__ import annotations

import numpy as np

from phantom_dyn.effects.viscous_friction import ViscousFriction


def test_the_torque_is_minus_c_v(arm, motion):
    # Contract: -c v.
    torque = ViscousFriction().torque(arm, motion, "tilt", np.array([0.7]))
    np.testing.assert_array_equal(torque, np.column_stack([0 * motion.t, -0.7 * motion.v[:, 1], 0 * motion.t]))


def test_friction_takes_energy_out(arm, motion):
    torque = ViscousFriction().torque(arm, motion, "slide", np.array([3.0]))
    assert np.all(torque[:, 2] * motion.v[:, 2] < 0)


def test_a_negative_coefficient_is_out_of_bounds(arm):
    assert ViscousFriction().parameters(arm, "tilt")[0].lower == 0.0
