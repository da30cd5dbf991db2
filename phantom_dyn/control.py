"""Torques of model-based control: gravity compensation and computed torque."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from phantom_dyn.dynamics import gravity_torque, inverse_dynamics
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


def gravity_compensation(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Drive torque [N m or N] under which the robot hangs free of weight, shape ``(N, nv)``.

    Args:
        robot: A plain robot or a closed chain.
        q: Measured joint positions [rad or m], shape ``(N, nv)``.

    Raises:
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    return gravity_torque(robot, q)


def computed_torque(
    robot: Robot,
    reference: Motion,
    q: Float[Array, "N nv"],
    v: Float[Array, "N nv"],
    *,
    kp: Float[Array, " nv"],
    kd: Float[Array, " nv"],
) -> Float[Array, "N nv"]:
    r"""Drive torque under which the error of a robot like its model dies out as that of free masses on springs.

    :math:`\tau = M(q)\,(a_r + k_d (v_r - v) + k_p (q_r - q)) + C(q, v) v + g(q)` plus the modelled friction at the
    measured velocity, so that :math:`\ddot e + k_d \dot e + k_p e = 0` for each joint.

    Args:
        robot: A plain robot or a closed chain.
        reference: Wanted motion, N samples.
        q: Measured joint positions [rad or m], shape ``(N, nv)``.
        v: Measured velocities, shape ``(N, nv)``.
        kp: Gains [1/s2], shape ``(nv,)``.
        kd: Gains [1/s], shape ``(nv,)``.

    Returns:
        Torque [N m or N], shape ``(N, nv)``.

    Raises:
        ParameterError: If a gain is negative or not finite.
        LogError: If a measured value is not finite.
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    for name, gain in (("kp", kp), ("kd", kd)):
        if not (np.isfinite(gain).all() and (gain >= 0).all()):
            raise ParameterError(f"The gains {name} are {gain}: give numbers of 0 or more.")
    a = reference.a + kd * (reference.v - v) + kp * (reference.q - q)
    return inverse_dynamics(robot, Motion(reference.t, q, v, a))
