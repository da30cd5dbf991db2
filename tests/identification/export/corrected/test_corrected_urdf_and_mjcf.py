"""Corrected model files: URDF, MJCF, and what they leave out."""

import re
from collections.abc import Callable
from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from identification.data.signals import process_all
from identification.diagnosis.columns.operations import operation_of
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.result import Adjusted, Diagnosis
from identification.estimators.consistent.consistent_bodies import pseudo_inertia
from identification.export.all_files import export_texts
from identification.export.corrected.corrected_files import model_files, rollout_note
from identification.export.corrected.corrected_mjcf import corrected_mjcf
from identification.export.corrected.corrected_model import corrected_model
from identification.export.corrected.corrected_urdf import corrected_urdf, robot_of_urdf
from identification.export.corrected.found_effects import effect_of, findings_in_all_recordings, robot_within_tolerances
from identification.export.corrected.possible_bodies import same_torque_bodies
from identification.export.corrected.reload_in_mujoco import rollout_errors, torque_difference
from identification.export.model_files.mjcf_file import mjcf_text
from identification.export.model_files.reload import urdf_difference
from identification.export.uses.feedforward import loaded
from identification.pipeline import diagnose
from identification.words.note_words import sentence, sentences
from phantom_dyn.dynamics.dynamics import gravity_torque, inverse_dynamics, standard_parameters
from phantom_dyn.effects.support.changed_robot import with_gravity, with_parameters
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.inertia import point_mass_parameters
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS

FILE = ROBOTS / "planar2.urdf"

# MuJoCo says all of these, or the larger part of them.
SAID = [
    "viscous_friction", "coulomb_friction", "direction_dependent_friction", "stribeck_friction", "presliding_friction",
    "position_dependent_friction", "temperature_dependent_friction", "torque_offset", "torque_constant",
    "rotor_inertia", "payload", "inertial_parameters", "parasitic_spring",
    "joint_coupling", "cogging", "torque_saturation", "input_delay", "actuator_lag", "base_tilt", "encoder_offset",
]  # fmt: skip

HIDDEN = ["backlash", "transmission_compliance"]

NOT_SAID = ["load_dependent_friction", "torque_ripple", "encoder_eccentricity", "encoder_quantization"]

EVERYTHING = [*SAID, *HIDDEN, *NOT_SAID]


