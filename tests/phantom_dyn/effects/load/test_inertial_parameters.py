import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.effects.load.inertial_parameters import InertialParameters, bodies_of
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot import Robot

EFFECT = InertialParameters()


def torque_of_changed(robot: Robot, operation: Operation, changes: dict[str, np.ndarray]) -> np.ndarray:
    """Pinocchio: what the given model needs less what one with changed bodies needs."""
    changed = robot.model.copy()
    for joint, change in changes.items():
        index = changed.getJointId(joint)
        changed.inertias[index] = pin.Inertia.FromDynamicParameters(
            robot.model.inertias[index].toDynamicParameters() + change
        )

    def needed(model: pin.Model) -> np.ndarray:
        data = model.createData()
        states = zip(operation.q, operation.v, operation.a, strict=True)
        return np.array([pin.rnea(model, data, *state) for state in states])

    return needed(robot.model) - needed(changed)


def test_the_torque_of_one_link_is_minus_what_its_changes_need(arm, operation, rng):
    change = 0.01 * rng.normal(size=10)
    expected = torque_of_changed(arm, operation, {"tilt": change})
    np.testing.assert_allclose(EFFECT.torque(arm, operation, "tilt", change), expected, atol=1e-12)


def test_without_a_joint_every_link_may_change(arm, operation, rng):
    changes = dict(zip(arm.joint_names, 0.01 * rng.normal(size=(3, 10)), strict=True))
    expected = torque_of_changed(arm, operation, changes)
    theta = np.concatenate(list(changes.values()))
    np.testing.assert_allclose(EFFECT.torque(arm, operation, None, theta), expected, atol=1e-12)


def test_names_say_link_and_parameter(arm):
    names = [p.name for p in EFFECT.parameters(arm, None)]
    assert len(set(names)) == 30
    assert [p.unit for p in EFFECT.parameters(arm, "tilt")] == ["kg", *["kg m"] * 3, *["kg m^2"] * 6]


def test_the_probe_is_one_kilogram_at_the_center_of_the_last_free_link(arm, operation):
    name, direction = EFFECT.probe(arm, operation, None)
    assert name == EFFECT.parameters(arm, None)[20].name
    point = pin.Inertia(1.0, arm.model.inertias[3].lever, np.zeros((3, 3)))
    np.testing.assert_allclose(direction, [*np.zeros(20), *point.toDynamicParameters()], atol=1e-15)


def test_bodies_of_an_unknown_joint_are_refused(arm):
    with pytest.raises(RobotError, match=r"No joint 'knee' in this robot: its joints are turn, tilt, slide\."):
        bodies_of(arm, "knee")
