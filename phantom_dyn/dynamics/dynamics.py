r"""Rigid-body dynamics of a robot over whole trajectories: torques, mass matrix, regressor and their slopes.

Of a closed chain, motion and torque are those of its active joints: `phantom_dyn._kernels.rigid_body` works on the
tree, and `phantom_dyn.dynamics.tree_motion` projects.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from phantom_dyn._kernels import rigid_body
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.tree_motion import TreeMotion, passive_friction, project, tree_motion
from phantom_dyn.errors import LogError, RobotError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

_DIFFERENCE = 1e-5
"""Step of a central difference [rad or m]: the error of the step squared equals that of rounding over the step."""


def _require_finite(motion: Motion) -> None:
    """Refuse motion that is not finite, which Pinocchio passes through silently."""
    for name in ("q", "v", "a"):
        finite = np.isfinite(getattr(motion, name))
        if not finite.all():
            row, joint = np.argwhere(~finite)[0]
            raise LogError(f"{name} of joint number {joint} is not finite at sample {row}: give finite motion.")


def _rigid_body_torque(robot: Robot, tree: TreeMotion) -> Float[Array, "N nt"]:
    """Torque on the joints of the tree with armature, without friction."""
    return rigid_body.torque(robot.model, robot.arrays, tree.configuration, tree.v, tree.a, _root(robot, tree))


def _root(robot: Robot, tree: TreeMotion) -> Float[Array, "N 9"] | None:
    """How the root moves as the loops take it.

    Raises:
        RobotError: If the robot is not bolted down and nobody says how its base moves.
    """
    if tree.base is not None:
        return tree.base.columns
    if robot.floating:
        raise RobotError(
            f"{robot.name} is not bolted down (base: floating): give the motion of its base as well, or say base: "
            "fixed where it is held."
        )
    return None


def _active(robot: Robot, tree: TreeMotion, torque: Float[Array, "N nt *k"]) -> Float[Array, "N nv *k"]:
    return torque if robot.chain is None else project(tree.G, torque)


def _friction(robot: Robot, motion: Motion, tree: TreeMotion) -> Float[Array, "N nv"]:
    return own_friction(robot, motion.v) + passive_friction(robot, tree)


def own_friction(robot: Robot, v: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Drive torque that the modelled friction of the active joints takes at velocities, ``sign(0) = 0`` [N m or N]."""
    return v * robot.viscous_friction + np.sign(v) * robot.coulomb_friction


