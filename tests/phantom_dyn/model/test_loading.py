# pyright: reportAttributeAccessIssue=false
import hashlib

import mujoco
import numpy as np
import pytest

import phantom_dyn
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import gravity_torque, inverse_dynamics, mass_matrix, standard_parameters
from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.motion import Motion
from places import ROBOTS

ARM, ARM_XML = ROBOTS / "arm3.urdf", ROBOTS / "arm3.xml"


def some_motion(rng: np.random.Generator, nv: int, samples: int = 20) -> Motion:
    return Motion(np.arange(samples) * 0.01, *rng.normal(size=(3, samples, nv)))


def test_loading_a_robot_prints_nothing(capfd):
    load_robot("example:panda")
    assert capfd.readouterr() == ("", "")


def test_output_goes_where_it_went_after_a_refused_robot(edited, capfd):
    with pytest.raises(phantom_dyn.errors.RobotError):
        edited(ARM, ("<limit", "<limits"))
    print("seen")
    assert capfd.readouterr() == ("seen\n", "")


def test_names_and_hash_of_the_file_are_kept():
    robot = load_robot(ARM)
    assert (robot.name, robot.joint_names, robot.source, robot.sha256) == (
        "arm3",
        ("turn", "tilt", "slide"),
        str(ARM),
        hashlib.sha256(ARM.read_bytes()).hexdigest(),
    )
    assert robot.torque_units == ("N m", "N m", "N")


@pytest.mark.parametrize("source", [ARM, ARM_XML])
def test_friction_is_that_of_the_file(source):
    robot = load_robot(source)
    assert robot.viscous_friction.tolist() == [0.3, 0.4, 12.0]
    assert robot.coulomb_friction.tolist() == [0.7, 0.5, 3.0]


def test_mjcf_and_urdf_of_one_arm_need_the_same_torque(rng):
    motion = some_motion(rng, 3)
    np.testing.assert_allclose(
        inverse_dynamics(load_robot(ARM_XML), motion), inverse_dynamics(load_robot(ARM), motion), atol=1e-10
    )


def test_a_mjcf_arm_needs_the_torque_that_mujoco_computes(rng):
    # MuJoCo makes friction a constraint, so it is left out there and taken off here.
    motion = some_motion(rng, 3)
    robot = load_robot(ARM_XML)
    model = mujoco.MjModel.from_xml_path(str(ARM_XML))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(model)
    expected = np.empty_like(motion.q)
    for k in range(len(motion.t)):
        data.qpos, data.qvel, data.qacc = motion.q[k], motion.v[k], motion.a[k]
        mujoco.mj_inverse(model, data)
        expected[k] = data.qfrc_inverse
    smooth = inverse_dynamics(robot, motion) - np.sign(motion.v) * robot.coulomb_friction
    np.testing.assert_allclose(smooth, expected, atol=1e-9)


def test_the_armature_of_a_mjcf_file_is_kept(edited):
    robot = edited(ARM_XML, ('joint name="turn"', 'joint name="turn" armature="0.02"'))
    assert (robot.model.armature[0], robot.actuators[0].rotor_inertia) == (0.02, 0.02)


def test_a_stated_rotor_inertia_replaces_the_armature_of_the_file(edited):
    robot = edited(
        ARM_XML,
        ('joint name="turn"', 'joint name="turn" armature="0.02"'),
        config="joints: {turn: {rotor_inertia: 0.005}}",
    )
    assert robot.model.armature[0] == 0.005


def test_the_gravity_of_a_mjcf_file_is_kept(edited):
    robot = edited(ARM_XML, ("<compiler", '<option gravity="0 0 -1.62"/><compiler'))
    assert robot.model.gravity.linear.tolist() == [0, 0, -1.62]


def test_mjcf_features_that_the_model_leaves_out_are_a_warning(edited):
    robot = edited(ARM_XML, ('joint name="turn"', 'joint name="turn" stiffness="4"'))
    assert "states stiffness of <joint>, which the model leaves out" in robot.warnings[0]


def test_a_clean_file_gives_no_warning():
    assert load_robot(ARM).warnings == load_robot(ARM_XML).warnings == ()


def test_a_fixed_joint_merges_its_link_into_the_moving_body():
    # Known truth: rail 0.7 kg and tool 0.4 kg.
    assert standard_parameters(load_robot(ARM))[20] == pytest.approx(1.1)


def test_a_continuous_joint_needs_the_torque_of_a_revolute_one(edited, rng):
    motion = some_motion(rng, 3)
    continuous = edited(ARM, ('name="tilt" type="revolute"', 'name="tilt" type="continuous"'))
    np.testing.assert_allclose(
        inverse_dynamics(continuous, motion), inverse_dynamics(load_robot(ARM), motion), atol=1e-12
    )


def test_a_continuous_joint_takes_two_entries_of_the_configuration(edited):
    robot = edited(ARM, ('name="tilt" type="revolute"', 'name="tilt" type="continuous"'))
    assert (robot.nq, robot.nv) == (4, 3)


