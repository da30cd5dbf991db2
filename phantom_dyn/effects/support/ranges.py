"""Ranges of friction torques: what the model has can be missing, no more, and no drive moves against all of it."""

from __future__ import annotations

import numpy as np

from phantom_dyn.effects.effect import Parameter
from phantom_dyn.effects.support.rows import damping_unit, modelled_friction_of, torque_unit
from phantom_dyn.model.robot import Robot


def dry_range(robot: Robot, joint: str | None, name: str) -> Parameter:
    """A friction torque that no speed changes: with the modelled one not negative, and below what the drive gives.

    Args:
        robot: The given model.
        joint: Active, or passive in a closed chain.
        name: Of the parameter.
    """
    least = 0.0 - modelled_friction_of(robot, joint)[1]
    return Parameter(
        name,
        torque_unit(robot, joint),
        least,
        plausible=(least, stated_limit(robot, joint)),
        plausible_because="a joint whose friction is more than its drive can give does not move",
    )


def viscous_range(robot: Robot, joint: str | None, name: str) -> Parameter:
    """A friction torque per unit of speed: with the modelled one not negative."""
    least = 0.0 - modelled_friction_of(robot, joint)[0]
    return Parameter(
        name,
        damping_unit(robot, joint),
        least,
        plausible=(least, np.inf),
        plausible_because="friction takes energy, and cold grease may take any amount",
    )


def stated_limit(robot: Robot, joint: str | None) -> float:
    """Torque limit that the robot's configuration states for a joint [N m or N]; infinite where it states none."""
    if joint not in robot.joint_names:
        return np.inf
    limit = robot.actuators[robot.joint_names.index(joint)].torque_limit
    return np.inf if limit is None else float(limit)
