# pyright: reportAttributeAccessIssue=false
"""Model files as written: URDF and MJCF."""

import io
import re
from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import yourdfpy

from floating_leg import written_leg
from identification.export.model_files.mjcf_file import mjcf_text
from identification.export.model_files.reload import mujoco_difference, urdf_difference
from identification.export.model_files.urdf_file import edited_urdf, new_urdf
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.dynamics.moving_base import any_base_motion
from phantom_dyn.effects.support.changed_robot import with_parameters, with_rotor_inertia
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot_files import find_robot


@pytest.mark.parametrize("name", ["arm3.urdf", "arm3.xml", "fourbar.xml", "parallelogram.urdf", "pendulum.urdf"])
def test_mujoco_needs_the_same_torques(name, robots, changed, some):
    robot = changed(load_robot(robots / name))
    assert mujoco_difference(mjcf_text(robot), robot, some(robot)) < 1e-12


@pytest.mark.parametrize("name", ["phantom_1_5", "cea_branch", "emps"])
def test_mujoco_needs_the_torques_of_built_in_robots(name, changed, some):
    robot = changed(load_robot(name))
    assert mujoco_difference(mjcf_text(robot), robot, some(robot)) < 1e-12


def test_rotor_inertias_are_in_the_file(robots, some):
    robot = with_rotor_inertia(load_robot(robots / "arm3.urdf"), "tilt", 0.4)
    text = mjcf_text(robot)
    assert 'armature="0.4"' in text
    assert mujoco_difference(text, robot, some(robot)) < 1e-12


def test_our_own_reader_needs_the_same_torques(robots, changed, some, tmp_path):
    robot = changed(load_robot(robots / "arm3.urdf"))
    file = tmp_path / "robot.xml"
    file.write_text(mjcf_text(robot))
    motion = some(robot)
    again = inverse_dynamics(load_robot(file), motion)
    np.testing.assert_allclose(again, inverse_dynamics(robot, motion), rtol=0, atol=1e-9)


def test_the_base_of_a_robot_on_legs_is_a_body_that_moves_freely(some, tmp_path, rng):
    # By hand: trunk, thigh and shank of 4, 1 and 0.4 kg, of which 0.4 are on the last joint.
    robot = load_robot(written_leg(tmp_path))
    text = mjcf_text(robot)
    model = mujoco.MjModel.from_xml_string(text)
    assert model.jnt_type.tolist() == [mujoco.mjtJoint.mjJNT_FREE, *2 * [mujoco.mjtJoint.mjJNT_HINGE]]
    assert model.body_mass.sum() == pytest.approx(5.4)
    assert mujoco_difference(text, robot, some(robot)) < 1e-12
    (tmp_path / "again.xml").write_text(text)
    again = load_robot(tmp_path / "again.xml", config=tmp_path / "robot.yaml")
    motion = replace(some(robot), base=any_base_motion(rng, len(some(robot).t)))
    np.testing.assert_allclose(inverse_dynamics(again, motion), inverse_dynamics(robot, motion), rtol=0, atol=1e-9)


def test_a_loop_that_keeps_two_frames_together_is_closed_again(robots, some, tmp_path):
    robot = load_robot(robots / "fourbar.xml")
    file = tmp_path / "robot.xml"
    file.write_text(mjcf_text(robot))
    again = load_robot(file)
    assert (again.joint_names, again.passive_names) == (robot.joint_names, robot.passive_names)
    motion = some(robot)
    np.testing.assert_allclose(inverse_dynamics(again, motion), inverse_dynamics(robot, motion), rtol=0, atol=1e-9)


def test_every_active_joint_has_a_motor(robots):
    root = ElementTree.fromstring(mjcf_text(load_robot(robots / "fourbar.xml")))
    assert [motor.get("joint") for motor in root.iter("motor")] == ["drive"]


def test_a_body_without_mass_is_refused(robots, tmp_path):
    file = tmp_path / "robot.urdf"
    text = (robots / "pendulum.urdf").read_text()
    file.write_text(re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL))
    with pytest.raises(ParameterError, match="rod has no mass, or no inertia about some axis, which MuJoCo requires"):
        mjcf_text(load_robot(file))


def test_another_damping_in_the_text_is_noticed(robots, some):
    robot = load_robot(robots / "arm3.urdf")
    text = mjcf_text(robot).replace('damping="12.0"', 'damping="13.0"')
    assert mujoco_difference(text, robot, some(robot)) > 1e-3


def test_what_mujoco_refuses_is_said(robots, some):
    robot = load_robot(robots / "pendulum.urdf")
    with pytest.raises(RobotError, match="MuJoCo refuses the MJCF"):
        mujoco_difference(mjcf_text(robot).replace('type="hinge"', 'type="wheel"'), robot, some(robot))


BUILT_IN = ["phantom_1_5", "cea_branch", "emps"]


