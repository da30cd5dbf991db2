"""A column map guessed from names. Oracles: layouts of known recorders with the map written by hand, and the reader."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from identification.data.readers.contract_columns import UnknownNamesError
from identification.data.readers.suggested_map import suggested_map
from identification.data.reading import read_recording
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot

ARM = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint")
RTDE = ("target_q", "actual_q", "actual_current", "target_moment")


@pytest.mark.parametrize(
    ("names", "joints", "lines"),
    [
        (  # UR over RTDE; what the controller asks for is no measured torque
            ["timestamp", *(f"{name}_{k}" for name in RTDE for k in range(3))],
            ARM,
            ["t: timestamp", *(f"q.{j}: actual_q_{k}" for k, j in enumerate(ARM)),
             *(f"i.{j}: actual_current_{k}" for k, j in enumerate(ARM)),
             *(f"q_ref.{j}: target_q_{k}" for k, j in enumerate(ARM))],
        ),
        (  # a gripper beyond the joints of the arm
            ["t", *(f"{name}{k}" for name in ("q", "tau") for k in range(4))],
            ARM,
            [*(f"q.{j}: q{k}" for k, j in enumerate(ARM)), *(f"tau.{j}: tau{k}" for k, j in enumerate(ARM)),
             "# q3: of no joint of the robot (a gripper?)"],
        ),
        (  # names of joints, units in the names
            ["time_ms", "elbow_pos_deg", "elbow_torque_Nmm", "elbow_vel"],
            ("elbow",),
            ["t: {from: time_ms, unit: ms}", "q.elbow: {from: elbow_pos_deg, unit: deg}",
             "tau.elbow: {from: elbow_torque_Nmm, unit: Nmm}"],
        ),
        (  # units in which small and large letters meet, which parts words elsewhere
            ["Time [ms]", "J1 angle [deg]", "J2 angle [deg]", "J1 torque [mNm]", "J2 torque [mNm]"],
            ("j1", "j2"),
            ['t: {from: "Time [ms]", unit: ms}', 'q.j1: {from: "J1 angle [deg]", unit: deg}',
             'q.j2: {from: "J2 angle [deg]", unit: deg}', 'tau.j1: {from: "J1 torque [mNm]", unit: mNm}',
             'tau.j2: {from: "J2 torque [mNm]", unit: mNm}'],
        ),
        (
            ["t", "q", "motorCurrent_mA"],
            ("pin",),
            ["q.pin: q", "i.pin: {from: motorCurrent_mA, unit: mA}"],
        ),
        (  # a LeRobot episode, one column a joint
            ["timestamp", *(f"{n}_{j}_flex" for n in ("state", "action") for j in ("elbow", "wrist")), "frame_index"],
            ("elbow_flex", "wrist_flex"),
            ["t: timestamp", "q.elbow_flex: state_elbow_flex", "q.wrist_flex: state_wrist_flex",
             "q_ref.elbow_flex: action_elbow_flex", "q_ref.wrist_flex: action_wrist_flex"],
        ),
        (  # one joint needs no name; signs that YAML reads as its own are quoted
            ["t", "position[0]", "effort[0]"],
            ("pin",),
            ['q.pin: "position[0]"', 'tau.pin: "effort[0]"'],
        ),
        (  # numbers from one on, and names of joints that end in numbers
            ["Time", "jointPos2", "jointPos1", "jointTorque1", "jointTorque2"],
            ("j1", "j2"),
            ["t: Time", "q.j1: jointPos1", "q.j2: jointPos2", "tau.j1: jointTorque1", "tau.j2: jointTorque2"],
        ),
        (  # MuJoCo's names beside those of joints
            ["time", *(f"{n}_{j}" for n in ("qpos", "qvel", "qfrc_actuator", "ctrl") for j in ("pan", "lift"))],
            ("pan", "lift"),
            ["t: time", "q.pan: qpos_pan", "q.lift: qpos_lift", "tau.pan: qfrc_actuator_pan",
             "tau.lift: qfrc_actuator_lift", "q_ref.pan: ctrl_pan", "q_ref.lift: ctrl_lift"],
        ),
        (["stamp", "q.elbow", "tau.elbow"], ("elbow",), ["t: stamp"]),  # what has the right name needs no entry
        (["time", "pos_elbow"], ("elbow", "wrist"), ["t: time", "q.elbow: pos_elbow", "# q.wrist: which column?"]),
    ],
    ids=["rtde", "gripper", "units", "mNm", "mA", "lerobot", "one", "camel", "mujoco", "right", "lacking"],
)  # fmt: skip
def test_the_names_of_known_recorders_are_understood(names, joints, lines):
    assert suggested_map(names, joints).splitlines() == lines


@pytest.mark.parametrize("names", [["price", "size"], ["pos_elbow"], ["time", "price"], ["time", "q_1", "q_2"]])
def test_of_names_that_tell_too_little_nothing_is_suggested(names):
    assert suggested_map(names, ("elbow",)) == ""


def test_a_refusal_of_unknown_names_ends_with_a_map_that_can_be_used(tmp_path, robots):
    # Known truth: the columns as they were written.
    robot = load_robot(robots / "pendulum.urdf")
    (joint,) = robot.joint_names
    t = np.arange(200) * 5.0
    table = np.column_stack([t, np.rad2deg(np.sin(t / 500)), np.cos(t / 500)])
    names = f"time_ms,{joint}_deg,{joint}_torque"
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=names, comments="")
    with pytest.raises(LogError, match=r"has none of a log's columns.*A map to begin with") as refusal:
        read_recording(tmp_path / "log.csv", robot)
    (tmp_path / "columns.yaml").write_text(str(refusal.value).partition("columns.yaml:\n")[2])
    read = read_recording(tmp_path / "log.csv", robot, columns=tmp_path / "columns.yaml")
    np.testing.assert_allclose(read.t, t / 1000)
    np.testing.assert_allclose(read.q[:, 0], np.sin(t / 500), atol=1e-9)


def test_the_refusal_comes_through_another_process_whole():
    # Oracle: pickle, by which processes of a batch send it.
    sent = pickle.loads(pickle.dumps(UnknownNamesError("no column t.", ("a", "b"))))
    assert (str(sent), sent.names) == ("no column t.", ("a", "b"))


def test_a_map_that_was_given_gets_no_other(tmp_path, robots):
    (tmp_path / "log.csv").write_text("time,pin_pos\n0,1\n1,2\n")
    (tmp_path / "columns.yaml").write_text("t: time\n")
    with pytest.raises(LogError, match="has no column q") as refusal:
        read_recording(tmp_path / "log.csv", load_robot(robots / "pendulum.urdf"), columns=tmp_path / "columns.yaml")
    assert "\n" not in str(refusal.value)
