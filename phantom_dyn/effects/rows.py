"""Building blocks that the effects share: which row a joint is, and signatures that touch one row."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from phantom_dyn.effects.effect import Shape, Signature
from phantom_dyn.errors import RobotError
from phantom_dyn.robot import Robot

Array = np.ndarray


def row_of(robot: Robot, joint: str | None) -> int:
    """Index of ``joint`` among the robot's velocities."""
    if joint not in robot.joint_names:
        raise RobotError(f"No joint '{joint}' in this robot: its joints are {', '.join(robot.joint_names)}.")
    return robot.joint_names.index(joint)


def on_one_joint(robot: Robot, joint: str | None, **columns: tuple[Float[Array, " N"], str]) -> Signature:
    """Signature of an effect that touches one joint only: ``name=(column, unit)`` for each coefficient."""
    return Signature(
        rows=(row_of(robot, joint),),
        columns=np.stack([column for column, _ in columns.values()], axis=-1)[:, None, :],
        names=tuple(columns),
        units=tuple(unit for _, unit in columns.values()),
    )


def torque_on_joint(robot: Robot, joint: str | None, values: Float[Array, " N"]) -> Float[Array, "N nv"]:
    """Joint torques that are ``values`` on one joint and zero on the others."""
    out = np.zeros((len(values), robot.nv))
    out[:, row_of(robot, joint)] = values
    return out


def secant(estimate: float, least: float) -> tuple[Shape, ...]:
    """The next shape of a law that takes its last estimate as shape, never so small that rounding shows."""
    return ((estimate if abs(estimate) > least else least,),)


def torque_unit(robot: Robot, joint: str | None) -> str:
    """``N m`` for a rotary joint, ``N`` for a linear one."""
    return robot.torque_units[row_of(robot, joint)]


def damping_unit(robot: Robot, joint: str | None) -> str:
    """Torque unit per velocity unit."""
    return "N s/m" if robot.prismatic[row_of(robot, joint)] else "N m s/rad"


def velocity_unit(robot: Robot, joint: str | None) -> str:
    """``rad/s`` or ``m/s``."""
    return "m/s" if robot.prismatic[row_of(robot, joint)] else "rad/s"
