import numpy as np
import pytest

from phantom_dyn.effects.friction.stribeck_friction import StribeckFriction, falling_law
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

THETA = np.array([0.4, 0.9, 0.2])  # Tc, Ts, vs


def at_speed(arm: Robot, v: float) -> Operation:
    return Operation.of(arm, Motion(np.zeros(1), np.zeros((1, 3)), np.array([[0.0, v, 0.0]]), np.zeros((1, 3))))


def test_the_torque_follows_the_contract(arm, operation):
    # Contract: -(Tc + (Ts - Tc) exp(-(v/vs)^2)) s.
    v = operation.v[:, 1]
    expected = -(0.4 + (0.9 - 0.4) * np.exp(-((v / 0.2) ** 2))) * np.sign(v)
    np.testing.assert_allclose(StribeckFriction().torque(arm, operation, "tilt", THETA)[:, 1], expected)


def test_there_is_no_torque_at_rest(arm):
    assert StribeckFriction().torque(arm, at_speed(arm, 0.0), "tilt", THETA)[0, 1] == 0.0


def test_velocities_that_are_tried_go_from_a_fiftieth_to_half_of_top_speed(arm, operation):
    shapes = StribeckFriction().shapes(arm, operation, "tilt")
    top = np.percentile(np.abs(operation.v[:, 1]), 99)
    assert shapes[0][0] == pytest.approx(0.02 * top)
    assert shapes[-1][0] == pytest.approx(0.5 * top)
    assert list(shapes) == sorted(shapes)


def test_a_joint_at_rest_has_velocities_to_try_too(arm):
    velocities = [velocity for (velocity,) in StribeckFriction().shapes(arm, at_speed(arm, 0.0), "tilt")]
    assert velocities
    assert min(velocities) > 0


@pytest.mark.parametrize(
    ("v", "less"), [(0.2, 0.5 * (1 - 1 / np.e)), (-0.2, -0.5 * (1 - 1 / np.e)), (0.0, 0.0), (9.0, 0.5)]
)
def test_what_friction_falls_by_grows_with_speed(v, less):
    # Closed form: (Ts - Tc) (1 - exp(-(v / vs)^2)) in the direction of motion.
    assert falling_law(v, 0.5, 0.2) == pytest.approx(less)
