# pyright: reportAttributeAccessIssue=false
r"""Motion of a base that is not bolted down, and the rows of its dynamics that hold whatever forces its feet feel.

An accelerometer reads the specific force: acceleration less gravity. Recursive Newton-Euler starts from exactly this at
the root, so that neither the position of the base nor its velocity is needed. From the place ``p`` of the
accelerometer to the origin of the root, :math:`f = f_s - \dot\omega \times p - \omega \times (\omega \times p)`.

**Feet on the ground.** The base and the joints obey :math:`M a + h = S\tau + J^T f` with the forces :math:`f` of the
points that touch. Where the columns of :math:`N` span the null space of :math:`J`, :math:`N^T J^T f = 0`: these rows
hold without the forces. Base first, force before moment, in the root's axes.
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
    """Place of a sensor's frame in the axes of the root.

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
    """Independent samples that excite all that a moving base can: any direction of gravity, some rad/s and rad/s^2."""
    return BaseMotion(*(size * rng.normal(size=(count, 3)) for size in (2.0, 10.0, 10.0)))


def base_motion(
    robot: Robot,
    gyroscope: str,
    accelerometer: str,
    w: Float[Array, "N 3"],
    dw: Float[Array, "N 3"],
    force: Float[Array, "N 3"],
) -> BaseMotion:
    """Motion of the root from what its own sensors read.

    Args:
        robot: Says where the frames are.
        gyroscope: Frame in whose axes ``w`` and ``dw`` are.
        accelerometer: Frame in whose axes ``force`` is, and at whose origin.
        w: Angular velocity [rad/s].
        dw: Its derivative [rad/s^2].
        force: Specific force [m/s^2]: upwards and as large as gravity at rest.

    Raises:
        RobotError: If a frame is unknown, or does not move with the base.
    """
    turn, place = place_on_base(robot, gyroscope).rotation, place_on_base(robot, accelerometer)
    turned, faster = w @ turn.T, dw @ turn.T
    lever = place.translation
    at_root = force @ place.rotation.T - np.cross(faster, lever) - np.cross(turned, np.cross(turned, lever))
    return BaseMotion(turned, faster, at_root)


def torque_of_base(robot: Robot, motion: Motion) -> Float[Array, "N nv 9"]:
    """Slopes of the torque in the columns of `BaseMotion`: angular velocity, its derivative, specific force.

    The torque is a polynomial of second degree in the first and linear in the others, so that differences are exact.

    Args:
        robot: Gives the model.
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
        robot: Not bolted down, without closed loops.
        motion: With the motion of its root.
    """
    base = motion.base
    assert base is not None
    free = free_flyer(robot)
    data, out = free.createData(), np.empty((len(motion.t), 6 + robot.nv))
    q = _at_the_origin(robot, motion.q)
    # Without gravity and without a velocity of its origin, the root's acceleration is the specific force.
    still = np.zeros_like(base.f)
    v, a = np.hstack([still, base.w, motion.v]), np.hstack([base.f, base.dw, motion.a])
    for k in range(len(q)):
        out[k, :6] = pin.rnea(free, data, q[k], v[k], a[k])[:6]
    out[:, 6:] = inverse_dynamics(robot, motion)
    return out


def contact_jacobian(robot: Robot, q: Float[Array, " nv"], frames: Sequence[str]) -> Float[Array, "f n"]:
    """Velocity of the origins of frames by those of base and joints, in the root's axes."""
    free = free_flyer(robot)
    data, at = free.createData(), _at_the_origin(robot, q[None, :])[0]
    pin.computeJointJacobians(free, data, at)
    axes = pin.LOCAL_WORLD_ALIGNED
    return np.vstack([pin.getFrameJacobian(free, data, free.getFrameId(name), axes)[:3] for name in frames])


def contact_free(
    robot: Robot, q: Float[Array, " nv"], frames: Sequence[str], rows: Bool[Array, " n"] | None = None
) -> Float[Array, "k m"]:
    """Orthonormal columns: the sums of rows of base and joints that no force at the origins of frames changes.

    Args:
        robot: Not bolted down.
        q: Positions.
        frames: That touch something.
        rows: Of base and joints that are summed; None: all.
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


def _at_the_origin(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "N nq"]:
    level = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(q), 1))
    return np.hstack([level, robot.configuration(q)])
