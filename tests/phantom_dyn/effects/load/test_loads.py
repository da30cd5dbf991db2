"""Loads: a payload, and other inertial parameters."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from phantom_dyn.effects.load.inertial_parameters import InertialParameters
from phantom_dyn.effects.load.payload import Payload, carrying, most_removed
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.inertia import payload_body, point_mass_parameters
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from pinocchio_torque import pinocchio_torque
from places import ROBOTS

THETA = np.array([0.8, 0.1, -0.05, 0.2])  # kg, m


def added_torque(robot: Robot, operation: Operation, joint: str, inertia: pin.Inertia) -> np.ndarray:
    """Pinocchio: torque that a body more on a joint adds."""
    loaded = robot.model.copy()
    loaded.appendBodyToJoint(loaded.getJointId(joint), inertia, pin.SE3.Identity())
    return pinocchio_torque(loaded, operation) - pinocchio_torque(robot.model, operation)


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


def test_less_mass_than_modelled_has_a_center_too(arm):
    # By hand: a tenth of the link's mass less, at its centre.
    link = arm.model.inertias[3]
    mass = -0.1 * link.mass
    coefficients = np.array([mass, *(mass * link.lever), *np.zeros(6)])
    found = Payload().from_coefficients(arm, None, coefficients, ())
    np.testing.assert_allclose(found, [mass, *link.lever], atol=1e-12)


def test_a_mass_that_hardly_shows_has_its_center_within_reach(arm):
    # By hand: first moments of 0.3 kg m need 0.1 kg at three metres.
    found = Payload().from_coefficients(arm, None, np.array([1e-300, 0.0, 0.3, 0.0, *np.zeros(6)]), ())
    np.testing.assert_allclose(found, [0.1, 0.0, 3.0, 0.0])


@pytest.mark.parametrize("center", [(0.0, 0.0, 0.0), (0.1, 0.0, -0.2), (0.4, 0.1, 0.3)])
def test_what_can_be_taken_leaves_a_pseudo_inertia_without_negative_part(arm, center):
    # Oracle: the smallest eigenvalue of what is left, which is zero at the limit.
    link = arm.model.inertias[3]
    least = most_removed(arm, np.array(center))
    left = pin.PseudoInertia.FromInertia(link).toMatrix()
    point = np.array([*center, 1.0])
    for share, possible in ((0.98, True), (1.02, least > 0.99 * link.mass)):
        rest = np.linalg.eigvalsh(left - share * least * np.outer(point, point))
        assert (rest[0] > -1e-9) == possible


def test_a_mass_that_hardly_shows_is_stated_by_first_moments(arm):
    law = Payload().stated_law(arm, None, (), np.array([0.02, 0.01, 0.01, 0.01]), np.array([0.15, 0.3, 0.0, 0.1]))
    assert [p.name for p in law[0]] == ["mass", "moment_x", "moment_y", "moment_z"]
    np.testing.assert_array_equal(law[1](np.array([0.15, 0.3, 0.0, 0.1])), [0.15, 0.3, 0.0, 0.1])
    read = Payload().from_stated(arm, {"mass": 0.15, "moment_x": 0.3, "moment_y": 0.0, "moment_z": 0.1})
    assert read == pytest.approx({"mass": 0.15, "center_x": 2.0, "center_y": 0.0, "center_z": 0.1 / 0.15})


def test_a_mass_that_shows_is_stated_with_its_center(arm):
    # By hand: its interval of 95 % is 3.92 deviations wide, a half of 0.15 kg at a deviation of 0.019 kg.
    law = Payload().stated_law(arm, None, (), np.array([0.019, 0.01, 0.01, 0.01]), np.array([0.15, 0.3, 0.0, 0.1]))
    assert [p.name for p in law[0]] == ["mass", "center_x", "center_y", "center_z"]


@pytest.fixture(scope="module")
def handed(tmp_path_factory) -> Robot:
    """The planar arm with a hand of 0.6 kg, and a camera of 0.1 kg on it, on fixed joints."""
    text = (ROBOTS / "planar2.urdf").read_text()
    bodies = "".join(
        f'''<link name="{name}"><inertial><origin xyz="0 0 {z}"/><mass value="{mass}"/><inertia ixx="{i}" ixy="0"
        ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial></link><joint name="to_{name}" type="fixed">
        <origin xyz="0 0 {at}"/><parent link="{parent}"/><child link="{name}"/></joint>'''
        for name, parent, at, z, mass, i in (
            ("hand", "lower", -0.4, -0.05, 0.6, 0.002),
            ("camera", "hand", -0.1, 0.0, 0.1, 1e-5),
        )
    )
    file = tmp_path_factory.mktemp("handed") / "arm.urdf"
    file.write_text(text.replace("</robot>", bodies + "</robot>"))
    return load_robot(file)


def test_parts_on_fixed_joints_are_known_with_all_behind_them(handed):
    # By hand: 0.6 kg at -0.45 m and 0.1 kg at -0.5 m.
    whole, camera = handed.attached[2]
    assert whole.names == ("hand", "camera")
    assert whole.mass == pytest.approx(0.7)
    np.testing.assert_allclose(whole.center, [0.0, 0.0, -(0.6 * 0.45 + 0.1 * 0.5) / 0.7])
    assert camera.names == ("camera",)
    assert handed.attached[1] == ()


def test_a_part_that_is_missing_goes_with_its_own_inertia(handed):
    # Oracle: the same arm without the parts.
    part = handed.attached[2][0]
    lighter = Payload().simulated(handed, None, np.array([-part.mass, *part.center])).robot
    bare = load_robot(ROBOTS / "planar2.urdf")
    assert lighter is not None
    np.testing.assert_allclose(
        lighter(handed).model.inertias[2].toDynamicParameters(),
        bare.model.inertias[2].toDynamicParameters(), atol=1e-12,
    )  # fmt: skip


@pytest.mark.parametrize(("mass", "named"), [(-0.7, True), (-0.6, True), (-0.4, False), (0.7, False)])
def test_a_part_is_named_where_mass_and_moments_are_about_its_own(handed, mass, named):
    part = handed.attached[2][0]
    remark = Payload().remark(handed, None, np.array([mass, *part.center]))
    assert ("The model carries hand with camera (0.7 kg)" in remark) == named


def test_less_than_nothing_is_plausible_where_the_model_carries_a_part_only(handed):
    # A quarter more than the heaviest part, as sizes are known to that.
    bare = load_robot(ROBOTS / "planar2.urdf")
    assert Payload().parameters(handed, None)[0].plausible == (pytest.approx(-1.25 * 0.7), 1000.0)
    assert Payload().parameters(bare, None)[0].plausible == (0.0, 1000.0)
    assert Payload().parameters(bare, None)[0].lower == -1.5


def test_a_payload_is_probed_and_sized_at_the_center_of_the_last_link(arm, operation):
    center = arm.model.inertias[3].lever
    name, direction = Payload().probe(arm, operation, None)
    assert name == "mass"
    np.testing.assert_allclose(direction, pin.Inertia(1.0, center, np.zeros((3, 3))).toDynamicParameters(), atol=1e-15)
    assert Payload().sized(arm, None, "mass", 0.7, np.zeros(3)) == (0.7, *center)


def test_a_load_that_was_found_before_may_be_taken_off(arm):
    # By hand: the link's own mass and 2 kg more, of which all may go; without an earlier diagnosis its own alone.
    center = np.array([0.1, -0.05, 0.2])
    loaded = carrying(arm, [np.array([2.0, *center])])
    own = arm.model.inertias[payload_body(arm)].mass
    assert Payload().lightest(loaded) == pytest.approx(-(own + 2.0))
    moments = np.array([-1.5, *(-1.5 * center), *np.zeros(6)])
    assert Payload().from_coefficients(loaded, None, moments, ())[0] == pytest.approx(-1.5)
    assert Payload().from_coefficients(arm, None, moments, ())[0] > -1.5


def test_what_was_found_before_is_a_plausible_size_to_lose(arm):
    loaded = carrying(arm, [np.array([2.0, 0.1, -0.05, 0.2])])
    ranges = [Payload().parameters(robot, None)[0].plausible for robot in (arm, loaded)]
    assert ranges[0] is not None
    assert ranges[1] is not None
    assert ranges[0][0] > -2.0
    assert ranges[1][0] <= -2.0


def test_a_robot_that_carries_nothing_is_itself(arm):
    assert carrying(arm, []) is arm


EFFECT = InertialParameters()


def torque_of_changed(robot: Robot, operation: Operation, changes: dict[str, np.ndarray]) -> np.ndarray:
    """Pinocchio: what the given model needs less what one with changed bodies needs."""
    changed = robot.model.copy()
    for joint, change in changes.items():
        index = changed.getJointId(joint)
        changed.inertias[index] = pin.Inertia.FromDynamicParameters(
            robot.model.inertias[index].toDynamicParameters() + change
        )
    return pinocchio_torque(robot.model, operation) - pinocchio_torque(changed, operation)


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