def test_a_locked_joint_leaves_the_mass_matrix_of_the_others(edited, rng):
    q = rng.normal(size=(5, 3))
    q[:, 2] = 0
    locked = edited(ARM, config="lock: [slide]")
    np.testing.assert_allclose(mass_matrix(locked, q[:, :2]), mass_matrix(load_robot(ARM), q)[:, :2, :2], atol=1e-12)


def test_a_locked_joint_takes_its_friction_along(edited):
    robot = edited(ARM, config="lock: [tilt]")
    assert (robot.joint_names, robot.locked) == (("turn", "slide"), ("tilt",))
    assert robot.coulomb_friction.tolist() == [0.7, 3]


def test_a_mjcf_file_with_a_keyframe_can_have_locked_joints(edited):
    assert edited(ARM_XML, config="lock: [tilt]").viscous_friction.tolist() == [0.3, 12]


def test_a_broken_triangle_inequality_is_a_warning(edited):
    robot = edited(ARM, ('ixx="0.004"', 'ixx="0.04"'))
    assert "no rigid body has the inertia of link rail" in robot.warnings[0]


def test_a_link_without_mass_is_fine(edited):
    robot = edited(ARM, ('<mass value="0.4"/>', '<mass value="0"/>'))
    assert standard_parameters(robot)[20] == pytest.approx(0.7)


def test_meshes_need_not_be_there(edited):
    visual = '<visual><geometry><mesh filename="package://x/y.stl"/></geometry></visual>'
    assert edited(ARM, ('<link name="base"/>', f'<link name="base">{visual}</link>')).nv == 3


def test_a_visual_that_cannot_be_read_changes_nothing(edited):
    visual = '<visual><geometry><sphere radius="abc"/></geometry></visual>'
    robot = edited(ARM, ('<link name="rail">', f'<link name="rail">{visual}'))
    np.testing.assert_array_equal(standard_parameters(robot), standard_parameters(load_robot(ARM)))


def test_the_emps_axis_is_the_published_mass_without_gravity(rng):
    # Published: M = 95.1089 kg; the model has neither gravity nor friction, so force = M a.
    motion = some_motion(rng, 1)
    np.testing.assert_allclose(inverse_dynamics(load_robot("emps"), motion), 95.1089 * motion.a, rtol=1e-12)


def test_the_emps_axis_is_linear():
    robot = load_robot("emps")
    assert (robot.joint_names, robot.torque_units, robot.warnings) == (("axis",), ("N",), ())


def test_the_second_finger_of_the_panda_example_follows_the_first():
    robot = load_robot("example:panda")
    assert (robot.nv, robot.passive_names) == (8, ("panda_finger_joint2",))


def test_the_panda_example_carries_the_damping_of_its_file():
    assert 'damping="0.003"' in find_robot("example:panda").read_text()
    assert load_robot("example:panda").viscous_friction[0] == 0.003


def test_a_base_that_mjcf_hangs_on_a_wall_is_where_mujoco_has_it(tmp_path):
    arm = (
        '<body name="arm" euler="10 5 0"><joint name="s" axis="0 1 0"/>'
        '<geom type="capsule" fromto="0 0 0 0.1 0.2 -0.3" size="0.02" mass="1.2"/></body>'
    )
    base = f'<body name="base" pos="0 0 1" euler="30 0 0"><geom size="0.05" mass="3"/>{arm}</body>'
    path = tmp_path / "wall.xml"
    path.write_text(f'<mujoco><compiler angle="degree"/><worldbody>{base}</worldbody></mujoco>')
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[0] = 0.3
    mujoco.mj_forward(model, data)
    robot = load_robot(path)
    np.testing.assert_allclose(gravity_torque(robot, np.array([[0.3]]))[0], data.qfrc_bias, atol=1e-12)
    np.testing.assert_allclose(robot.model.jointPlacements[1].translation, data.xanchor[0], atol=1e-12)


def without_inertial(tmp_path):
    """The planar arm without the <inertial> of its forearm; the upper arm keeps its own."""
    text = (ROBOTS / "planar2.urdf").read_text()
    start, stop = text.rindex("<inertial>"), text.rindex("</inertial>") + len("</inertial>")
    (tmp_path / "arm.urdf").write_text(text[:start] + text[stop:])
    return tmp_path / "arm.urdf"


def test_a_joint_that_moves_nothing_with_inertia_is_reported(tmp_path):
    (said,) = load_robot(without_inertial(tmp_path)).warnings
    assert "nothing that elbow moves has mass or inertia" in said
    assert said.endswith("give lower its <inertial>.")


def test_a_link_without_inertial_is_reported_where_a_rotor_turns_it(tmp_path):
    path = without_inertial(tmp_path)
    (tmp_path / "robot.yaml").write_text("joints: {elbow: {rotor_inertia: 0.1}}")
    (said,) = load_robot(path).warnings
    assert said.startswith(f"{path}: lower (moved by elbow) has no <inertial>, so that gravity")
    assert "write mass and inertia into <inertial>" in said


