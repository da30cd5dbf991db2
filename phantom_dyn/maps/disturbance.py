"""The force at the tip that the linear picture of mass, friction and stiffness leaves out."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from phantom_dyn.dynamics import inverse_dynamics, modelled_friction
from phantom_dyn.errors import ParameterError
from phantom_dyn.kinematics import frame_drift, frame_jacobian
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


def disturbance_force(robot: Robot, motion: Motion, frame: str) -> Float[Array, "N 3"]:
    r"""Force at the tip beyond :math:`M_{op}\ddot X` that moves the links: weight and what speed adds.

    :math:`F_d = J^{-T} (Q(q) + C(q, v) v - A J^{-1} \dot J v)`. The source prints :math:`A \ddot q` for the last term
    of its equation (20), which would take the inertia away altogether.

    Args:
        robot: With three active joints.
        motion: N samples; its accelerations do not count.
        frame: The tip.

    Returns:
        Force [N] in the root frame, shape ``(N, 3)``.

    Raises:
        RobotError: If the robot has no such frame.
        ParameterError: If the robot has another number of active joints.
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    if robot.nv != 3:
        raise ParameterError(f"{robot.name} has {robot.nv} active joints, wanted 3: the force is not determined.")
    J = frame_jacobian(robot, motion.q, frame, "hybrid")[:, :3]
    a = -np.linalg.solve(J, frame_drift(robot, motion, frame)[..., None])[..., 0]
    moved = Motion(motion.t, motion.q, motion.v, a)
    torque = inverse_dynamics(robot, moved) - modelled_friction(robot, moved)
    return np.linalg.solve(np.swapaxes(J, 1, 2), torque[..., None])[..., 0]
