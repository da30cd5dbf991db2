# pyright: reportAttributeAccessIssue=false
r"""Rows of a robot's dynamics that no force at a known point changes, its base included.

The base and the joints obey :math:`M a + h = S\tau + J^T f` with the forces :math:`f` of the points that touch. Where
the columns of :math:`N` span the null space of :math:`J`, :math:`N^T J^T f = 0`: these rows hold without the forces.
Base first, force before moment, in the root's axes.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin
from scipy.linalg import null_space

from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


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
