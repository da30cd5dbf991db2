# pyright: reportAttributeAccessIssue=false
"""Where the centre of a known payload counts from. Known truth: Pinocchio's model with a ball on it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
import yaml

from identification.data.reading import read_recording
from identification.pipeline import diagnose
from identification.scenarios.recordings_file import read_changes
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

pytestmark = pytest.mark.whole

LINK = """<link name="{0}"><inertial><origin xyz="{2}"/><mass value="{1}"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
TIP = """<link name="tip"/><joint name="to_tip" type="fixed"><parent link="{0}"/><child link="tip"/>
<origin xyz="0.1 0 -0.35" rpy="0 0.6 0"/></joint>"""
TROLLEY = f"""<robot name="trolley"><link name="rail"/>{LINK.format("cart", 2.0, "0 0 0")}
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-2" upper="2" effort="100" velocity="5"/><dynamics damping="0.5" friction="0.5"/></joint>
{LINK.format("rod", 0.8, "0 0 -0.2")}
<joint name="swing" type="revolute"><parent link="cart"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="30" velocity="8"/><dynamics damping="0.05" friction="0.05"/></joint>
{TIP.format("rod")}</robot>"""
LEVER = f"""<robot name="lever"><link name="wall"/>{LINK.format("beam", 1.4, "0.05 0 -0.25")}
<joint name="hinge" type="revolute"><parent link="wall"/><child link="beam"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="60" velocity="12"/></joint>{TIP.format("beam")}</robot>"""


def moving(rows, seed, seconds=14.0, size=1.0):
    """Three sines of known derivatives at 100 Hz."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(100 * seconds)) / 100.0
    w = 2 * np.pi * np.array([0.23, 0.61, 1.13])
    angle = t[:, None, None] * w + rng.uniform(0, 2 * np.pi, (rows, 3))
    part = size * rng.uniform(0.3, 0.5, (rows, 3)) / (1 + w / (2 * np.pi))
    columns = part * np.sin(angle), part * w * np.cos(angle), -part * w**2 * np.sin(angle)
    return Motion(t, *(column.sum(axis=2) for column in columns))


def written(folder, name, robot, motion, *, ball=None, scale=1.0, seed=0):
    """A log of a robot that carries a ball, its mass and its centre in the frame of a name; the torque is scaled."""
    model = robot.model.copy()
    if ball is not None:
        mass, center, frame = ball
        at = model.frames[model.getFrameId(frame)]
        point = pin.Inertia(mass, np.array(center), np.zeros((3, 3)))
        model.appendBodyToJoint(at.parentJoint, point, at.placement)
    rng = np.random.default_rng([3, seed])
    tau = scale * inverse_dynamics(replace(robot, model=model), motion)
    tau = tau + 0.01 * rng.standard_normal(tau.shape)
    table = np.column_stack([motion.t, motion.q + 1e-5 * rng.standard_normal(tau.shape), tau])
    head = ["t", *(f"{kind}.{joint}" for kind in ("q", "tau") for joint in robot.joint_names)]
    np.savetxt(folder / name, table, delimiter=",", header=",".join(head), comments="")
    return folder / name


def loaded(folder, urdf, config=""):
    """The robot of a URDF and of a ``robot.yaml``."""
    (folder / "robot.urdf").write_text(urdf)
    (folder / "robot.yaml").write_text(config)
    return load_robot(folder / "robot.urdf")


def together(robot, logs, changes):
    """The diagnosis of logs and of what a ``recordings.yaml`` says."""
    known = read_changes(changes, logs, robot.joint_names)
    return diagnose(robot, tuple(read_recording(log, robot) for log in logs), changes=known)


@pytest.mark.parametrize(("config", "frame"), [("", "swing"), ("payload_frame: tip", "tip")])
def test_a_known_payload_where_the_file_says_is_no_gap(tmp_path, config, frame):
    # A frame called tip counts where it is stated, and the joint where none is.
    robot = loaded(tmp_path, TROLLEY, config)
    ball = (0.4, (0.05, 0.0, -0.3), frame)
    logs = (
        written(tmp_path, "bare.csv", robot, moving(2, 1)),
        written(tmp_path, "held.csv", robot, moving(2, 2), ball=ball, seed=1),
    )
    changes = tmp_path / "recordings.yaml"
    changes.write_text("recordings:\n  - {file: held.csv, payload: {mass: 0.4, center: [0.05, 0, -0.3]}}\n")
    assert together(robot, logs, changes).verdict == "no_gap"


def test_the_centre_that_a_finding_prints_is_no_gap_in_the_next_diagnosis(tmp_path):
    robot = loaded(tmp_path, TROLLEY)
    ball = (0.4, (0.05, 0.0, -0.3), "swing")
    held = written(tmp_path, "held.csv", robot, moving(2, 2), ball=ball, seed=1)
    (found,) = diagnose(robot, (read_recording(held, robot),)).findings
    assert found.effect == "payload"
    # The arm is planar, so that nothing shows the centre's place along the axis.
    # The mass shows by the trolley's inertia alone, which a rotor makes as well, so that moments are stated beside it.
    mass, *moments = (found.parameters[name].value for name in ("mass", "moment_x", "moment_z"))
    x, z = (moment / mass for moment in moments)
    changes = tmp_path / "recordings.yaml"
    changes.write_text(f"recordings: [{{file: held.csv, payload: {{mass: {mass}, center: [{x}, 0, {z}]}}}}]")
    bare = written(tmp_path, "bare.csv", robot, moving(2, 1))
    assert together(robot, (bare, held), changes).verdict == "no_gap"


NUMBER = r"(-?[0-9][0-9.e-]*)"


@pytest.mark.parametrize("config", ["", "payload_frame: tip"])
def test_the_proposed_experiment_done_to_the_letter_names_the_truth(tmp_path, config):
    # Known truth: the drive gives 0.8 of its torque. Without friction a load explains one recording as well.
    robot = loaded(tmp_path, LEVER, config)
    first = written(tmp_path, "first.csv", robot, moving(1, 5), scale=1.25)
    found = diagnose(robot, (read_recording(first, robot),))
    assert "payload" in {at.effect for one in found.findings for rival in one.rivals for at in rival.effects}
    assert found.next_experiment is not None
    assert found.next_motion is not None
    say = found.next_experiment["say"]
    asked = re.search(rf"a known mass of {NUMBER} kg at \({NUMBER}, {NUMBER}, {NUMBER}\) m of (.*?) \(", say)
    entry = re.search(r"write (payload: \{.*?\}) beside its file name in recordings\.yaml", say)
    assert asked is not None
    assert entry is not None
    mass, *center = (float(word) for word in asked.groups()[:4])
    place = asked.group(5).rsplit(" ", 1)[1]
    assert place == ("tip" if config else "hinge")
    second = written(tmp_path, "second.csv", robot, found.next_motion, ball=(mass, center, place), scale=1.25, seed=1)
    changes = tmp_path / "recordings.yaml"
    changes.write_text(yaml.safe_dump({"recordings": [{"file": "second.csv"} | yaml.safe_load(entry.group(1))]}))
    after = together(robot, (first, second), changes)
    (finding,) = after.findings
    assert (finding.effect, finding.rivals) == ("torque_constant", ())
    assert finding.parameters["ratio"].value == pytest.approx(0.8, abs=0.01)
