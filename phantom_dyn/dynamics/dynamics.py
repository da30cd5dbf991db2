r"""Rigid-body dynamics of a robot over whole trajectories: torques, mass matrix, regressor and derivatives.

For a closed chain, motion and torque are those of the active joints: `phantom_dyn._kernels.rigid_body` computes the
torques of all joints of the tree, and `phantom_dyn.dynamics.tree_motion` projects them on the active joints.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from phantom_dyn._kernels import rigid_body
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.tree_motion import TreeMotion, passive_friction, project, tree_at_rest, tree_motion
from phantom_dyn.errors import LogError, RobotError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# Step of a central difference [rad or m]; with it the truncation error is about as large as the rounding error.
_DIFFERENCE = 1e-5


def _require_finite(motion: Motion) -> None:
    """Raise a `LogError` for motion that is not finite, because Pinocchio accepts such motion."""
    for name in ("q", "v", "a"):
        finite = np.isfinite(getattr(motion, name))
        if not finite.all():
            row, joint = np.argwhere(~finite)[0]
            raise LogError(f"{name} of joint number {joint} is not finite at sample {row}: give finite motion.")


def _tree_torque(robot: Robot, tree: TreeMotion) -> Float[Array, "N nt"]:
    """Torque on the joints of the tree with armature, without friction."""
    return rigid_body.torque(robot.model, robot.arrays, tree.configuration, tree.v, tree.a, _root_motion(robot, tree))


def _root_motion(robot: Robot, tree: TreeMotion) -> Float[Array, "N 9"] | None:
    """Motion of a floating base as the compiled functions need it; None for a fixed base.

    Raises:
        RobotError: If the base floats and its motion is not given.
    """
    if tree.base is not None:
        return tree.base.columns
    if robot.floating:
        raise RobotError(
            f"{robot.name} is not bolted down (base: floating): give the motion of its base as well, or state base: "
            "fixed in robot.yaml if it is held."
        )
    return None


def _on_active_joints(robot: Robot, tree: TreeMotion, torque: Float[Array, "N nt *k"]) -> Float[Array, "N nv *k"]:
    """Torques on the tree, projected on the active joints."""
    return torque if robot.chain is None else project(tree.G, torque)


def _friction(robot: Robot, motion: Motion, tree: TreeMotion) -> Float[Array, "N nv"]:
    """Drive torque against the modelled friction of active and passive joints."""
    return active_friction(robot, motion.v) + passive_friction(robot, tree)


def active_friction(robot: Robot, v: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Drive torque against the modelled friction of the active joints [N m or N], with ``sign(0) = 0``."""
    return v * robot.viscous_friction + np.sign(v) * robot.coulomb_friction


