# pyright: reportAttributeAccessIssue=false
"""A corrected MJCF keeps the given one. Oracles: MuJoCo on both files, closed forms, and the findings themselves."""

import sys
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_files import model_files
from identification.export.corrected.corrected_model import corrected_model
from identification.export.corrected.given_mjcf import edited_mjcf
from identification.export.model_files.reload import mujoco_problem
from identification.words.note_words import sentences
from phantom_dyn import load_robot
from phantom_dyn.motion import Motion

CASES = (
    "viscous_friction coulomb_friction direction_dependent_friction stribeck_friction presliding_friction "
    "load_dependent_friction position_dependent_friction torque_offset torque_constant rotor_inertia payload "
    "inertial_parameters parasitic_spring joint_coupling cogging torque_ripple torque_saturation input_delay "
    "actuator_lag reference_delay backlash transmission_compliance base_tilt encoder_offset encoder_eccentricity "
    "encoder_quantization"
).split()
GIVEN = """<mujoco model="cell">
  <!-- who measured what -->
  <compiler angle="degree" meshdir="meshes"/>
  <default>
    <joint damping="0.4" armature="0.02"/>
    <default class="loose"><joint damping="0.1" frictionloss="0.3" range="-90 90"/></default>
  </default>
  <asset><mesh name="cover" file="cover.stl"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="floor" type="plane" size="2 2 0.1"/>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0" range="-120 120"/>
      <inertial pos="0.02 0.01 -0.2" mass="2" diaginertia="0.03 0.03 0.01"/>
      <geom name="tube" type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03"/>
      <geom name="lid" type="mesh" mesh="cover"/>
      <body name="lower" pos="0 0 -0.4" childclass="loose">
        <joint name="elbow" axis="0 1 0" pos="0 0.01 0.02"/>
        <inertial pos="0 0 -0.15" mass="1" diaginertia="0.01 0.01 0.004"/>
        <geom name="bar" type="box" size="0.02 0.02 0.15" pos="0 0 -0.15"/>
        <site name="wrist" pos="0 0 -0.3"/>
        <body name="hand" pos="0 0 -0.3">
          <inertial pos="0 0 -0.05" mass="0.2" diaginertia="0.001 0.001 0.001"/>
          <body name="finger" pos="0 0.02 -0.05">
            <joint name="grip" type="slide" axis="0 1 0" range="0 0.04"/>
            <inertial pos="0 0 0" mass="0.05" diaginertia="1e-4 1e-4 1e-4"/>
          </body>
          <body name="thumb" pos="0 -0.02 -0.05">
            <joint name="grip2" type="slide" axis="0 1 0" range="-0.04 0"/>
            <inertial pos="0 0 0" mass="0.05" diaginertia="1e-4 1e-4 1e-4"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <equality><joint name="pinch" joint1="grip2" joint2="grip" polycoef="0 -1 0 0 0"/></equality>
  <actuator>
    <motor name="drive" joint="shoulder" gear="50" ctrlrange="-1 1"/>
    <position name="servo" joint="elbow" kp="30" ctrlrange="-90 90"/>
  </actuator>
  <sensor><jointpos name="reading" joint="elbow"/><framepos name="tip" objtype="site" objname="wrist"/></sensor>
  <keyframe><key name="home" qpos="0.1 0.2 0.01 -0.01" ctrl="0 0.2"/></keyframe>
</mujoco>
"""
FOUND = (
    KnownEffect("viscous_friction", "shoulder", (0.25,)),
    KnownEffect("coulomb_friction", "elbow", (0.5,)),
    KnownEffect("payload", None, (0.3, 0.0, 0.0, -0.1)),
)