def stated(text: str, link: str) -> list[float]:
    inertial = ElementTree.fromstring(text).find(f"link[@name='{link}']/inertial")
    assert inertial is not None
    numbers = [inertial.find("mass"), inertial.find("inertia")]
    return [float(x) for element in numbers if element is not None for x in element.attrib.values()]


@pytest.fixture
def written(robots, changed, tmp_path):
    """The arm with other parameters, and its URDF as text."""
    file = robots / "arm3.urdf"
    given = load_robot(file)
    robot = changed(given)
    return robot, edited_urdf(robot, given, file, tmp_path)


def test_the_file_loaded_again_needs_the_same_torques(written, some):
    robot, text = written
    assert urdf_difference(text, robot, some(robot), None) < 1e-12


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_robots_come_back(name, changed, some, tmp_path):
    file = find_robot(name)
    given = load_robot(name)
    robot = changed(given)
    text = edited_urdf(robot, given, file, tmp_path)
    assert urdf_difference(text, robot, some(robot), file.with_name("robot.yaml")) < 1e-12


@pytest.mark.parametrize("name", ["arm3.xml", "fourbar.xml", "arm3.urdf"])
def test_a_urdf_written_from_nothing_needs_the_same_torques(name, robots, changed, some):
    robot = changed(load_robot(robots / name))
    assert urdf_difference(new_urdf(robot), robot, some(robot), None) < 1e-12


@pytest.mark.parametrize("name", ["arm3.urdf", "planar2.urdf"])
@pytest.mark.parametrize("edited", [True, False])
def test_another_reader_of_urdf_finds_no_error_and_the_same_masses(name, edited, robots, changed, tmp_path):
    # Oracle: yourdfpy, which shares nothing with Pinocchio's reader; the links that one body is made of sum up.
    given = load_robot(robots / name)
    robot = changed(given)
    text = edited_urdf(robot, given, robots / name, tmp_path) if edited else new_urdf(robot)
    read = yourdfpy.URDF.load(io.BytesIO(text.encode()), load_meshes=False)
    assert (read.validate(), read.errors) == (True, [])
    assert set(robot.joint_names) <= set(read.actuated_joint_names)
    masses = [link.inertial.mass for link in read.robot.links if link.inertial is not None]
    assert sum(masses) == pytest.approx(sum(body.mass for body in list(robot.model.inertias)[1:]))


def test_a_link_fixed_to_another_keeps_what_its_file_states(written, robots):
    assert stated(written[1], "tool") == stated((robots / "arm3.urdf").read_text(), "tool")


def test_a_link_that_nothing_possible_is_left_for_takes_the_mass_of_those_fixed_to_it(robots, some, tmp_path):
    # Rail and tool together weigh 1.1 kg, the tool alone 0.4: of 0.3 kg nothing is left for the rail.
    given = load_robot(robots / "arm3.urdf")
    change = np.zeros(30)
    change[20:] = (0.3 / 1.1 - 1) * given.model.inertias[3].toDynamicParameters()
    robot = with_parameters(given, change)
    text = edited_urdf(robot, given, robots / "arm3.urdf", tmp_path)
    assert ElementTree.fromstring(text).find("link[@name='tool']/inertial") is None
    assert stated(text, "rail")[0] == pytest.approx(0.3)
    assert urdf_difference(text, robot, some(robot), None) < 1e-12


def test_an_inertia_that_mujoco_refuses_is_in_no_urdf(robots, tmp_path):
    # Oracle: MuJoCo, which refuses a body whose one principal inertia exceeds the sum of the others.
    file = robots / "pendulum.urdf"
    given = load_robot(file)

    def with_principal(*inertia):
        model = given.model.copy()
        model.inertias[1] = pin.Inertia(1.0, np.array([0.0, 0.0, -0.2]), np.diag(inertia))
        return replace(given, model=model)

    broken = with_principal(0.1, 0.2, 0.4)
    for make in (lambda: edited_urdf(broken, given, file, tmp_path), lambda: new_urdf(broken)):
        with pytest.raises(ParameterError, match="one principal inertia exceeds the sum of the others: record"):
            make()
    mujoco.MjModel.from_xml_string(edited_urdf(with_principal(0.1, 0.2, 0.3), given, file, tmp_path))


def test_a_file_whose_own_inertia_no_body_has_is_corrected_all_the_same(robots, tmp_path):
    # By hand: many URDFs have such links; refusing them would hold back what else was found.
    text = (robots / "pendulum.urdf").read_text()
    file = tmp_path / "broken.urdf"
    file.write_text(re.sub(r"<inertia [^>]*/>", '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="3"/>', text))
    given = load_robot(file)
    model = given.model.copy()
    model.inertias[1] = pin.Inertia(2.0, np.array([0.0, 0.0, -0.2]), np.diag([1.0, 1.0, 3.0]))
    written = ElementTree.fromstring(edited_urdf(replace(given, model=model), given, file, tmp_path))
    assert {float(mass.get("value")) for mass in written.iter("mass")} == {2.0}


