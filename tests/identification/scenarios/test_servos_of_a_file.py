# pyright: reportAttributeAccessIssue=false
"""Servos of a MJCF: gains of a velocity servo beside a position servo, and filters in front of them."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest

from identification.data.checks.smoothed_copy import included
from identification.data.reading import read_recording
from identification.data.recording import Recording
from identification.scenarios.motion_only import limited_controller_torque
from identification.scenarios.torque_or_motion import driven_by_controllers, torque_or_motion
from identification.words.note_words import sentences
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot

LEVER = """<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/><worldbody>
  <body><joint name="tilt" axis="0 1 0" damping="0.02"/>
    <inertial pos="0.045 0 0.02" mass="0.6" diaginertia="0.0011 0.0013 0.0009"/></body></worldbody>
  <actuator>{}</actuator></mujoco>"""
SERVO = '<position joint="tilt" kp="8" kv="0.3"/>'
FILTERED = '<position joint="tilt" kp="8" kv="0.3" timeconst="0.05"/>'
GENERAL = (
    '<general joint="tilt" dyntype="filter" dynprm="0.05" gainprm="8" biastype="affine" biasprm="0 -8 -0.3" gear="1"/>'
)
BOTH = '<position joint="tilt" kp="8"/><velocity joint="tilt" kv="0.3"/>'

Moved = tuple[Robot, Recording, np.ndarray]


@pytest.fixture
def moved(tmp_path: Path) -> Callable[[str], Moved]:
    """Robot of a file with the given actuators, the log that MuJoCo makes of it, and the torque of its actuators."""

    def run(actuators: str) -> Moved:
        (tmp_path / "lever.xml").write_text(LEVER.format(actuators))
        model = mujoco.MjModel.from_xml_path(str(tmp_path / "lever.xml"))
        data, rows = mujoco.MjData(model), []
        for step in range(20000):
            t = step * 5e-4
            data.ctrl[0] = 0.6 * np.sin(7 * t) + 0.3 * np.sin(2 * t)
            if step % 40 == 0:
                mujoco.mj_forward(model, data)
                rows.append([t, data.qpos[0], data.ctrl[0], data.qfrc_actuator[0]])
            mujoco.mj_step(model, data)
        log = np.array(rows)
        np.savetxt(tmp_path / "log.csv", log[:, :3], delimiter=",", header="t,q.tilt,q_ref.tilt", comments="")
        robot = load_robot(tmp_path / "lever.xml")
        return robot, read_recording(tmp_path / "log.csv", robot, torque_needed=False), log[:, 3]

    return run


@pytest.mark.parametrize("actuators", [SERVO, FILTERED, GENERAL, BOTH])
def test_the_torque_of_a_servo_is_that_of_mujoco(moved, actuators):
    # Oracle: MuJoCo's forces of the actuators; the rest are differences of positions between rows of 20 ms.
    robot, recording, torque = moved(actuators)
    gains = robot.actuators[0].controller
    assert gains is not None
    assert (gains.kp, gains.kd) == (8.0, 0.3)
    kept = included(recording)
    assert recording.excluded == (((0.0, 0.4),) if robot.actuators[0].reference_lag else ())
    differences = (limited_controller_torque(recording, robot)[:, 0] - torque)[kept]
    # The first rows have a jump of the torque. MuJoCo holds a control for a step, so its filter is half a step late.
    assert np.abs(differences[10:-1]).max() < 0.05 * np.ptp(torque)


def test_the_filter_is_reported_with_the_gains(moved):
    robot, recording, _ = moved(FILTERED)
    robot, recordings, _ = torque_or_motion(robot, lambda needed: (recording,), motion_only=True)
    _, (driven,) = driven_by_controllers(robot, recordings)
    (said,) = sentences(driven.notes)
    assert "of the robot's file state (tilt kp 8, kd 0.3, references behind a filter of 0.05 s)" in said


def test_a_delay_that_robot_yaml_states_stands_for_the_filter(moved, tmp_path):
    moved(FILTERED)
    (tmp_path / "robot.yaml").write_text(
        "joints: {tilt: {controller: {kind: pd, kp: 8, kd: 0.3, reference_delay: 0.05}}}"
    )
    assert load_robot(tmp_path / "lever.xml").actuators[0].reference_lag == 0


@pytest.mark.parametrize(
    "second", ['<motor joint="tilt"/>', '<position joint="tilt" kp="3"/>', '<intvelocity joint="tilt" kp="3"/>']
)
def test_gains_are_not_known_where_another_actuator_acts_too(moved, second):
    assert moved(SERVO + second)[0].actuators[0].controller is None


def test_the_largest_torque_of_two_servos_is_the_sum(moved):
    limited = BOTH.replace('kp="8"', 'kp="8" forcerange="-2 2"').replace('kv="0.3"', 'kv="0.3" forcerange="-1 1"')
    assert moved(limited)[0].actuators[0].torque_limit == 3.0
    assert moved(limited.replace('forcerange="-1 1"', ""))[0].actuators[0].torque_limit is None
