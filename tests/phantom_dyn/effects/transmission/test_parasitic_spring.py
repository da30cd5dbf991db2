from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.transmission.parasitic_spring import ParasiticSpring


def test_the_torque_is_minus_k_times_the_way_from_rest(arm, operation):
    # Contract: -k (q - q0).
    torque = ParasiticSpring().torque(arm, operation, "tilt", np.array([4.0, 0.25]))
    np.testing.assert_array_equal(torque[:, 1], -4.0 * (operation.q[:, 1] - 0.25))


def test_coefficients_give_stiffness_and_rest_position(arm, operation):
    effect = ParasiticSpring()
    theta = effect.from_coefficients(arm, "tilt", np.array([4.0, -1.0]), ())
    np.testing.assert_allclose(theta, [4.0, 0.25])
    columns = effect.signature(arm, operation, "tilt", ()).columns
    np.testing.assert_allclose(effect.torque(arm, operation, "tilt", theta)[:, 1], -columns[:, 0] @ [4.0, -1.0])


@pytest.mark.parametrize("coefficients", [(0.0, 0.0), (0.0, 1e5), (1e-310, -1e5)])
def test_a_spring_without_stiffness_has_a_finite_rest_position(arm, coefficients):
    theta = ParasiticSpring().from_coefficients(arm, "tilt", np.array(coefficients), ())
    assert np.all(np.isfinite(theta**2))


def test_a_spring_that_pushes_away_has_a_rest_position_too(arm):
    # By hand: -4 (q - 0.25) = -4 q + 1.
    theta = ParasiticSpring().from_coefficients(arm, "tilt", np.array([-4.0, 1.0]), ())
    np.testing.assert_allclose(theta, [-4.0, 0.25])


def test_a_spring_is_probed_and_sized_about_the_posture(arm, operation):
    # By hand: one unit of stiffness at rest in the mean position.
    name, direction = ParasiticSpring().probe(arm, operation, "tilt")
    assert name == "stiffness"
    np.testing.assert_allclose(direction, [1.0, -operation.q[:, 1].mean()])
    assert ParasiticSpring().sized(arm, "tilt", "stiffness", 3.0, np.array([0.1, 0.2, 0.3])) == (3.0, 0.2)


def test_a_spring_pulls_back_to_any_position(arm):
    assert ParasiticSpring().coefficient_bounds(arm, "tilt", ()) == ((0.0, np.inf), (-np.inf, np.inf))
