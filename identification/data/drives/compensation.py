"""Restores torques that a controller compensated, or that were recorded late or filtered, as the column map states.

If a controller had subtracted gravity or friction from a torque, the modelled gravity or friction is added. Gravity
needs only positions. Friction needs velocities, whose sign changes with the noise at standstill. So friction is added
later (`identification.data.signals`), with the same velocities as in the modelled friction, so that the two cancel. A
delay of the record and a low pass are undone before anything is added.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
from scipy.interpolate import CubicSpline

from identification.data.recording import Table
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.errors import LogError, known_names
from phantom_dyn.model.robot import Robot


def joints_without(table: Table, robot: Robot, part: str) -> tuple[str, ...]:
    """Joints from whose torque a controller had subtracted gravity or friction, in the robot's order.

    Args:
        table: Table with the compensation that the column map states.
        robot: The robot, which defines the order of the joints.
        part: ``gravity`` or ``friction``.

    Raises:
        LogError: If the column map names a joint that the robot does not have.
    """
    _require_joints(table, robot, table.compensated, "is compensated")
    of_all = table.compensated.get("", ())
    return tuple(joint for joint in robot.joint_names if part in (*of_all, *table.compensated.get(joint, ())))


def _require_joints(table: Table, robot: Robot, joints: Iterable[str], what: str) -> None:
    """Raise an error if the robot lacks one of the joints; an empty name means all joints."""
    for joint in joints:
        if joint and joint not in robot.joint_names:
            raise LogError(
                f"{table.file}: the column map says that tau.{joint} {what}, a joint that {robot.name} does "
                f"not have: {known_names(joint, robot.joint_names, 'joints')}"
            )


def without_recorder_lag(
    table: Table, robot: Robot, tau: Float[Array, "N nv"]
) -> tuple[Float[Array, "N nv"], tuple[str, ...]]:
    """Torques without the delay and the low pass of their recorder, and sentences that say what was undone.

    Args:
        table: Table with the delays and low passes that the column map states.
        robot: The robot, which defines the order of the joints.
        tau: Drive torques as recorded [N m or N], shape ``(N, nv)``.

    Raises:
        LogError: If the column map names a joint that the robot does not have.
    """
    tau, shifted = without_delay(table, robot, tau)
    tau, unfiltered = without_low_pass(table, robot, tau)
    return tau, shifted + unfiltered


def without_delay(
    table: Table, robot: Robot, tau: Float[Array, "N nv"]
) -> tuple[Float[Array, "N nv"], tuple[str, ...]]:
    """Torques at the times at which they acted, and a sentence that says which were recorded late.

    The last torque is repeated up to the end of the recording. Filters do not use these samples.

    Args:
        table: Table with the times that the column map states.
        robot: The robot, which defines the order of the joints.
        tau: Drive torques as recorded [N m or N], shape ``(N, nv)``.

    Raises:
        LogError: If the column map names a joint that the robot does not have.
    """
    _require_joints(table, robot, table.late, "was recorded late")
    t = table.columns["t"]
    out, late = _changed_columns(robot, tau, table.late, lambda x, seconds: np.interp(t + seconds, t, x))
    words = ", ".join(f"{1e3 * seconds:g} ms of {joint}" for joint, seconds in late.items())
    return out, (f"{table.file}: the torque was taken earlier by {words}, as the column map says.",) if late else ()


def without_low_pass(
    table: Table, robot: Robot, tau: Float[Array, "N nv"]
) -> tuple[Float[Array, "N nv"], tuple[str, ...]]:
    r"""Torques before their first-order low passes, and a sentence that says which low passes were inverted.

    A low pass with time constant T turns :math:`\tau + T \dot\tau` into :math:`\tau`.

    Args:
        table: Table with the low passes that the column map states.
        robot: The robot, which defines the order of the joints.
        tau: Drive torques as recorded [N m or N], shape ``(N, nv)``.

    Raises:
        LogError: If the column map names a joint that the robot does not have.
    """
    _require_joints(table, robot, table.low_pass, "went through a low pass")
    t = table.columns["t"]

    def inverted(x: Float[Array, " N"], hertz: float) -> Float[Array, " N"]:
        return x + CubicSpline(t, x)(t, 1) / (2 * np.pi * hertz)

    out, edges = _changed_columns(robot, tau, table.low_pass, inverted)
    words = ", ".join(f"{hertz:g} Hz of {joint}" for joint, hertz in edges.items())
    return out, (f"{table.file}: the low pass at {words} was taken back, as the column map says.",) if edges else ()


def _changed_columns(
    robot: Robot,
    tau: Float[Array, "N nv"],
    stated: Mapping[str, float],
    change: Callable[[Float[Array, " N"], float], Float[Array, " N"]],
) -> tuple[Float[Array, "N nv"], dict[str, float]]:
    """Torques after a change of some joints' columns, read-only, and the number that was used for each changed joint.

    Args:
        robot: The robot, which defines the order of the joints.
        tau: Drive torques [N m or N].
        stated: Number of each joint; an empty name means all other joints.
        change: Function from a torque that is not constant and the joint's number to the new torque.
    """
    out, used = tau.copy(), dict[str, float]()
    for j, joint in enumerate(robot.joint_names):
        number = stated.get(joint, stated.get(""))
        if number is not None and np.ptp(tau[:, j]) > 0:
            out[:, j] = change(tau[:, j], number)
            used[joint] = number
    return (read_only(out), used) if used else (tau, used)


def put_back_sentences(table: Table, robot: Robot) -> tuple[str, ...]:
    """Warnings that the modelled gravity or friction is added to torques, so that errors of either may be hidden."""
    no_gravity, no_friction = (joints_without(table, robot, part) for part in ("gravity", "friction"))
    modelled = dict(zip(robot.joint_names, robot.viscous_friction + robot.coulomb_friction, strict=True))
    with_modelled_friction = tuple(joint for joint in no_friction if modelled[joint] > 0)
    out = []
    for joints, what, wrong in (
        (no_gravity, "gravity torque", "weights that are wrong in the model show"),
        (with_modelled_friction, "friction", "friction that is wrong in the model shows"),
    ):
        if joints:
            out.append(
                f"{table.file}: the model's {what} was put back into the torque of {', '.join(joints)}, from which a "
                f"controller had taken it, as the column map says: {wrong} as far as it was not taken out."
            )
    if no_friction and not with_modelled_friction:
        out.append(
            f"{table.file}: the column map says that friction is compensated, but {robot.name} states none of "
            f"{', '.join(no_friction)}: nothing was put back."
        )
    return tuple(out)