def cover(folder: Path) -> None:
    """A tetrahedron as binary STL."""
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], np.float32)
    faces = [corners[[a, b, c]] for a, b, c in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    folder.mkdir()
    body = b"".join(np.zeros(3, np.float32).tobytes() + face.tobytes() + b"\0\0" for face in faces)
    (folder / "cover.stl").write_bytes(b" " * 80 + len(faces).to_bytes(4, "little") + body)


@pytest.fixture
def cell(tmp_path) -> Path:
    cover(tmp_path / "meshes")
    file = tmp_path / "cell.xml"
    file.write_text(GIVEN)
    (tmp_path / "robot.yaml").write_text("payload_frame: lower\n")
    return file


def written(file: Path, *found: KnownEffect) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    """The corrected MJCF, loaded from another folder, and its notes."""
    robot = load_robot(file)
    samples = np.random.default_rng(0).standard_normal((3, 40, robot.nv)) * 0.3
    out = file.parent / "report"
    out.mkdir()
    notes = model_files(corrected_model(robot, found), Motion(np.arange(40.0), *samples), folder=out)[1]
    assert notes.text, notes.notes
    (out / "corrected.xml").write_text(notes.text)
    return mujoco.MjModel.from_xml_path(str(out / "corrected.xml")), sentences(notes.notes)


def test_what_no_finding_touches_is_that_of_the_given_file(cell):
    found, given = written(cell, *FOUND)[0], mujoco.MjModel.from_xml_path(str(cell))
    assert (found.ngeom, found.nsite, found.nsensor, found.nu, found.neq, found.nkey, found.nmesh) == (
        given.ngeom, given.nsite, given.nsensor, given.nu, given.neq, given.nkey, given.nmesh,
    )  # fmt: skip
    for name in ("geom_pos", "geom_size", "jnt_range", "site_pos", "eq_data", "actuator_gear", "actuator_gainprm",
                 "actuator_ctrlrange", "key_qpos", "sensor_objid"):  # fmt: skip
        np.testing.assert_array_equal(getattr(found, name), getattr(given, name), err_msg=name)


def test_friction_and_masses_are_the_corrected_ones(cell):
    found = written(cell, *FOUND)[0]
    # By joint, in the order of the file; the defaults give 0.4 and 0.1.
    np.testing.assert_allclose(found.dof_damping[:2], [0.4 + 0.25, 0.1], rtol=1e-12)
    np.testing.assert_allclose(found.dof_frictionloss[:2], [0.0, 0.3 + 0.5], rtol=1e-12)
    assert found.body("lower").mass[0] == pytest.approx(1.0 + 0.3)
    # The load is stated in the axes of the joint, which lies at (0, 0.01, 0.02) of its body.
    center = (1.0 * np.array([0, 0, -0.15]) + 0.3 * np.array([0, 0.01, -0.08])) / 1.3
    np.testing.assert_allclose(found.body("lower").ipos, center, atol=1e-9)


@pytest.mark.parametrize("name", sorted(CASES))
def test_every_effect_leaves_a_file_that_needs_the_torques_of_the_corrected_model(name, case, cell):
    effect = case(name)
    if name == "inertial_parameters":
        effect = KnownEffect(name, "elbow", (0.5, 0.02, 0.0, -0.2, 0.12, 0.0, 0.11, 0.0, 0.0, 0.02))
    notes = written(cell, effect)[1]
    assert any("loaded again with MuJoCo" in note and "same torques" in note for note in notes)
    assert not any("given file is not in it" in note for note in notes)


def test_comments_stay(cell):
    written(cell, *FOUND)
    assert "who measured what" in (cell.parent / "report" / "corrected.xml").read_text()


def test_a_motor_holds_what_was_found_of_its_drive_behind_its_gear(cell):
    found, _ = written(
        cell,
        KnownEffect("torque_constant", "shoulder", (0.8,)),
        KnownEffect("torque_offset", "shoulder", (2.0,)),
        KnownEffect("torque_saturation", "shoulder", (9.0,)),
    )
    data = mujoco.MjData(found)
    torque = []
    for ctrl in (0.0, 0.1, 1.0):
        data.ctrl[0] = ctrl
        mujoco.mj_forward(found, data)
        torque.append(data.qfrc_actuator[0])
    # Of 50 N m the drive gives no more than 9, of which 0.8 arrive.
    np.testing.assert_allclose(torque, [2.0, 2.0 + 0.8 * 5.0, 2.0 + 0.8 * 9.0])


@pytest.mark.parametrize(
    ("effect", "joint", "said"),
    [
        ("input_delay", "elbow", "drive of elbow (delay 0.01): its actuator is <position>"),
        ("reference_delay", "shoulder", "delays of the references of position controllers"),
    ],
    ids=["a delay of a servo", "a late reference of a motor"],
)
def test_what_an_actuator_has_no_place_for_is_reported(cell, effect, joint, said):
    assert any(said in note for note in written(cell, KnownEffect(effect, joint, (0.01,)))[1])


def test_a_servo_holds_a_late_reference_as_the_delay_of_its_command(cell):
    # MuJoCo: a step of the reference shows in the servo's force after 10 ms, and not after 8.
    found, _ = written(cell, KnownEffect("reference_delay", "elbow", (0.01,)))
    data, servo = mujoco.MjData(found), found.actuator("servo").id
    mujoco.mj_step(found, data)
    before = data.actuator_force[servo]
    data.ctrl[servo] = 0.5
    steps = round(0.01 / found.opt.timestep)
    forces = []
    for _ in range(steps + 3):
        mujoco.mj_step(found, data)
        forces.append(data.actuator_force[servo] - before)
    assert np.abs(forces[: steps - 2]).max() < 0.1 * 30 * 0.5
    assert forces[-1] > 0.5 * 30 * 0.5


def test_a_zero_moves_drawing_range_and_keyframe_along_in_the_units_of_the_file(cell):
    found, given = (
        written(cell, KnownEffect("encoder_offset", "elbow", (0.1,)))[0],
        mujoco.MjModel.from_xml_path(str(cell)),
    )
    np.testing.assert_allclose(found.jnt_range[1], given.jnt_range[1] + 0.1, atol=1e-12)
    np.testing.assert_allclose(found.key_qpos[0], given.key_qpos[0] + [0, 0.1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.qpos0[1], 0.1)


def test_a_play_is_a_joint_of_its_own_that_keyframes_know(cell):
    found, _ = written(cell, KnownEffect("backlash", "shoulder", (0.05,)))
    np.testing.assert_allclose(found.joint("shoulder_play").range, [-0.025, 0.025])
    assert found.dof_damping[found.joint("shoulder_play").dofadr[0]] == 0
    np.testing.assert_allclose(found.key_qpos[0], [0.1, 0, 0.2, 0.01, -0.01])


HELD = """<mujoco><worldbody><body name="trunk">{}
  <inertial pos="0 0 0" mass="5" diaginertia="0.1 0.1 0.1"/>
  <body name="leg">
    <inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.002"/>
    <body name="load"><joint name="ball" type="ball"/><inertial pos="0 0 0" mass="1" diaginertia="0.1 0.1 0.1"/>
      <body name="foot"><joint name="ankle" axis="0 1 0"/>
        <inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.002"/></body></body>
    <joint name="hip" axis="0 1 0"/>
  </body></body></worldbody>
  <keyframe><key qpos="0 0 0.3 1 0 0 0 0.5 1 0 0 0 0.2" qvel="1 2 3 4 5 6 7 8 9 10 11"/></keyframe></mujoco>"""


@pytest.mark.parametrize("base", ['<freejoint name="base"/>', '<joint name="base" type="free"/>', "<freejoint/>"])
@pytest.mark.parametrize("joint", ["hip", "ankle"])
def test_keyframes_of_joints_behind_a_held_base_and_a_ball_keep_their_places(base, joint, tmp_path):
    # MuJoCo's places of the joints in its compiled models.
    file = tmp_path / "leg.xml"
    file.write_text(HELD.format(base))
    (tmp_path / "robot.yaml").write_text("base: fixed\nlock: [ball]\n")
    given, robot = mujoco.MjModel.from_xml_path(str(file)), load_robot(file)
    effects = KnownEffect("encoder_offset", joint, (0.1,)), KnownEffect("backlash", joint, (0.05,))
    found = mujoco.MjModel.from_xml_string(edited_mjcf(corrected_model(robot, effects), file, None)[0])
    for keys, first, zero in (("key_qpos", "jnt_qposadr", 0.1), ("key_qvel", "jnt_dofadr", 0.0)):
        before, after = (np.split(getattr(m, keys)[0], getattr(m, first)[1:]) for m in (given, found))
        names = [found.joint(k).name for k in range(found.njnt)]
        assert after.pop(names.index(f"{joint}_play")) == 0
        names.remove(f"{joint}_play")
        for name, old, new in zip(names, before, after, strict=True):
            np.testing.assert_allclose(new, old + (zero if name == joint else 0.0), atol=1e-12, err_msg=name)


def test_a_part_that_the_robot_lacks_is_taken_off_and_what_moves_behind_it_stays(cell):
    found, _ = written(cell, KnownEffect("payload", None, (-0.2, 0.0, -0.01, -0.37)))
    assert found.body("lower").mass[0] + found.body("hand").mass[0] == pytest.approx(1.0)
    assert found.body("thumb").mass[0] == 0.05


def test_a_spring_that_was_found_takes_the_place_of_the_stated_one(cell):
    cell.write_text(GIVEN.replace('axis="0 1 0" range="-120 120"', 'axis="0 1 0" range="-120 120" stiffness="3"'))
    found, _ = written(cell, KnownEffect("parasitic_spring", "shoulder", (5.0, 0.2)))
    assert found.jnt_stiffness[0] == 5.0
    assert found.qpos_spring[0] == pytest.approx(0.2)


def test_a_file_whose_masses_the_compiler_changes_gives_a_new_one_and_the_reason(cell):
    cell.write_text(GIVEN.replace('angle="degree"', 'angle="degree" settotalmass="7"'))
    found, notes = written(cell, *FOUND)
    assert found.ngeom == 0
    assert any("settotalmass" in note and "given file is not in it" in note for note in notes)


def test_a_file_whose_meshes_are_missing_is_written_unchecked(cell):
    (cell.parent / "meshes" / "cover.stl").unlink()
    robot = load_robot(cell)
    motion = Motion(np.arange(5.0), *np.zeros((3, 5, robot.nv)))
    file = model_files(corrected_model(robot, FOUND), motion, folder=cell.parent)[1]
    assert "cover.stl" in file.text
    assert any("not loaded again, as MuJoCo refuses the given file as well" in note for note in sentences(file.notes))


def test_loops_of_the_phantom_are_equalities_that_hold():
    robot = load_robot("phantom_1_5")
    motion = Motion(np.arange(20.0), *(0.2 * np.random.default_rng(1).standard_normal((3, 20, robot.nv))))
    file = model_files(corrected_model(robot, (KnownEffect("coulomb_friction", "theta2", (0.02,)),)), motion,
                       folder=Path())[1]  # fmt: skip
    model = mujoco.MjModel.from_xml_string(file.text)
    data = mujoco.MjData(model)
    assert model.neq == 2
    worst = 0.0
    for k in range(1000):
        data.ctrl[:3] = 0.1 * np.sin(np.array([3.0, 5.0, 7.0]) * k * model.opt.timestep)
        mujoco.mj_step(model, data)
        q = {name: data.joint(name).qpos[0] for name in ("theta2", "theta3", "elbow", "crank")}
        apart = q["theta3"] - q["theta2"]
        worst = max(worst, abs(q["elbow"] - apart), abs(q["crank"] + apart))
    assert abs(apart) > 0.05
    assert worst < 2e-3


def test_a_joint_that_mimics_another_follows_it_in_both_files(tmp_path):
    file = tmp_path / "hand.urdf"
    file.write_text(MIMIC)
    robot = load_robot(file)
    motion = Motion(np.arange(20.0), *(0.2 * np.random.default_rng(1).standard_normal((3, 20, robot.nv))))
    found = corrected_model(robot, (KnownEffect("viscous_friction", "turn", (0.3,)),))
    urdf, mjcf = model_files(found, motion, folder=tmp_path)
    mimic = ElementTree.fromstring(urdf.text.split("?>")[1]).find("joint[@name='copy']/mimic")
    assert mimic is not None
    assert mimic.get("multiplier") == "-0.5"
    model = mujoco.MjModel.from_xml_string(mjcf.text)
    assert model.neq == 1
    np.testing.assert_allclose(model.eq_data[0, :2], [0.1, -0.5])
    assert model.dof_damping[model.joint("turn").dofadr[0]] == pytest.approx(0.3)
    assert any("loaded again with MuJoCo" in note for note in sentences(mjcf.notes))


MIMIC = """<robot name="hand">
  <link name="base"/><link name="a"><inertial><origin xyz="0 0 -0.1"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="b"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/></joint>
  <joint name="copy" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/><origin xyz="0 0 -0.2"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="turn" multiplier="-0.5" offset="0.1"/></joint>
</robot>"""


def test_a_mujoco_that_cannot_be_imported_counts_as_absent(tmp_path, monkeypatch):
    package = tmp_path / "mujoco"
    package.mkdir()
    (package / "__init__.py").write_text("raise OSError('libGL.so.1: cannot open shared object file')\n")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.delitem(sys.modules, "mujoco")
    assert "cannot be imported (libGL.so.1" in str(mujoco_problem())
