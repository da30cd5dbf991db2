from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.drive.torque_constant import TorqueConstant


@pytest.mark.parametrize("ratio", [0.6, 1.0, 1.7])
def test_the_true_torque_is_ratio_times_the_logged_one(arm, operation, ratio):
    # Contract: true torque = ratio * tau. What is logged is what the motion needs less what the effect gives.
    needed = inverse_dynamics(arm, operation)
    logged = needed - TorqueConstant().torque(arm, operation, "tilt", np.array([ratio]))
    np.testing.assert_allclose(ratio * logged[:, 1], needed[:, 1])


def test_other_joints_are_logged_right(arm, operation):
    assert np.all(TorqueConstant().torque(arm, operation, "tilt", np.array([0.7]))[:, [0, 2]] == 0)


@pytest.mark.parametrize("ratio", [0.6, 1.0, 1.7])
def test_the_coefficient_is_the_relative_excess_of_the_logged_torque(arm, operation, ratio):
    effect = TorqueConstant()
    coefficient = np.array([1 / ratio - 1])
    assert effect.from_coefficients(arm, "tilt", coefficient, ()) == pytest.approx(np.array([ratio]))
    columns = effect.signature(arm, operation, "tilt", ()).columns
    torque = effect.torque(arm, operation, "tilt", np.array([ratio]))[:, 1]
    np.testing.assert_allclose(torque, -columns[:, 0] @ coefficient, atol=1e-12)