def modelled_friction(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    """Drive torque that the modelled friction of active and passive joints takes, ``sign(0) = 0``, shape ``(N, nv)``.

    Raises:
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    return _friction(robot, motion, tree_motion(robot, motion))


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
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    _require_finite(motion)
    tree = tree_motion(robot, motion)
    return _active(robot, tree, _rigid_body_torque(robot, tree)) + _friction(robot, motion, tree)


def rotor_torque(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    """Torque that the rotors need for a motion, those on passive joints included, shape ``(N, nv)`` [N m or N].

    Raises:
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    tree = tree_motion(robot, motion)
    return _active(robot, tree, robot.model.armature * tree.a)


def link_torque(robot: Robot, motion: Motion) -> Float[Array, "N nv"]:
    """Torque that the links need for a motion, without armature and friction, shape ``(N, nv)`` [N m or N].

    Raises:
        LogError: If a value is not finite.
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    _require_finite(motion)
    tree = tree_motion(robot, motion)
    return _active(robot, tree, _rigid_body_torque(robot, tree) - robot.model.armature * tree.a)


def body_torque_of_tree(robot: Robot, tree: TreeMotion) -> Float[Array, "N nv"]:
    """Torque that links and rotors need for a motion of the tree, without friction, shape ``(N, nv)`` [N m or N].

    A rotor on a passive joint accelerates while no active joint does.
    """
    return _active(robot, tree, _rigid_body_torque(robot, tree))


def inverse_dynamics_derivatives(
    robot: Robot, motion: Motion
) -> tuple[Float[Array, "N nv nv"], Float[Array, "N nv nv"]]:
    r"""Slopes :math:`\partial\tau/\partial q` and :math:`\partial\tau/\partial v` with armature, without friction.

    Analytic where ``G`` is constant; where it is not, central differences of 1e-5 rad or m in the active joints, good
    to about 1e-7 of the torque.

    Args:
        robot: Gives the model.
        motion: N samples.

    Returns:
        Entry ``[k, i, j]``: torque of joint i per position (then per velocity) of joint j, shapes ``(N, nv, nv)``.

    Raises:
        LogError: If a value is not finite.
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample, or next to it.
    """
    _require_finite(motion)
    if robot.chain is not None and robot.chain.anchors:
        return _difference(robot, motion, "q"), _difference(robot, motion, "v")
    tree = tree_motion(robot, motion)
    to_q, to_v = rigid_body.torque_slopes(
        robot.model, robot.arrays, tree.configuration, tree.v, tree.a, _root(robot, tree)
    )
    if robot.chain is None:
        return to_q, to_v
    return project(tree.G, to_q) @ tree.G, project(tree.G, to_v) @ tree.G


def _difference(robot: Robot, motion: Motion, quantity: Literal["q", "v"]) -> Float[Array, "N nv nv"]:
    """Slope of the rigid-body torque in one quantity of each active joint."""
    out = np.empty((*motion.q.shape, robot.nv))
    for j in range(robot.nv):
        sides = []
        for step in (_DIFFERENCE, -_DIFFERENCE):
            moved = np.array(getattr(motion, quantity))
            moved[:, j] += step
            tree = tree_motion(robot, replace(motion, **{quantity: moved}))
            sides.append(project(tree.G, _rigid_body_torque(robot, tree)))
        out[:, :, j] = (sides[0] - sides[1]) / (2 * _DIFFERENCE)
    return out


def gravity_torque(
    robot: Robot, q: Float[Array, "N nv"], gravity: Float[Array, " 3"] | None = None
) -> Float[Array, "N nv"]:
    """Torque that holds the links against gravity, shape ``(N, nv)`` [N m or N].

    Args:
        robot: Gives the model.
        q: Joint positions [rad or m].
        gravity: Acceleration [m/s^2] in the base frame; by default the robot's.

    Raises:
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    rest = np.zeros_like(q)
    tree = tree_motion(robot, Motion(np.arange(float(len(q))), q, rest, rest))
    return _active(robot, tree, rigid_body.weight(robot.model, robot.arrays, tree.configuration, gravity))


def rigid_body_regressor(
    robot: Robot, motion: Motion, *, columns: tuple[int, ...] | None = None, out: Float[Array, "N nv c"] | None = None
) -> Float[Array, "N nv _"]:
    r"""Rows of the rigid-body torque regressor, one block per sample: :math:`\tau = Y(q, v, a)\,\pi`.

    Armature is not part of :math:`\pi`, although `pin.rnea` adds it. Columns are Pinocchio's ten per joint
    1..njoints-1: ``m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz`` about the joint origin.

    Args:
        robot: Gives the model.
        motion: N samples.
        columns: Which columns to make, ascending: the others take neither time nor memory. By default all.
        out: Zeros that receive them in their first columns, C-contiguous, ``c`` at least the number of columns.

    Returns:
        Regressor in SI units, shape ``(N, nv, p)``, ``p`` the number of columns, by default ``10 (njoints - 1)``; or
        ``out``.

    Raises:
        LogError: If a value is not finite.
        ParameterError: If a column does not exist, they do not ascend, or ``out`` has no room for them.
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    _require_finite(motion)
    tree = tree_motion(robot, motion)
    slope = None if robot.chain is None else tree.G
    samples = tree.configuration, tree.v, tree.a
    return rigid_body.regressor(
        robot.model, robot.arrays, *samples, root=_root(robot, tree), slope=slope, columns=columns, out=out
    )


def standard_parameters(robot: Robot) -> Float[Array, " p"]:
    """Inertial parameters of the given model in the column order of `rigid_body_regressor`, shape ``(p,)``."""
    return np.concatenate([robot.model.inertias[j].toDynamicParameters() for j in range(1, robot.model.njoints)])


def mass_matrix(robot: Robot, q: Float[Array, "N nv"]) -> Float[Array, "N nv nv"]:
    """Joint-space mass matrix with armature at N joint positions, shape ``(N, nv, nv)``.

    Raises:
        ChainError: If a loop of a closed chain cannot be closed or is singular at a sample.
    """
    rest = np.zeros_like(q)
    return mass_matrix_of_tree(robot, tree_motion(robot, Motion(np.arange(float(len(q))), q, rest, rest)))


def mass_matrix_of_tree(robot: Robot, tree: TreeMotion) -> Float[Array, "N nv nv"]:
    """As `mass_matrix`, for positions of the tree that are known already."""
    out = rigid_body.mass(robot.model, robot.arrays, tree.configuration)
    return out if robot.chain is None else project(tree.G, out) @ tree.G
