"""What a voltage shows of a drive. Known truth: constants and friction of a simulated motor, in closed form."""

import numpy as np
import pytest

import phantom_dyn as dyn
from identification.notes import Code
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.motion import Motion

# Torque constant [N m/A], resistance [Ohm] and viscous friction [N m s/rad] of the motor.
CONSTANT, RESISTANCE, VISCOUS = 1.0, 1.25, 0.3
TRUE_SUM = CONSTANT**2 / RESISTANCE + VISCOUS

URDF = """<robot name="lever"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.15"/><mass value="0.8"/>
<inertia ixx="0.003" ixy="0" ixz="0" iyy="0.003" iyz="0" izz="0.0005"/></inertial></link>
<joint name="servo" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.mark.parametrize("factor", [1.0, 1.2])
def test_the_sum_does_not_depend_on_the_stated_constants(tmp_path, rng, factor):
    # The same torque per volt from another constant and resistance: back-EMF and friction change places.
    (tmp_path / "lever.urdf").write_text(URDF)
    (tmp_path / "robot.yaml").write_text(
        f"joints: {{servo: {{torque_constant: {factor * CONSTANT}, resistance: {factor * RESISTANCE}}}}}\n"
    )
    robot = dyn.load_robot(tmp_path / "lever.urdf")
    t, w = np.arange(0, 20.0, 0.01), 2 * np.pi * np.array([0.23, 0.61, 0.97])
    q, v, a = (
        (0.5 * x).sum(axis=1)[:, None]
        for x in (np.sin(t[:, None] * w), w * np.cos(t[:, None] * w), -(w**2) * np.sin(t[:, None] * w))
    )
    torque = inverse_dynamics(robot, Motion(t, q, v, a)) + VISCOUS * v
    volts = (torque + CONSTANT**2 / RESISTANCE * v) * RESISTANCE / CONSTANT + 0.02 * rng.standard_normal(v.shape)
    path = tmp_path / "log.csv"
    np.savetxt(path, np.hstack([t[:, None], q, volts]), delimiter=",", header="t,q.servo,u.servo", comments="")
    found = dyn.diagnose(robot, str(path))
    (note,) = [one for one in found.result.notes if not isinstance(one, str) and one.code is Code.DRIVE_SUM]
    assert note.joint == "servo"
    assert abs(note.numbers["sum"] - TRUE_SUM) < 3 * note.numbers["std"] + 0.003
    assert note.numbers["back_emf"] == pytest.approx(factor * CONSTANT**2 / RESISTANCE)


def test_a_torque_has_no_such_sum(tmp_path):
    robot = dyn.load_robot("example:double_pendulum")
    t = np.arange(0, 20.0, 0.01)
    w = 2 * np.pi * np.array([0.23, 0.41])
    q, v, a = (0.6 * x for x in (np.sin(t[:, None] * w), w * np.cos(t[:, None] * w), -(w**2) * np.sin(t[:, None] * w)))
    torque = inverse_dynamics(robot, Motion(t, q, v, a)) + 0.3 * v
    names = ",".join(f"{kind}.{joint}" for kind in ("q", "tau") for joint in robot.joint_names)
    path = tmp_path / "log.csv"
    np.savetxt(path, np.hstack([t[:, None], q, torque]), delimiter=",", header=f"t,{names}", comments="")
    found = dyn.diagnose(robot, str(path))
    assert {one.effect for one in found.findings} == {"viscous_friction"}
    assert not [one for one in found.result.notes if not isinstance(one, str) and one.code is Code.DRIVE_SUM]