def modelled_friction(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    """Drive torque against the modelled friction of active and passive joints, ``sign(0) = 0``, shape ``(N, nv)``.

    Raises:
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    return _friction(robot, motion, tree_motion(robot, motion))


def inverse_dynamics(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    r"""Drive torque that the given model needs for a motion, modelled friction and armature included.

    :math:`\tau = M(q) a + C(q, v) v + g(q) + c\,v + T\,\mathrm{sign}(v)`, with ``sign(0) = 0``. `pin.rnea` adds
    ``armature`` but neither ``damping`` nor ``friction``, so the last two are added here.

    Args:
        robot: Robot with its modelled friction.
        motion: N samples.

    Returns:
        Torque [N m or N], shape ``(N, nv)``.

    Raises:
        LogError: If a value is not finite.
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    _require_finite(motion)
    tree = tree_motion(robot, motion)
    return _on_active_joints(robot, tree, _tree_torque(robot, tree)) + _friction(robot, motion, tree)


def rotor_torque(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    """Torque that accelerates the rotors, including those on passive joints, shape ``(N, nv)`` [N m or N].

    Raises:
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    tree = tree_motion(robot, motion)
    return _on_active_joints(robot, tree, robot.model.armature * tree.a)


def link_torque(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    """Torque that the links need for a motion, without armature and friction, shape ``(N, nv)`` [N m or N].

    Raises:
        LogError: If a value is not finite.
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    _require_finite(motion)
    tree = tree_motion(robot, motion)
    return _on_active_joints(robot, tree, _tree_torque(robot, tree) - robot.model.armature * tree.a)


def body_torque_of_tree(robot: Robot, tree: TreeMotion) -> Float[Array, "N nv"]:
    """Torque that links and rotors need for a motion of the tree, without friction, shape ``(N, nv)`` [N m or N].

    Rotors on passive joints are included.
    """
    return _on_active_joints(robot, tree, _tree_torque(robot, tree))


def inverse_dynamics_derivatives(
    robot: Robot, motion: Motion
) -> tuple[Float[Array, "N nv nv"], Float[Array, "N nv nv"]]:
    r"""Derivatives :math:`\partial\tau/\partial q` and :math:`\partial\tau/\partial v` with armature, without friction.

    They are analytic for a tree, and for a closed chain whose passive joints follow the active ones linearly. Otherwise
    they are central differences with steps of 1e-5 rad or m in the active joints, with errors of about 1e-7 of the
    torque.

    Args:
        robot: The robot.
        motion: N samples.

    Returns:
        The derivatives by position and by velocity, each ``(N, nv, nv)``; entry ``[k, i, j]`` is the derivative of the
        torque of joint i by the position or velocity of joint j at sample k.

    Raises:
        LogError: If a value is not finite.
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample, or next to it.
    """
    _require_finite(motion)
    if robot.chain is not None and robot.chain.anchors:
        return _difference(robot, motion, "q"), _difference(robot, motion, "v")
    tree = tree_motion(robot, motion)
    dtau_dq, dtau_dv = rigid_body.torque_slopes(
        robot.model, robot.arrays, tree.configuration, tree.v, tree.a, _root_motion(robot, tree)
    )
    if robot.chain is None:
        return dtau_dq, dtau_dv
    return project(tree.G, dtau_dq) @ tree.G, project(tree.G, dtau_dv) @ tree.G


def _difference(robot: Robot, motion: Motion, quantity: Literal["q", "v"]) -> Float[Array, "N nv nv"]:
    """Derivative of the rigid-body torque by position or velocity of each active joint, from central differences."""
    out = np.empty((*motion.q.shape, robot.nv))
    for j in range(robot.nv):
        torques = []
        for step in (_DIFFERENCE, -_DIFFERENCE):
            shifted = np.array(getattr(motion, quantity))
            shifted[:, j] += step
            tree = tree_motion(robot, replace(motion, **{quantity: shifted}))
            torques.append(project(tree.G, _tree_torque(robot, tree)))
        out[:, :, j] = (torques[0] - torques[1]) / (2 * _DIFFERENCE)
    return out


def gravity_torque(
    robot: Robot, q: Float[Array, "N nv"], gravity: Float[Array, " 3"] | None = None
) -> Float[Array, "N nv"]:
    """Torque that holds the links against gravity, shape ``(N, nv)`` [N m or N].

    Args:
        robot: The robot.
        q: Joint positions [rad or m].
        gravity: Acceleration [m/s^2] in the base frame; by default the robot's.

    Raises:
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    tree = tree_at_rest(robot, q)
    return _on_active_joints(robot, tree, rigid_body.weight(robot.model, robot.arrays, tree.configuration, gravity))


def rigid_body_regressor(
    robot: Robot, motion: Motion, *, columns: tuple[int, ...] | None = None, out: Float[Array, "N nv c"] | None = None
) -> Float[Array, "N nv _"]:
    r"""Rows of the rigid-body torque regressor, one block per sample: :math:`\tau = Y(q, v, a)\,\pi`.

    Armature is not part of :math:`\pi`, although `pin.rnea` adds it. Columns are Pinocchio's ten per joint
    1..njoints-1: ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` about the joint origin.

    Args:
        robot: The robot.
        motion: N samples.
        columns: Columns to compute, ascending; by default all ``10 (njoints - 1)``.
        out: C-contiguous array of zeros, into whose first columns the result is written; ``c`` is at least the number
            of columns.

    Returns:
        Regressor in SI units, shape ``(N, nv, p)`` with ``p`` the number of columns; or ``out``.

    Raises:
        LogError: If a value is not finite.
        ParameterError: If a column does not exist, columns do not ascend, or ``out`` has too few columns.
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    _require_finite(motion)
    tree = tree_motion(robot, motion)
    slope = None if robot.chain is None else tree.G
    samples = tree.configuration, tree.v, tree.a
    return rigid_body.regressor(
        robot.model, robot.arrays, *samples, root=_root_motion(robot, tree), slope=slope, columns=columns, out=out
    )


def standard_parameters(robot: Robot) -> Float[Array, " p"]:
    """Inertial parameters of the given model in the column order of `rigid_body_regressor`, shape ``(p,)``."""
    return np.concatenate([robot.model.inertias[j].toDynamicParameters() for j in range(1, robot.model.njoints)])


def mass_matrix(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "N nv nv"]:
    """Joint-space mass matrix with armature at N joint positions, shape ``(N, nv, nv)``.

    Raises:
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    return mass_matrix_of_tree(robot, tree_at_rest(robot, q))


def mass_matrix_of_tree(robot: Robot, tree: TreeMotion) -> Float[Array, "N nv nv"]:
    """Joint-space mass matrix with armature at known positions of the tree, shape ``(N, nv, nv)``."""
    out = rigid_body.mass(robot.model, robot.arrays, tree.configuration)
    return out if robot.chain is None else project(tree.G, out) @ tree.G
