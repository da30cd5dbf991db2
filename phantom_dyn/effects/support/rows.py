"""Functions that effects share: joint indices (rows), signatures and torques on joints, units, ranges of friction."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.dynamics.tree_motion import joint_velocity
from phantom_dyn.effects.effect import Parameter
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape, Signature
from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import linear_joints


def row_of(robot: Robot, joint: str | None) -> int:
    """Index of ``joint`` among the velocities of the robot."""
    if joint not in robot.joint_names:
        raise RobotError(f"No joint '{joint}' in this robot: its joints are {', '.join(robot.joint_names)}.")
    return robot.joint_names.index(joint)


def rows_of(robot: Robot, joint: str | None) -> tuple[int, ...]:
    """Indices of one joint, or of several joints (names joined by ``+``), among the velocities of the robot."""
    if joint in robot.joint_names:
        return (row_of(robot, joint),)
    return tuple(row_of(robot, one) for one in (joint or "").split("+"))


def on_one_joint(robot: Robot, joint: str | None, **columns: tuple[Float[Array, " N"], str]) -> Signature:
    """Signature of an effect on one joint: ``name=(column, unit)`` for each coefficient."""
    return Signature(
        rows=(row_of(robot, joint),),
        columns=np.array([column for column, _ in columns.values()]).T[:, None, :],
        names=tuple(columns),
        units=tuple(unit for _, unit in columns.values()),
    )


def torque_on_joint(robot: Robot, joint: str | None, values: Float[Array, " N"]) -> Float[Array, "N nv"]:
    """Joint torques that are ``values`` on one joint and zero on the others."""
    return torque_on_rows(robot, (row_of(robot, joint),), values[:, None])


def speed_of(robot: Robot, operation: Operation, joint: str | None) -> Float[Array, " N"]:
    """Velocity of an active or passive joint."""
    if joint in robot.passive_names:
        return joint_velocity(robot, operation, joint)[0]
    return operation.v[:, row_of(robot, joint)]


def on_any_joint(
    robot: Robot, operation: Operation, joint: str | None, **columns: tuple[Float[Array, " N"], str]
) -> Signature:
    """Signature of an effect on an active or passive joint, with arguments as in `on_one_joint`.

    A torque on a passive joint of a closed chain acts on all active joints that move it.
    """
    if joint not in robot.passive_names:
        return on_one_joint(robot, joint, **columns)
    rows, shares = _movers(robot, operation, joint)
    values = np.stack([column for column, _ in columns.values()], axis=-1)
    units = tuple(unit for _, unit in columns.values())
    return Signature(rows, shares[:, :, None] * values[:, None, :], tuple(columns), units)


def torque_on_any_joint(
    robot: Robot, operation: Operation, joint: str | None, values: Float[Array, " N"]
) -> Float[Array, "N nv"]:
    """Torques of the active joints for a torque ``values`` on one active or passive joint."""
    if joint not in robot.passive_names:
        return torque_on_joint(robot, joint, values)
    return joint_velocity(robot, operation, joint)[1] * values[:, None]


def modelled_friction_of(robot: Robot, joint: str | None) -> tuple[float, float]:
    """Viscous coefficient and Coulomb torque of an active or passive joint in the model."""
    if joint in robot.passive_names and robot.chain is not None:
        index = robot.passive_names.index(joint)
        return float(robot.chain.viscous_friction[index]), float(robot.chain.coulomb_friction[index])
    row = row_of(robot, joint)
    return float(robot.viscous_friction[row]), float(robot.coulomb_friction[row])


def _movers(robot: Robot, operation: Operation, joint: str) -> tuple[tuple[int, ...], Float[Array, "N m"]]:
    """Active joints that move a passive one, and the torque on them per unit of torque on the passive joint."""
    shares = joint_velocity(robot, operation, joint)[1]
    # In a chain with anchors the shares change with position, so that the first sample does not show which are zero.
    if robot.chain is None or robot.chain.anchors:
        return tuple(range(robot.nv)), shares
    rows = tuple(int(k) for k in np.flatnonzero(np.abs(shares[0]) > 1e-12))
    return rows, shares[:, list(rows)]


def _prismatic(robot: Robot, joint: str | None) -> bool:
    """True if an active or passive joint is linear."""
    if joint in robot.passive_names:
        return bool(linear_joints(robot.model)[robot.model.getJointId(joint) - 1])
    return bool(robot.prismatic[row_of(robot, joint)])


def secant(estimate: float, least: float) -> tuple[Shape, ...]:
    """The next shape of a secant: the last estimate; if its size is below ``least``, then ``least``.

    A secant to a smaller value would have large rounding errors.
    """
    return ((estimate if abs(estimate) > least else least,),)


def torque_unit(robot: Robot, joint: str | None) -> str:
    """Unit of a torque: ``N m`` for a rotary joint, ``N`` for a linear one."""
    return "N" if _prismatic(robot, joint) else "N m"


def damping_unit(robot: Robot, joint: str | None) -> str:
    """Unit of a viscous coefficient: ``N m s/rad`` or ``N s/m``."""
    return "N s/m" if _prismatic(robot, joint) else "N m s/rad"


def velocity_unit(robot: Robot, joint: str | None) -> str:
    """Unit of a velocity: ``rad/s`` or ``m/s``."""
    return "m/s" if _prismatic(robot, joint) else "rad/s"


def stiffness_unit(robot: Robot, joint: str | None) -> str:
    """Unit of a stiffness: ``N m/rad`` or ``N/m``."""
    return "N/m" if _prismatic(robot, joint) else "N m/rad"


def inertia_unit(robot: Robot, joint: str | None) -> str:
    """Unit of an inertia: ``kg m^2`` or ``kg``."""
    return "kg" if _prismatic(robot, joint) else "kg m^2"


def driven_rows(robot: Robot, joint: str | None) -> tuple[int, ...]:
    """The row of ``joint``, or all rows for the whole robot."""
    return tuple(range(robot.nv)) if joint is None else (row_of(robot, joint),)


def branch_rows(robot: Robot, joint: str | None) -> tuple[int, ...]:
    """Rows whose torque depends on the position of a joint: its ancestors and descendants; all in closed chains."""
    if robot.chain is not None or joint is None:
        return tuple(range(robot.nv))
    body = robot.model.getJointId(joint)
    branch = {*robot.model.supports[body], *robot.model.subtrees[body]}
    return tuple(k for k, name in enumerate(robot.joint_names) if robot.model.getJointId(name) in branch)


def torque_on_rows(robot: Robot, rows: tuple[int, ...], values: Float[Array, "N m"]) -> Float[Array, "N nv"]:
    """Joint torques that are ``values`` on some rows and zero on the others."""
    out = np.zeros((len(values), robot.nv))
    out[:, list(rows)] = values
    return out


def hidden_behind_drive(robot: Robot, what: str) -> str | None:
    """Reason why a torque sensor behind the drive does not show ``what``; None without such a sensor."""
    if robot.torque_source != "sensor":
        return None
    return f"the torque columns come from a sensor, behind the drive: {what} leaves no trace in them"


def moving_average(x: Float[Array, " N"], dt: float, seconds: float) -> Float[Array, " N"]:
    """Centred moving average over about ``seconds``: an odd number of samples, at least one."""
    half = int(0.5 * seconds / dt) if dt > 0 else 0
    return ndimage.uniform_filter1d(x, min(2 * half + 1, len(x)), mode="nearest")


def turning_points(operation: Operation, row: int) -> Int[Array, " n"]:
    """Samples just after each reversal of a joint; speeds below a fiftieth of the top speed are ignored."""
    v = operation.v[:, row]
    moving = np.flatnonzero(np.abs(v) > max(0.02 * float(np.percentile(np.abs(v), 99)), 1e-9))
    return moving[1:][np.diff(np.sign(v[moving])) != 0]


def never_reverses(robot: Robot, operation: Operation, joint: str | None) -> str | None:
    """Reason why a recording without a reversal of ``joint`` cannot show its friction; None if there is a reversal."""
    if len(turning_points(operation, row_of(robot, joint))):
        return None
    return f"{joint} never reverses: its friction looks like a constant torque"


def dry_range(robot: Robot, joint: str | None, name: str) -> Parameter:
    """Parameter of a dry friction torque, with bounds.

    The sum with the modelled torque is not negative; it is plausible that the drive can overcome the friction.

    Args:
        robot: The given model.
        joint: Name of an active or passive joint.
        name: Name of the parameter.
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
    """Parameter of a viscous coefficient, with the bound that the sum with the modelled one is not negative."""
    least = 0.0 - modelled_friction_of(robot, joint)[0]
    return Parameter(
        name,
        damping_unit(robot, joint),
        least,
        plausible=(least, np.inf),
        plausible_because="friction takes energy, and cold grease may take any amount",
    )


def stated_limit(robot: Robot, joint: str | None) -> float:
    """Torque limit that the robot's configuration states for a joint [N m or N]; infinite if it states none."""
    if joint not in robot.joint_names:
        return np.inf
    limit = robot.actuators[robot.joint_names.index(joint)].torque_limit
    return np.inf if limit is None else float(limit)
