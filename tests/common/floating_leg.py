# pyright: reportAttributeAccessIssue=false
"""A leg of two joints on a base that moves: its file, and logs whose torques Pinocchio computes for a free-flyer."""

from pathlib import Path

import numpy as np
import pinocchio as pin

Array = np.ndarray

BODY = """<inertial><origin xyz="0.01 0 -0.1"/><mass value="{mass}"/>
<inertia ixx="0.004" iyy="0.004" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>"""
URDF = f"""<robot name="leg"><link name="trunk">{BODY.format(mass=4)}</link><link name="imu"/><link name="foot"/>
<link name="thigh">{BODY.format(mass=1)}</link><link name="shank">{BODY.format(mass=0.4)}</link>
<joint name="at" type="fixed"><parent link="trunk"/><child link="imu"/><origin xyz="0.1 -0.05 0.08" rpy="0.4 0.1 2"/>
</joint><joint name="hip" type="revolute"><parent link="trunk"/><child link="thigh"/><origin xyz="0.2 0.1 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="90" velocity="90"/><dynamics friction="0.2" damping="0.05"/>
</joint><joint name="knee" type="revolute"><parent link="thigh"/><child link="shank"/><origin xyz="0 0 -0.2"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="90" velocity="90"/><dynamics friction="0.2" damping="0.05"/>
</joint><joint name="end" type="fixed"><parent link="shank"/><child link="foot"/><origin xyz="0 0 -0.2"/></joint>
</robot>"""
FRICTION, DAMPING = 0.2, 0.05
RATE = 500.0
TURN, SCALE, OFFSET = 0.02, np.array([0.99, 1.01, 1.012]), np.array([0.15, -0.2, 0.1])
LATE = 0.003


def written_leg(folder: Path) -> Path:
    """The file of the robot, with its settings beside it."""
    (folder / "robot.urdf").write_text(URDF)
    (folder / "robot.yaml").write_text("base: floating\n")
    return folder / "robot.urdf"


def _waves(t: Array, size: float, count: int, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Sums of three sines with their two derivatives, ``(N, count)`` each."""
    out = np.zeros((3, len(t), count))
    for _ in range(3):
        w, start = 2 * np.pi * rng.uniform(0.3, 2.2, count), rng.uniform(0, 6, count)
        phase = w * t[:, None] + start
        out += size / 3 * np.array([np.sin(phase), w * np.cos(phase), -(w**2) * np.sin(phase)])
    return out[0], out[1], out[2]


def with_sensor_errors(columns: dict[str, Array]) -> dict[str, Array]:
    """Columns of a log whose inertial sensor is turned a little, late, and wrong by ordinary scales and offsets."""
    turn, t, out = pin.exp3(TURN * np.array([1.0, -0.6, 0.3])), columns["t"], dict(columns)
    for quantity, offset in (("w", 0.1 * OFFSET), ("sf", OFFSET)):
        names = [f"{quantity}.imu.{axis}" for axis in "xyz"]
        read = np.column_stack([columns[name] for name in names]) @ turn.T * SCALE + offset
        out |= {name: np.interp(t - LATE, t, x) for name, x in zip(names, read.T, strict=True)}
    return out


def log_of_leg(
    robot: Path, rng: np.random.Generator, *, dry: float = 0.0, steps: bool = False, seconds: float = 24.0
) -> dict[str, Array]:
    """Columns of a log.

    Args:
        robot: Its file.
        rng: Draws motion and noise.
        dry: Friction torque of the knee beyond the model's [N m].
        steps: The foot stands on the ground half of the time, with whatever torque that takes.
        seconds: Length.
    """
    free = pin.buildModelFromUrdf(str(robot), pin.JointModelFreeFlyer())
    data, imu = free.createData(), free.getFrameId("imu")
    t = np.arange(int(RATE * seconds)) / RATE
    q, v, a = _waves(t, 1.0, 2, rng)
    _, w, dw = _waves(t, 0.3, 3, rng)
    _, fast, faster = _waves(t, 0.2, 3, rng)
    turn = np.eye(3)
    tau, sensed = np.empty((len(t), 2)), np.empty((len(t), 6))
    for k in range(len(t)):
        turn = turn @ pin.exp3(w[k] / RATE)
        there = np.concatenate([np.zeros(3), pin.Quaternion(turn).coeffs(), q[k]])
        speed, gain = np.concatenate([fast[k], w[k], v[k]]), np.concatenate([faster[k], dw[k], a[k]])
        tau[k] = pin.rnea(free, data, there, speed, gain)[6:]
        pin.forwardKinematics(free, data, there, speed, gain)
        placed = pin.updateFramePlacement(free, data, imu).rotation
        sensed[k, :3] = pin.getFrameVelocity(free, data, imu, pin.LOCAL).angular
        felt = pin.getFrameClassicalAcceleration(free, data, imu, pin.LOCAL).linear
        sensed[k, 3:] = felt - placed.T @ free.gravity.linear
    tau += DAMPING * v + (FRICTION + np.array([0.0, dry])) * np.sign(v) + 0.03 * rng.normal(size=tau.shape)
    sensed += np.repeat([0.002, 0.03], 3) * rng.normal(size=sensed.shape)
    stands = ((t % 1.2) > 0.6) & steps
    tau += stands[:, None] * np.column_stack([20 + 8 * np.sin(9 * t), -15 + 6 * np.cos(7 * t)])
    out = {"t": t, "q.hip": q[:, 0], "q.knee": q[:, 1], "tau.hip": tau[:, 0], "tau.knee": tau[:, 1]}
    names = [f"{quantity}.imu.{axis}" for quantity in ("w", "sf") for axis in "xyz"]
    return out | dict(zip(names, sensed.T, strict=True)) | {"contact.foot": stands.astype(float)}