def test_links_behind_a_held_joint_keep_their_inertia(tmp_path, robots, some):
    config = tmp_path / "robot.yaml"
    config.write_text("lock: [slide]\n")
    given = load_robot(robots / "arm3.urdf", config=config)
    robot = with_parameters(
        given, 0.1 * np.concatenate([given.model.inertias[j].toDynamicParameters() for j in (1, 2)])
    )
    text = edited_urdf(robot, given, robots / "arm3.urdf", tmp_path)
    assert stated(text, "rail") == stated((robots / "arm3.urdf").read_text(), "rail")
    assert urdf_difference(text, robot, some(robot), config) < 1e-12


SCENE = """<mujoco><worldbody>
  <body name="upper"><joint name="s" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03"/>
    <body name="lower" pos="0 0 -.3"><joint name="e" axis="0 1 0"/><joint name="held" axis="1 0 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -.2" size=".03"/></body></body>
  <body name="ball" pos="1 1 1"><freejoint name="ball_joint"/><geom size=".05"/></body>
</worldbody></mujoco>"""


def test_a_urdf_of_a_scene_is_loaded_without_the_joints_that_were_held(tmp_path, some):
    file, config = tmp_path / "scene.xml", tmp_path / "robot.yaml"
    file.write_text(SCENE)
    config.write_text("lock: [ball_joint, held]\njoints: {held: {gear_ratio: 2}, e: {rotor_inertia: 0.1}}\n")
    robot = load_robot(file)
    assert robot.joint_names == ("s", "e")
    assert urdf_difference(new_urdf(robot), robot, some(robot), config) < 1e-12
    config.write_text("lock: [ball_joint]\nloops: [{kind: point, frame_a: nowhere, frame_b: lower}]\n")
    with pytest.raises(RobotError, match=rf"^{config}: loops\[0\]\.frame_a names the unknown frame 'nowhere'"):
        urdf_difference(new_urdf(robot), robot, some(robot), config)


def test_a_body_lighter_than_what_is_held_on_it_is_refused(tmp_path, robots):
    config = tmp_path / "robot.yaml"
    config.write_text("lock: [slide]\n")
    given = load_robot(robots / "arm3.urdf", config=config)
    change = np.concatenate([np.zeros(10), -0.9 * given.model.inertias[2].toDynamicParameters()])
    robot = with_parameters(given, change)
    with pytest.raises(ParameterError, match=r"The link beam cannot exist .* below zero"):
        edited_urdf(robot, given, robots / "arm3.urdf", tmp_path)


def test_bodies_that_stay_are_not_touched(robots, tmp_path):
    given = load_robot(robots / "arm3.urdf")
    text = edited_urdf(given, given, robots / "arm3.urdf", tmp_path)
    squeezed = [re.sub(r"\s+", "", t.replace(" />", "/>")) for t in (text, (robots / "arm3.urdf").read_text())]
    assert squeezed[0] == squeezed[1]


def test_comments_of_the_file_stay(written):
    assert "Spatial arm: turntable, inclined hinge" in written[1]


def test_meshes_beside_the_file_are_found_from_the_new_folder(tmp_path, robots):
    source, out = tmp_path / "source", tmp_path / "deep" / "out"
    (source / "meshes").mkdir(parents=True)
    (source / "meshes" / "rod.stl").touch()
    mesh = '<visual><geometry><mesh filename="meshes/rod.stl"/></geometry></visual>'
    file = source / "robot.urdf"
    file.write_text((robots / "pendulum.urdf").read_text().replace('<link name="rod">', f'<link name="rod">{mesh}'))
    given = load_robot(file)
    found = re.search(r'filename="([^"]*)"', edited_urdf(given, given, file, out))
    assert found
    assert (out / found[1]).resolve() == (source / "meshes" / "rod.stl").resolve()


def test_meshes_of_packages_keep_their_names(tmp_path, robots):
    mesh = '<visual><geometry><mesh filename="package://arm/rod.stl"/></geometry></visual>'
    file = tmp_path / "robot.urdf"
    file.write_text((robots / "pendulum.urdf").read_text().replace('<link name="rod">', f'<link name="rod">{mesh}'))
    given = load_robot(file)
    assert 'filename="package://arm/rod.stl"' in edited_urdf(given, given, file, tmp_path / "out")


def test_another_mass_in_the_text_is_noticed(written, some):
    robot, text = written
    other = re.sub(r'<mass value="[^"]*"', '<mass value="9"', text, count=1)
    assert urdf_difference(other, robot, some(robot), None) > 1e-4


def test_a_text_of_another_robot_is_refused(written, robots, some):
    with pytest.raises(RobotError, match="has the joints pin, wanted turn, tilt, slide"):
        urdf_difference((robots / "pendulum.urdf").read_text(), written[0], some(written[0]), None)