def test_a_moving_link_of_zero_mass_is_reported(tmp_path):
    text = (ROBOTS / "planar2.urdf").read_text()
    head, _, tail = text.rpartition("<mass value=")
    (tmp_path / "arm.urdf").write_text(f'{head}<mass value="0"/>{tail.partition("/>")[2]}')
    (said,) = load_robot(tmp_path / "arm.urdf").warnings
    assert "lower (moved by elbow) has a mass of 0, so that gravity" in said


@pytest.mark.parametrize(("length", "warned"), [("0 0 0", False), ("0 0 0.1", True)])
def test_a_link_that_only_joins_two_axes_may_weigh_nothing(edited, length, warned):
    joint = (
        f'<joint name="twist" type="continuous"><parent link="rail"/><child link="cross"/><axis xyz="1 0 0"/></joint>'
        f'<joint name="bend" type="continuous"><origin xyz="{length}"/><parent link="cross"/><child link="end"/>'
        '<axis xyz="0 1 0"/></joint><link name="cross"/><link name="end"><inertial><mass value="1"/>'
        '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
    )
    said = edited(ARM, ("</robot>", joint)).warnings
    assert ["cross (moved by twist) has no <inertial>" in one for one in said] == [True] * warned


PLATE = (
    '<link name="plate"><inertial><mass value="2e-6"/><inertia ixx="1e-8" iyy="1e-8" izz="-4e-8" ixy="0" ixz="0" '
    'iyz="0"/></inertial></link><joint name="screws" type="fixed"><parent link="{}"/><child link="plate"/></joint>'
)


def test_a_body_that_never_moves_may_be_impossible(edited):
    robot = edited(ARM, ('<link name="base"/>', '<link name="base"/>' + PLATE.format("base")))
    assert "link plate cannot exist, its smallest principal inertia is -4e-08 kg m^2" in robot.warnings[0]
    assert "it never moves, so that nothing depends on it" in robot.warnings[0]


def test_a_tiny_impossible_link_in_a_body_that_moves_is_reported_and_used(edited, rng):
    plate = ('<link name="base"/>', '<link name="base"/>' + PLATE.format("rail"))
    robot, without = edited(ARM, plate), load_robot(ARM)
    assert "link plate cannot exist, its smallest principal inertia is -4e-08 kg m^2" in robot.warnings[0]
    assert "less than a hundredth of the body that it is fixed in" in robot.warnings[0]
    motion = some_motion(rng, robot.nv)
    np.testing.assert_allclose(inverse_dynamics(robot, motion), inverse_dynamics(without, motion), rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(("mass", "inertia"), [("2e-2", "-4e-8"), ("2e-6", "-4e-4")])
def test_an_impossible_link_that_matters_to_its_body_is_refused(edited, mass, inertia):
    plate = PLATE.format("rail").replace("2e-6", mass).replace("-4e-8", inertia)
    with pytest.raises(RobotError, match=r"link plate cannot exist, its smallest principal inertia"):
        edited(ARM, ('<link name="base"/>', '<link name="base"/>' + plate))


def test_a_tiny_impossible_link_with_a_joint_of_its_own_is_refused(edited):
    plate = PLATE.format("rail").replace('type="fixed"', 'type="continuous"')
    with pytest.raises(RobotError, match=r"link plate cannot exist, its smallest principal inertia"):
        edited(ARM, ('<link name="base"/>', '<link name="base"/>' + plate))


def test_an_inertia_that_reaches_far_out_of_the_robot_is_reported(edited):
    robot = edited(ARM, ('ixx="0.004"', 'ixx="9"'), ('iyy="0.005"', 'iyy="9"'), ('izz="0.003"', 'izz="9"'))
    assert "the inertia of link rail (0.7 kg, 9 kg m^2) is that of the same mass at 3.6 m or more" in robot.warnings[0]


@pytest.mark.parametrize(("mass", "inertia", "warned"), [(0.026, 1e-3, True), (0.026, 1e-5, False), (3.0, 0.2, False)])
def test_a_warning_names_a_body_that_would_be_too_thin_for_a_small_robot(tmp_path, mass, inertia, warned):
    # Closed form: 26 g with 1e-3 kg m^2 are 20 cm from their centre; a flywheel of 3 kg may have a radius of gyration
    # of 26 cm. The base is mounted two metres high, which makes neither any larger.
    body = f'<mass value="{mass}"/><inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/>'
    path = tmp_path / "finger.urdf"
    path.write_text(
        f'<robot name="r"><link name="b"/><link name="tip"><inertial><origin xyz="0 0 0.02"/>{body}</inertial></link>'
        '<joint name="curl" type="revolute"><parent link="b"/><child link="tip"/><origin xyz="0 0 2"/>'
        '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="9"/></joint></robot>'
    )
    assert any("link tip" in warning and "placeholder" in warning for warning in load_robot(path).warnings) == warned
