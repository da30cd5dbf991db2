"""Joints that something moves with a torque that nobody knows; known truth: friction in closed form."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import phantom_dyn as dyn
from by_night import by_night
from identification.data.checks.check_recording import Checked, checked
from identification.data.reading import read_recording
from identification.diagnosis.columns.prepared import prepared
from identification.pipeline import diagnose
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS

RUBS = 0.4
UNKNOWN, IDLE = "shoulder", "elbow"


def arm(folder: Path, *lines: str) -> Robot:
    config = folder / "robot.yaml"
    config.write_text("joints:\n" + "".join(f"  {line}\n" for line in lines))
    return load_robot(ROBOTS / "planar2.urdf", config=config)


def logged(robot: Robot, lab, folder: Path, joint: str, *columns: str, garbage: bool = False) -> Path:
    """A log of positions and of the torques of some joints; ``joint`` rubs with more than the model knows."""
    motion = lab.motion(robot.nv, 4, seconds=20.0, swing=1.2)
    rng, rubs = np.random.default_rng(5), robot.joint_names.index(joint)
    tau = inverse_dynamics(robot, motion)
    tau[:, rubs] += RUBS * motion.v[:, rubs]
    tau += 0.01 * rng.standard_normal(tau.shape)
    if garbage:
        tau[:, robot.joint_names.index(UNKNOWN)] = rng.standard_normal(len(tau))
    q = motion.q + 1e-5 * rng.standard_normal(tau.shape)
    table = {"t": motion.t} | {f"q.{name}": q[:, k] for k, name in enumerate(robot.joint_names)}
    table |= {f"tau.{name}": tau[:, robot.joint_names.index(name)] for name in columns}
    path = folder / "log.npz"
    np.savez(path, **table)
    return path


@pytest.mark.parametrize("garbage", by_night([False, True], 1))
@pytest.mark.whole
def test_friction_of_the_other_joint_is_found_whatever_the_torque_of_the_unknown_drive(tmp_path, lab, garbage):
    robot = arm(tmp_path, f"{UNKNOWN}: {{drive: unknown}}")
    columns = (IDLE, UNKNOWN) if garbage else (IDLE,)
    diagnosis = dyn.diagnose(robot, logged(robot, lab, tmp_path, IDLE, *columns, garbage=garbage))
    (found,) = diagnosis.findings
    assert (found.effect, found.joint) == ("viscous_friction", IDLE)
    assert found.parameters["coefficient"].value == pytest.approx(RUBS, rel=0.1)


@pytest.mark.whole
def test_what_the_unknown_drive_has_to_overcome_is_not_judged(tmp_path, lab):
    robot = arm(tmp_path, f"{UNKNOWN}: {{drive: unknown}}")
    diagnosis = diagnose(robot, (read_recording(logged(robot, lab, tmp_path, UNKNOWN, IDLE), robot),))
    assert not diagnosis.findings
    (row,) = (one for one in diagnosis.joints if one.joint == UNKNOWN)
    assert row.rms_torque is None
    assert row.hold_out_samples == 0
    assert any("is not known" in one.why for one in diagnosis.not_testable if one.joint == UNKNOWN)
    assert any(f"torque of {UNKNOWN} is not known" in str(said) for said in diagnosis.data_warnings)


def test_a_log_without_any_torque_names_the_entry(tmp_path, lab):
    robot = load_robot(ROBOTS / "planar2.urdf")
    with pytest.raises(LogError, match="drive: unknown"):
        read_recording(logged(robot, lab, tmp_path, IDLE), robot)


def test_checks_find_nothing_wrong_with_a_torque_that_nobody_knows(tmp_path, lab):
    robot = arm(tmp_path, f"{UNKNOWN}: {{drive: unknown}}")
    recording = read_recording(logged(robot, lab, tmp_path, IDLE, IDLE), robot)
    assert checked(recording, robot) == Checked((), ())


@pytest.mark.whole
def test_a_joint_with_lost_readings_is_not_judged_and_the_friction_of_the_other_is_found(tmp_path, lab):
    # Known truth: three in ten rows of one torque are lost, which fits a wrong torque constant.
    robot = arm(tmp_path, f"{IDLE}: {{}}")
    path = logged(robot, lab, tmp_path, IDLE, IDLE, UNKNOWN)
    table = dict(np.load(path))
    table[f"tau.{UNKNOWN}"][np.random.default_rng(3).random(len(table["t"])) < 0.3] = 0.0
    np.savez(path, **table)
    diagnosis = diagnose(robot, (read_recording(path, robot),))
    assert [(one.effect, one.joint) for one in diagnosis.findings] == [("viscous_friction", IDLE)]
    assert any(f"A diagnosis does not judge {UNKNOWN}" in str(said) for said in diagnosis.data_warnings)


def test_a_torque_that_is_compared_with_the_model_was_read(tmp_path, lab):
    # Known truth: without lost readings the log has neither a warning nor a fault.
    robot = arm(tmp_path, f"{IDLE}: {{}}")
    path = logged(robot, lab, tmp_path, IDLE, IDLE, UNKNOWN)
    assert read_recording(path, robot).warnings == ()
    table = dict(np.load(path))
    table[f"tau.{UNKNOWN}"][np.random.default_rng(3).random(len(table["t"])) < 0.8] = 0.0
    np.savez(path, **table)
    (said,) = read_recording(path, robot).warnings
    assert "these rows are no readings of its torque" in said


def test_a_log_of_which_no_torque_was_read_is_refused(tmp_path, lab):
    # Known truth: the lost readings of all torques.
    robot = arm(tmp_path, f"{IDLE}: {{}}")
    recording = read_recording(logged(robot, lab, tmp_path, IDLE, IDLE, UNKNOWN), robot)
    with pytest.raises(LogError, match=f"the torque of {UNKNOWN}, {IDLE} was not read in every row"):
        prepared(robot, (replace(recording, unread=robot.joint_names),))
