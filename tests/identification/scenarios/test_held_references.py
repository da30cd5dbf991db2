"""References that are held until the next row, of an arm whose MJCF states its gains; known truth: a simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.data.signals import process
from identification.scenarios.motion_only import motion_robot, states_controllers, with_commanded_torque
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.simulation.control import position_control
from phantom_dyn.simulation.simulate import simulate

KP, KV = np.array([40.0, 25.0]), np.array([3.0, 2.0])
ARM = f"""<mujoco><compiler angle="radian"/>
  <worldbody><body name="upper"><joint name="lift" axis="0 1 0" damping="0.3"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1.2"/>
    <body name="lower" pos="0 0 -0.3"><joint name="slide" type="slide" axis="1 0 0" damping="0.5"/>
      <geom type="box" size="0.1 0.03 0.03" mass="0.8"/></body></body></worldbody>
  <actuator><position name="a" joint="lift" kp="{KP[0]}" kv="{KV[0]}"/>
    <position name="b" joint="slide" kp="{KP[1]}" kv="{KV[1]}"/></actuator></mujoco>"""


@pytest.fixture(scope="module")
def servo_arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    return load_robot(path)


def held(robot, rate: float) -> Recording:
    """20 s of servos at 2 kHz whose references stay between rows; the log has a row for each."""
    t, every = np.arange(40000) / 2000.0, round(2000.0 / rate)
    q_ref = np.stack([0.4 * np.sin(2.1 * t) + 0.2 * np.sin(5.3 * t + 1), 0.1 * np.sin(3.1 * t + 0.4)], axis=1)
    stairs = np.repeat(q_ref[::every], every, axis=0)[: len(t)]
    q = simulate(robot, (), position_control(t, stairs, 0 * stairs, kp=KP, kd=KV), t, stairs[0]).q[::every]
    return Recording("held.csv", robot.joint_names, t[::every], q, None, q_ref=stairs[::every])


def left(robot, recording: Recording) -> np.ndarray:
    """What the torque that the stated gains ask for leaves of the model, over the torque, root mean squares."""
    log = process(with_commanded_torque(recording, robot), motion_robot(robot))
    inside = slice(len(log.motion.t) // 20, -len(log.motion.t) // 20)
    rest = (log.tau - inverse_dynamics(robot, log.motion))[inside]
    return np.sqrt((rest**2).mean(axis=0) / (log.tau[inside] ** 2).mean(axis=0))


@pytest.mark.parametrize("rate", [30.0, 50.0])
def test_the_gains_of_the_file_and_held_references_leave_nothing_of_an_arm(servo_arm, rate):
    # Closed form: taken as instant, references are half a row late.
    assert states_controllers(servo_arm)
    recording = held(servo_arm, rate)
    as_held = left(replace(servo_arm, reference_hold="zoh"), recording)
    instant = left(replace(servo_arm, reference_hold="instant"), recording)
    assert (as_held < 0.1).all()
    assert (as_held < 0.3 * instant).all()
