from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from phantom_dyn.effects.load.payload import Payload
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.inertia import payload_body, point_mass_parameters
from phantom_dyn.model.robot import Robot

THETA = np.array([0.8, 0.1, -0.05, 0.2])  # kg, m


def added_torque(robot: Robot, operation: Operation, joint: str, inertia: pin.Inertia) -> np.ndarray:
    """Pinocchio: torque that a body more on a joint adds."""
    loaded = robot.model.copy()
    loaded.appendBodyToJoint(loaded.getJointId(joint), inertia, pin.SE3.Identity())

    def needed(model: pin.Model) -> np.ndarray:
        data = model.createData()
        states = zip(operation.q, operation.v, operation.a, strict=True)
        return np.array([pin.rnea(model, data, *state) for state in states])

    return needed(loaded) - needed(robot.model)


def test_the_torque_is_minus_what_a_point_mass_more_needs(arm, operation):
    point = pin.Inertia(0.8, np.array([0.1, -0.05, 0.2]), np.zeros((3, 3)))
    expected = -added_torque(arm, operation, "slide", point)
    np.testing.assert_allclose(Payload().torque(arm, operation, None, THETA), expected, atol=1e-12)


def test_a_payload_frame_says_which_link_carries_it(arm, operation):
    loaded = replace(arm, payload_frame="beam")
    point = pin.Inertia(0.8, np.array([0.1, -0.05, 0.2]), np.zeros((3, 3)))
    expected = -added_torque(arm, operation, "tilt", point)
    assert payload_body(loaded) == 2
    np.testing.assert_allclose(Payload().torque(loaded, operation, None, THETA), expected, atol=1e-12)


def test_ten_parameters_of_a_point_mass_are_those_of_pinocchio():
    point = pin.Inertia(0.8, np.array([0.1, -0.05, 0.2]), np.zeros((3, 3)))
    np.testing.assert_allclose(point_mass_parameters(0.8, THETA[1:]), point.toDynamicParameters(), atol=1e-15)


def test_columns_of_a_point_mass_give_its_torque(arm, operation):
    columns = Payload().signature(arm, operation, None, ()).columns
    coefficients = point_mass_parameters(THETA[0], THETA[1:])
    np.testing.assert_allclose(Payload().torque(arm, operation, None, THETA), -columns @ coefficients, atol=1e-12)


def test_coefficients_give_mass_and_center(arm):
    coefficients = point_mass_parameters(THETA[0], THETA[1:])
    np.testing.assert_allclose(Payload().from_coefficients(arm, None, coefficients, ()), THETA)


def test_parameters_are_a_mass_and_a_place(arm):
    parameters = Payload().parameters(arm, None)
    assert [(p.name, p.unit) for p in parameters] == [
        ("mass", "kg"),
        ("center_x", "m"),
        ("center_y", "m"),
        ("center_z", "m"),
    ]


def test_no_mass_has_a_finite_center(arm):
    assert np.all(np.isfinite(Payload().from_coefficients(arm, None, np.zeros(10), ())))


def test_a_mass_straight_below_its_joint_has_first_moments_of_zero_across(arm):
    # By hand: 0.5 kg, 0.3 m down: first moments 0, 0, -0.15 kg m.
    coefficients = np.array([0.5, 0.0, 0.0, -0.15, *np.zeros(6)])
    np.testing.assert_allclose(Payload().from_coefficients(arm, None, coefficients, ()), [0.5, 0.0, 0.0, -0.3])


def test_less_mass_than_modelled_has_a_center_too(arm):
    # By hand: -0.5 kg at 0.3 m.
    coefficients = np.array([-0.5, -0.15, 0.0, 0.15, *np.zeros(6)])
    np.testing.assert_allclose(Payload().from_coefficients(arm, None, coefficients, ()), [-0.5, 0.3, 0.0, -0.3])


def test_a_payload_is_probed_and_sized_at_the_center_of_the_last_link(arm, operation):
    center = arm.model.inertias[3].lever
    name, direction = Payload().probe(arm, operation, None)
    assert name == "mass"
    np.testing.assert_allclose(direction, pin.Inertia(1.0, center, np.zeros((3, 3))).toDynamicParameters(), atol=1e-15)
    assert Payload().sized(arm, None, "mass", 0.7, np.zeros(3)) == (0.7, *center)