def driven(text: str, planar, swing) -> np.ndarray:
    """Torque that the position controller asks for when MuJoCo moves the model, at the controller's times."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep, model.opt.integrator = 5e-4, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    data = mujoco.MjData(model)
    at = [model.joint(name).qposadr[0] for name in planar.joint_names]
    dof = [model.joint(name).dofadr[0] for name in planar.joint_names]
    data.qpos[at], data.qvel[dof] = swing.q_ref[0], swing.v_ref[0]
    out = []
    for _ in swing.t:
        for k in range(10):
            data.ctrl[:2] = swing(data.time, data.qpos[at], data.qvel[dof])
            if k == 0:
                out.append(data.ctrl[:2].copy())
            mujoco.mj_step(model, data)
    return np.array(out)


@pytest.mark.parametrize("name", EVERYTHING)
def test_mujoco_needs_the_torques_of_the_corrected_model(name, corrected, some_motion):
    corrected = corrected(name)
    assert torque_difference(corrected_mjcf(corrected), corrected, some_motion) < 1e-12


@pytest.mark.parametrize("name", EVERYTHING)
def test_pinocchio_needs_the_torques_of_what_the_urdf_says(name, corrected, some_motion, tmp_path):
    corrected = corrected(name)
    assert (
        urdf_difference(corrected_urdf(corrected, FILE, tmp_path), robot_of_urdf(corrected), some_motion, None) < 1e-12
    )


def test_a_turned_base_is_the_same_as_turned_gravity(corrected, some_motion):
    corrected = corrected("base_tilt")
    found, wanted = (inverse_dynamics(robot, some_motion) for robot in (robot_of_urdf(corrected), corrected.robot))
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_a_zero_that_is_moved_back_makes_readings_true(corrected, some_motion, planar):
    shifted = Motion(some_motion.t, some_motion.q - [0.0, 0.1], some_motion.v, some_motion.a)
    found = inverse_dynamics(robot_of_urdf(corrected("encoder_offset")), some_motion)
    np.testing.assert_allclose(found, inverse_dynamics(planar, shifted), atol=1e-12)


@pytest.mark.parametrize("name", SAID)
def test_the_gap_shrinks_in_mujoco(name, corrected, recorded, planar):
    corrected, seen = corrected(name), recorded(name)
    motion = Motion(seen.t, seen.q, seen.encoders.v, seen.encoders.a)
    before = rollout_errors(mjcf_text(planar), planar, motion, seen.tau, starts=12)
    after = rollout_errors(corrected_mjcf(corrected), planar, motion, seen.tau, starts=12)
    assert np.hypot(*after) < 0.5 * np.hypot(*before)


def test_a_joint_without_a_drive_is_moved_by_the_others_in_mujoco(planar, recorded):
    # Known truth: the elbow's drive gives nothing, so a model that has none moves as one whose torque there is zero.
    seen = recorded("viscous_friction")
    motion = Motion(seen.t, seen.q, seen.encoders.v, seen.encoders.a)
    tau = seen.tau * [1.0, 0.0]
    loose = replace(planar, actuators=(planar.actuators[0], replace(planar.actuators[1], actuated=False)))
    without, with_it = (rollout_errors(mjcf_text(one), one, motion, tau, starts=4) for one in (loose, planar))
    np.testing.assert_allclose(without, with_it, rtol=1e-9)


@pytest.mark.parametrize("name", HIDDEN)
def test_the_torque_gap_of_what_hides_behind_a_motor_shrinks_in_mujoco(name, corrected, recorded, planar, swing):
    wanted = recorded(name).tau[200:]
    before, after = (
        np.sqrt(np.mean((driven(text, planar, swing)[200:] - wanted) ** 2))
        for text in (mjcf_text(planar), corrected_mjcf(corrected(name)))
    )
    assert after < 0.5 * before


def test_the_gear_is_the_ratio_of_true_to_logged_torque(corrected):
    motor = ElementTree.fromstring(corrected_mjcf(corrected("torque_constant"))).find("actuator/motor")
    assert motor is not None
    assert motor.get("gear") == "0.8"


def test_play_is_a_second_joint_on_the_same_axis(corrected):
    root = ElementTree.fromstring(corrected_mjcf(corrected("backlash")))
    body = next(body for body in root.iter("body") if body.get("name") == "lower")
    motor, play = body.findall("joint")
    assert (motor.get("name"), play.get("name"), play.get("range")) == ("elbow", "elbow_play", "-0.025 0.025")
    assert motor.get("axis") == play.get("axis")


def test_the_limit_of_a_drive_does_not_move_with_a_constant_torque(corrected):
    text = corrected_mjcf(corrected("torque_saturation", "torque_constant"))
    model = mujoco.MjModel.from_xml_string(text)
    np.testing.assert_allclose(model.actuator_forcerange[0], [-9.0, 9.0])
    offset = KnownEffect("torque_offset", "shoulder", (1.0,))
    corrected = corrected_model(corrected().given, (offset, KnownEffect("torque_saturation", "shoulder", (9.0,))))
    model = mujoco.MjModel.from_xml_string(corrected_mjcf(corrected))
    data = mujoco.MjData(model)
    data.ctrl[0] = 100.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(9.0 + 1.0)


def test_a_limit_is_the_effort_of_the_urdf(corrected, tmp_path):
    root = ElementTree.fromstring(corrected_urdf(corrected("torque_saturation"), FILE, tmp_path).split("-->")[-1])
    limit = root.find("joint[@name='shoulder']/limit")
    assert limit is not None
    assert limit.get("effort") == "9.0"


def test_both_files_and_their_notes_are_made(corrected, some_motion, tmp_path):
    urdf, mjcf = model_files(corrected("cogging", "backlash", "load_dependent_friction"), some_motion, folder=tmp_path)
    assert "corrected.urdf: it has no place for cogging (largest amplitude): elbow 0.8." in sentences(urdf.notes)
    assert "corrected.urdf: it has no place for play (gap [rad or m]): elbow 0.05." in sentences(urdf.notes)
    assert "corrected.xml: it has no place for friction that grows with load (ratio): elbow 0.2." in sentences(
        mjcf.notes
    )
    assert re.search(r"corrected\.xml: loaded again with MuJoCo .*, it needs the same torques", sentence(mjcf.notes[0]))


@pytest.mark.parametrize("index", [0, 1], ids=["urdf", "mjcf"])
def test_what_a_file_cannot_say_is_a_comment_in_it(index, corrected, some_motion, tmp_path):
    text = model_files(corrected("load_dependent_friction"), some_motion, folder=tmp_path)[index].text
    comment = text.split("<!--")[-1].split("-->")[0]
    assert "friction that grows with load" in comment
    assert ElementTree.fromstring(text.split("?>")[-1].strip()).tag in ("robot", "mujoco")


def test_the_rollout_is_reported_in_a_sentence(corrected, recorded):
    corrected, seen = corrected("rotor_inertia"), recorded("rotor_inertia")
    motion = Motion(seen.t, seen.q, seen.encoders.v, seen.encoders.a)
    (note,) = sentences(rollout_note(corrected, corrected_mjcf(corrected), motion, seen.tau))
    assert re.search(r"rolled out in MuJoCo for 0\.2 s .*elbow 0\.\d+ rad before and 0\.00\d+ after", note)


def test_a_rotor_that_nobody_knows_is_reported(some_motion, tmp_path):
    robot = load_robot(FILE)
    corrected = corrected_model(robot, (KnownEffect("backlash", "elbow", (0.02,)),))
    notes = sentences(model_files(corrected, some_motion, folder=tmp_path)[1].notes)
    assert any("the rotor inertia of elbow is not known" in note for note in notes)


@pytest.mark.parametrize("name", ["arm3.urdf", "arm3.xml", "fourbar.xml", "parallelogram.urdf", "pendulum.urdf"])
def test_robots_of_all_kinds_get_both_files(name, tmp_path):
    robot = load_robot(ROBOTS / name)
    joint = robot.joint_names[0]
    found = tuple(
        KnownEffect(effect, joint, theta)
        for effect, theta in (("coulomb_friction", (0.3,)), ("torque_offset", (0.2,)), ("encoder_offset", (0.05,)))
    )
    q, v, a = np.random.default_rng(1).standard_normal((3, 30, robot.nv))
    corrected = corrected_model(robot, found)
    for file in model_files(corrected, Motion(np.arange(30.0), 0.1 * q, v, a), folder=tmp_path):
        assert file.text, file.notes


@pytest.mark.parametrize(
    ("finding", "error", "said"),
    [
        (("parasitic_spring", "elbow", (1.0,)), ParameterError, "was given 1 parameters, wanted 2: give those"),
        (("torque_offset", "elbow", (float("nan"),)), ParameterError, "has a parameter that is not finite"),
        (("torque_offset", "wrist", (1.0,)), RobotError, "No joint 'wrist' in this robot"),
    ],
)
def test_a_finding_that_cannot_be_is_refused(planar, finding, error, said):
    with pytest.raises(error, match=said):
        corrected_model(planar, (KnownEffect(*finding),))


def test_a_rollout_that_runs_away_writes_nothing(planar, some_motion, tmp_path, monkeypatch, capfd):
    # MuJoCo warns of it, by default in a file of the working folder and in the terminal.
    monkeypatch.chdir(tmp_path)
    heard = mujoco.get_mju_user_warning()
    rollout_errors(mjcf_text(planar), planar, some_motion, np.full_like(some_motion.q, 1e14), starts=1)
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr() == ("", "")
    assert mujoco.get_mju_user_warning() is heard


def test_a_motion_shorter_than_the_rollout_is_refused(planar, some_motion):
    short = Motion(0.001 * some_motion.t, some_motion.q, some_motion.v, some_motion.a)
    with pytest.raises(RobotError, match=r"The motion is shorter than 0\.2 s: give more of it for a rollout"):
        rollout_errors(mjcf_text(planar), planar, short, some_motion.q)


def test_gravity_of_the_given_file_is_kept(planar, some_motion, tmp_path):
    moon = with_gravity(planar, np.array([0.0, 0.0, -1.62]))
    corrected = corrected_model(moon, (KnownEffect("base_tilt", None, (0.2, -0.1, 0.0)),))
    text = corrected_urdf(corrected, FILE, tmp_path)
    assert urdf_difference(text, robot_of_urdf(corrected), some_motion, None) < 1e-12
    np.testing.assert_allclose(
        inverse_dynamics(robot_of_urdf(corrected), some_motion),
        inverse_dynamics(corrected.robot, some_motion),
        atol=1e-12,
    )


@pytest.fixture
def adjusted(made_up) -> Callable[..., Diagnosis]:
    """A diagnosis of the arm without findings whose model moved."""

    def make(**changes: float) -> Diagnosis:
        moves = tuple(Adjusted(name.replace("_", " "), change, 0.05) for name, change in changes.items())
        return replace(made_up(("shoulder", "elbow"), findings=0, samples=400), adjusted=moves)

    return make


def test_without_moves_it_is_the_given_robot_itself(planar, adjusted):
    assert robot_within_tolerances(planar, adjusted().adjusted) is planar


def test_the_inertia_of_a_link_without_mass_cannot_move(planar, adjusted):
    model = planar.model.copy()
    model.inertias[2] = pin.Inertia(0.0, np.zeros(3), np.diag([0.01, 0.02, 0.02]))
    robot = replace(planar, model=model)
    with pytest.raises(RobotError, match=r"^lower of .*planar2\.urdf has a mass of 0, .*: write the mass"):
        robot_within_tolerances(robot, adjusted(lower_Iyy=0.1).adjusted)
    assert robot_within_tolerances(robot, adjusted(upper_mass=0.1).adjusted) is not robot


def test_masses_that_moved_within_tolerance_are_in_all_corrected_files(planar, adjusted, tmp_path):
    texts, noted = export_texts(adjusted(lower_mass=0.1), planar, folder=tmp_path)
    heavier = 1.1 * planar.model.inertias[2].mass
    assert mujoco.MjModel.from_xml_string(texts["corrected.xml"]).body("lower").mass[0] == pytest.approx(heavier)
    assert pin.buildModelFromXML(texts["corrected.urdf"]).inertias[2].mass == pytest.approx(heavier)
    # Of planar arms gravity is linear in the mass of the lower link, whose centre stays.
    q = np.array([[0.3, 0.4]])
    own = loaded(texts["feedforward.py"])["gravity"](q[0].tolist())
    model = planar.model.copy()
    model.inertias[2] = pin.Inertia(heavier, model.inertias[2].lever, model.inertias[2].inertia)
    np.testing.assert_allclose(own, gravity_torque(replace(planar, model=model), q)[0], atol=1e-9)
    assert "The quantity that moved within tolerance is in the corrected files." in sentences(noted.notes)


def test_a_body_that_cannot_be_becomes_one_with_the_same_torques(planar, adjusted, tmp_path):
    # A moment about one axis above the sum of the others cannot be; planar motion sees this one alone.
    diagnosis = adjusted(lower_Iyy=3.0, lower_mass=0.1)
    wanted = robot_within_tolerances(planar, diagnosis.adjusted)
    texts, noted = export_texts(diagnosis, planar, folder=tmp_path)
    found = replace(planar, model=pin.buildModelFromXML(texts["corrected.urdf"]))
    e = diagnosis.evidence
    plain = replace(wanted, model=wanted.model.copy())
    plain.model.armature = found.model.armature
    motion = Motion(e.t, e.q, e.v, e.a)
    np.testing.assert_allclose(
        inverse_dynamics(found, motion), inverse_dynamics(plain, motion), atol=1e-3 * np.abs(e.tau_measured).max()
    )
    assert "The 2 quantities that moved within tolerance are in the corrected files." in sentences(noted.notes)


def test_moves_that_no_body_can_make_are_reported(planar, adjusted, tmp_path):
    # A first moment that would take more moment about the joint than there is; planar motion sees both.
    texts, noted = export_texts(adjusted(lower_center_x=5.0, lower_mass=0.1), planar, folder=tmp_path)
    assert "corrected.xml" in texts
    assert any("No body can have the inertia that was found for lower" in n for n in sentences(noted.notes))


def test_a_body_that_cannot_be_has_one_of_the_same_torques(planar, lab):
    # Oracle: Pinocchio. Moments about axes across the hinges of a planar arm are seen by no motion.
    change = np.zeros_like(standard_parameters(planar))
    change[[4, 9]] = -5.0, -5.0
    wanted, motion = with_parameters(planar, change), lab.motion(2)
    found = same_torque_bodies(wanted, planar, motion)
    assert all(
        np.linalg.eigvalsh(pseudo_inertia(body.toDynamicParameters())).min() > -1e-9
        for body in found.model.inertias[1:]
    )
    torque = inverse_dynamics(wanted, motion)
    np.testing.assert_allclose(inverse_dynamics(found, motion), torque, atol=1e-4 * np.abs(torque).max())


def test_a_delay_is_whole_in_mujoco_at_short_steps(planar):
    model = mujoco.MjModel.from_xml_string(
        corrected_mjcf(corrected_model(planar, (KnownEffect("input_delay", None, (0.02,)),)))
    )
    model.opt.timestep = 2e-4
    data = mujoco.MjData(model)
    acts = []
    for _ in range(150):
        data.ctrl[:] = 1.0
        mujoco.mj_step(model, data)
        acts.append(data.qfrc_actuator[0] > 0.5)
    assert 2e-4 * (np.argmax(acts) + 1) == pytest.approx(0.02, abs=5e-4)


HELD_OUT = 1.25  # what is stated is left by fits that have not seen a block, what is exported by one that has


def left(robot, recording, diagnosis):
    """What the findings leave of the recorded torque in the band, root mean square."""
    (log,), _ = process_all((recording,), robot)
    known = tuple(effect_of(robot, finding) for finding in findings_in_all_recordings(diagnosis))
    rest = log.band(log.tau - operation_of(robot, log, known).tau)
    return np.sqrt(np.mean(rest**2, axis=0))


@pytest.mark.nightly
@pytest.mark.whole
def test_where_gravity_points_along_the_axis(lab, pendulum, trusted):
    # A hardening spring is in no catalogue: whatever is named in its place, what is stated is what is left.
    robot = trusted(with_gravity(pendulum, np.array([0.0, -9.81, 0.0])))
    motion = lab.motion(1, 3, seconds=20.0, swing=1.5)
    recording = lab.recording(robot, motion, -2.0 * motion.q**3, noise=0.01)
    diagnosis = diagnose(robot, (recording,))
    assert diagnosis.findings
    assert left(robot, recording, diagnosis)[0] < HELD_OUT * diagnosis.joints[0].rms_after


@pytest.mark.nightly
@pytest.mark.whole
def test_friction_under_the_load_of_a_payload(lab, planar2, trusted):
    # Known truth: the friction is a tenth of what the transmission passes with the payload.
    robot, motion = trusted(planar2), lab.motion(2, 3, seconds=10.0, swing=1.5)
    added = np.zeros_like(standard_parameters(robot))
    added[10:] = point_mass_parameters(1.5, np.array([0.0, 0.0, -0.4]))
    heavier = with_parameters(robot, added)
    rubbed = lab.acting(heavier, motion, "load_dependent_friction", "shoulder", 0.1)
    recording = lab.recording(heavier, motion, rubbed, noise=0.02)
    diagnosis = diagnose(robot, (recording,))
    found = {finding.effect: finding for finding in diagnosis.findings}
    ratio = found["load_dependent_friction"].parameters["ratio"]
    value, std = (float(np.ravel(x)[0]) for x in (ratio.value, ratio.std))
    assert abs(value - 0.1) < 2.5 * std < 0.02
    after = np.array([joint.rms_after for joint in diagnosis.joints])
    assert np.all(left(robot, recording, diagnosis) < HELD_OUT * after)
