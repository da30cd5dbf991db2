# pyright: reportAttributeAccessIssue=false
"""Rigid-body dynamics of whole trajectories, through Pinocchio."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from phantom_dyn.errors import LogError
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


def _require_finite(motion: Motion) -> None:
    """Pinocchio passes NaN through silently, so it is stopped here."""
    for name in ("q", "v", "a"):
        bad = np.argwhere(~np.isfinite(getattr(motion, name)))
        if len(bad):
            row, joint = bad[0]
            raise LogError(f"{name} of joint number {joint} is not finite at sample {row}: give finite motion.")


def inverse_dynamics(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    r"""Drive torque that the given model needs for a motion, modelled friction and armature included.

    :math:`\tau = M(q) a + C(q, v) v + g(q) + c\,v + T\,\mathrm{sign}(v)`, with ``sign(0) = 0``. `pin.rnea` adds
    ``armature`` but neither ``damping`` nor ``friction``, so the last two are added here.

    Args:
        robot: Gives model and friction.
        motion: N samples.

    Returns:
        Torque [N m or N], shape ``(N, nv)``.

    Raises:
        LogError: If a value is not finite.
    """
    _require_finite(motion)
    data = robot.model.createData()
    q = robot.configuration(motion.q)
    out = np.empty((len(q), robot.nv))
    for k in range(len(q)):
        out[k] = pin.rnea(robot.model, data, q[k], motion.v[k], motion.a[k])
    return out + motion.v * robot.viscous_friction + np.sign(motion.v) * robot.coulomb_friction


def rigid_body_regressor(robot: Robot, motion: Motion) -> Float[Array, "N nv p"]:
    r"""Rows of the rigid-body torque regressor, one block per sample: :math:`\tau = Y(q, v, a)\,\pi`.

    Armature is not part of :math:`\pi`, although `pin.rnea` adds it. Columns are Pinocchio's ten per joint
    1..njoints-1: ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` about the joint origin.

    Args:
        robot: Gives the model.
        motion: N samples.

    Returns:
        Regressor in SI units, shape ``(N, nv, 10 (njoints - 1))``.

    Raises:
        LogError: If a value is not finite.
    """
    _require_finite(motion)
    data = robot.model.createData()
    q = robot.configuration(motion.q)
    p = 10 * (robot.model.njoints - 1)
    out = np.empty((len(q), robot.nv, p))
    for k in range(len(q)):
        # Pinocchio returns a 1-D array for a robot with one joint.
        out[k] = pin.computeJointTorqueRegressor(robot.model, data, q[k], motion.v[k], motion.a[k]).reshape(-1, p)
    return out


def standard_parameters(robot: Robot) -> Float[Array, " p"]:
    """Inertial parameters of the given model in the column order of `rigid_body_regressor`, shape ``(p,)``."""
    return np.concatenate([robot.model.inertias[j].toDynamicParameters() for j in range(1, robot.model.njoints)])


def mass_matrix(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "N nv nv"]:
    """Joint-space mass matrix with armature at N joint positions, shape ``(N, nv, nv)``."""
    data = robot.model.createData()
    configurations = robot.configuration(q)
    out = np.empty((len(q), robot.nv, robot.nv))
    for k in range(len(q)):
        upper = np.triu(pin.crba(robot.model, data, configurations[k]))
        out[k] = upper + np.triu(upper, 1).T
    return out
