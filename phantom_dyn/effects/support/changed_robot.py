# pyright: reportAttributeAccessIssue=false
"""Copies of a robot with other friction, rotor inertia, inertial parameters or gravity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot import Robot


def with_friction(robot: Robot, joint: str | None, *, viscous: float = 0.0, coulomb: float = 0.0) -> Robot:
    """``robot`` with friction added to that of an active or passive joint; a negative sum becomes zero.

    Args:
        robot: The robot, which is not changed.
        joint: Name of the joint.
        viscous: Additional viscous coefficient [N m s/rad or N s/m].
        coulomb: Additional Coulomb torque [N m or N].
    """
    if robot.chain is not None and joint in robot.passive_names:
        k, chain = robot.passive_names.index(joint), robot.chain
        levels = _added(chain.viscous_friction, k, viscous), _added(chain.coulomb_friction, k, coulomb)
        return replace(robot, chain=replace(chain, viscous_friction=levels[0], coulomb_friction=levels[1]))
    row = row_of(robot, joint)
    return replace(
        robot,
        viscous_friction=_added(robot.viscous_friction, row, viscous),
        coulomb_friction=_added(robot.coulomb_friction, row, coulomb),
    )


def with_rotor_inertia(robot: Robot, joint: str | None, inertia: float) -> Robot:
    """``robot`` with rotor inertia [kg m^2 or kg] added to that of a joint; a negative sum becomes zero."""
    model = robot.model.copy()
    model.armature = _added(model.armature, robot.tree_rows[row_of(robot, joint)], inertia)
    return replace(robot, model=model)


def with_parameters(robot: Robot, change: Float[Array, " p"]) -> Robot:
    """``robot`` with changed inertial parameters.

    Args:
        robot: The robot, which is not changed.
        change: Values that are added to the parameters, in the order of `standard_parameters`.

    Raises:
        RobotError: If a mass would not be above zero.
    """
    model = robot.model.copy()
    for body in range(1, model.njoints):
        moved = change[10 * (body - 1) : 10 * body]
        if moved.any():
            parameters = model.inertias[body].toDynamicParameters() + moved
            if parameters[0] <= 0:
                raise RobotError(f"The link of {model.names[body]} would weigh {parameters[0]:.3g} kg: give more.")
            model.inertias[body] = pin.Inertia.FromDynamicParameters(parameters)
    return replace(robot, model=model)


def with_gravity(robot: Robot, gravity: Float[Array, " 3"]) -> Robot:
    """``robot`` under another gravity [m/s^2], in the base frame."""
    model = robot.model.copy()
    model.gravity = pin.Motion(np.asarray(gravity, dtype=float), np.zeros(3))
    return replace(robot, model=model)


def _added(values: Float[Array, " n"], k: int, change: float) -> Float[Array, " n"]:
    """``values`` with ``change`` added to entry ``k``; a negative sum becomes zero."""
    out = np.array(values, dtype=float)
    out[k] = max(out[k] + change, 0.0)
    return out
