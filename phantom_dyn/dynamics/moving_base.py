# pyright: reportAttributeAccessIssue=false
r"""Motion of a floating base from its sensors, and dynamics of the robot without the unknown forces on its feet.

An accelerometer measures the specific force, which is acceleration minus gravity. Recursive Newton-Euler needs only the
specific force and the angular motion of the root, and neither position nor velocity of the root. If an accelerometer at
the place ``p`` measures :math:`f_s`, the specific force at the origin of the root is
:math:`f = f_s - \dot\omega \times p - \omega \times (\omega \times p)`.

**Feet on the ground.** The base and the joints obey :math:`M a + h = S\tau + J^T f` with the forces :math:`f` at the
points of contact. If the columns of :math:`N` span the null space of :math:`J`, then :math:`N^T J^T f = 0`, so that
:math:`N^T (M a + h) = N^T S\tau` does not contain the forces. In all arrays the six rows of the base come first, force
before moment, in the root's axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.linalg import null_space

from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, link_torque
from phantom_dyn.errors import RobotError, known_names
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion, Motion


def place_on_base(robot: Robot, frame: str) -> pin.SE3:
    """Pose of a frame that is fixed to the base, in the frame of the root.

    Raises:
        RobotError: If the robot has no such frame, or a joint moves it.
    """
    fixed = [one.name for one in robot.model.frames if one.parentJoint == 0]
    if not robot.model.existFrame(frame):
        raise RobotError(f"{robot.name} has no frame {frame!r}, {known_names(frame, fixed, 'frames')}")
    found = robot.model.frames[robot.model.getFrameId(frame)]
    if found.parentJoint != 0:
        mover = robot.model.names[found.parentJoint]
        raise RobotError(
            f"{frame} does not move with the base, as {mover} turns it: give the readings of a sensor on the base, in "
            "the axes of a frame that is fixed to it."
        )
    return found.placement


def any_base_motion(rng: np.random.Generator, count: int) -> BaseMotion:
    """Random independent samples of a base in motion: angular velocity, angular acceleration and specific force."""
    return BaseMotion(*(size * rng.normal(size=(count, 3)) for size in (2.0, 10.0, 10.0)))


def base_motion(
    robot: Robot,
    gyroscope: str,
    accelerometer: str,
    w: Float[Array, "N 3"],
    dw: Float[Array, "N 3"],
    force: Float[Array, "N 3"],
) -> BaseMotion:
    """Motion of the root from the readings of the sensors on it.

    Args:
        robot: Robot with both frames.
        gyroscope: Frame in whose axes ``w`` and ``dw`` are.
        accelerometer: Frame in whose axes, and at whose origin, ``force`` is.
        w: Angular velocity [rad/s].
        dw: Angular acceleration [rad/s^2].
        force: Specific force [m/s^2]; at rest it points upwards and is as large as gravity.

    Raises:
        RobotError: If a frame is unknown or not fixed to the base.
    """
    rotation, place = place_on_base(robot, gyroscope).rotation, place_on_base(robot, accelerometer)
    w_root, dw_root, lever = w @ rotation.T, dw @ rotation.T, place.translation
    at_root = force @ place.rotation.T - np.cross(dw_root, lever) - np.cross(w_root, np.cross(w_root, lever))
    return BaseMotion(w_root, dw_root, at_root)


def torque_jacobian_of_base(robot: Robot, motion: Motion) -> Float[Array, "N nv 9"]:
    """Derivatives of the joint torques by angular velocity, angular acceleration and specific force of the root.

    The torque is quadratic in the angular velocity, so that central differences are exact, and linear in the others, so
    that one-sided differences are exact.

    Args:
        robot: The robot.
        motion: N samples, with the motion of the root.
    """
    assert motion.base is not None
    given, out = motion.base.columns, np.empty((*motion.q.shape, 9))

    def torque(column: int, step: float) -> Array:
        moved = given.copy()
        moved[:, column] += step
        return link_torque(robot, replace(motion, base=BaseMotion(*np.split(moved, 3, axis=1))))

    plain = torque(0, 0.0)
    for k in range(9):
        out[:, :, k] = (torque(k, 1.0) - torque(k, -1.0)) / 2.0 if k < 3 else torque(k, 1.0) - plain
    return out


def wrench_and_torque(robot: Robot, motion: Motion) -> Float[Array, "N n"]:
    """Force and moment on the base, and torque of every joint, that the given model needs for a motion.

    Args:
        robot: Robot with a floating base and without closed loops.
        motion: Motion of the joints, with the motion of the root.
    """
    base = motion.base
    assert base is not None
    free = free_flyer(robot)
    data, out = free.createData(), np.empty((len(motion.t), 6 + robot.nv))
    q = _with_root_at_origin(robot, motion.q)
    # In a model without gravity the specific force is the acceleration of the root; its velocity does not matter.
    still = np.zeros_like(base.f)
    v, a = np.hstack([still, base.w, motion.v]), np.hstack([base.f, base.dw, motion.a])
    for k in range(len(q)):
        out[k, :6] = pin.rnea(free, data, q[k], v[k], a[k])[:6]
    out[:, 6:] = inverse_dynamics(robot, motion)
    return out


def contact_jacobian(robot: Robot, q: Float[Array, " nv"], frames: Sequence[str]) -> Float[Array, "f n"]:
    """Jacobian of the velocities of the origins of frames by velocities of base and joints, in the root's axes."""
    free = free_flyer(robot)
    data, at = free.createData(), _with_root_at_origin(robot, q[None, :])[0]
    pin.computeJointJacobians(free, data, at)
    axes = pin.LOCAL_WORLD_ALIGNED
    return np.vstack([pin.getFrameJacobian(free, data, free.getFrameId(name), axes)[:3] for name in frames])


def contact_null_space(
    robot: Robot, q: Float[Array, " nv"], frames: Sequence[str], rows: Bool[Array, " n"] | None = None
) -> Float[Array, "k m"]:
    """Null space of the contact Jacobian: combinations of the equations of motion that contain no contact force.

    Args:
        robot: Robot with a floating base.
        q: Joint positions [rad or m].
        frames: Frames whose origins touch something.
        rows: Equations (rows of base and joints) that may be combined; None for all.
    """
    slopes = contact_jacobian(robot, q, frames)
    return null_space(slopes if rows is None else slopes[:, rows])


def free_flyer(robot: Robot) -> pin.Model:
    """The model with a free joint at its root, without gravity."""
    free = pin.Model()
    root = free.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base that moves")
    out = pin.appendModel(free, robot.model, free.addJointFrame(root), pin.SE3.Identity())
    out.gravity = pin.Motion.Zero()
    return out


def _with_root_at_origin(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "N nq"]:
    """Configurations of `free_flyer` with the root at the origin, not rotated."""
    level = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(q), 1))
    return np.hstack([level, robot.configuration(q)])
