"""Adds the model's gravity and friction to recorded torques from which a controller had subtracted its own.

The column map says which torques these are. A low pass of the torque is inverted first. Gravity needs only positions.
Friction needs velocities, and at standstill these are noise whose sign changes at every sample. It is therefore added
with the same velocities from which the model's friction is computed, so that the two cancel.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.interpolate import CubicSpline

from identification.data.recording import Recording, Table
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.dynamics.dynamics import active_friction, gravity_torque
from phantom_dyn.errors import LogError, known_names
from phantom_dyn.model.robot import Robot


def joints_without(table: Table, robot: Robot, part: str) -> tuple[str, ...]:
    """Joints from whose torque a controller had subtracted ``gravity`` or ``friction`` (`part`), in the robot's order.

    Raises:
        LogError: If the column map names a joint that the robot does not have.
    """
    _require_joints(table, robot, table.compensated, "is compensated")
    of_all = table.compensated.get("", ())
    return tuple(joint for joint in robot.joint_names if part in (*of_all, *table.compensated.get(joint, ())))


def _require_joints(table: Table, robot: Robot, joints: Iterable[str], what: str) -> None:
    for joint in joints:
        if joint and joint not in robot.joint_names:
            raise LogError(
                f"{table.file}: the column map says that tau.{joint} {what}, a joint that {robot.name} does "
                f"not have: {known_names(joint, robot.joint_names, 'joints')}"
            )


def before_low_pass(
    table: Table, robot: Robot, tau: Float[Array, "N nv"]
) -> tuple[Float[Array, "N nv"], tuple[str, ...]]:
    r"""Torques before a low pass of first order, and a sentence that says which low passes were inverted.

    A low pass with time constant T turns :math:`\tau + T \dot\tau` into :math:`\tau`.

    Args:
        table: Table with the low passes that the column map states.
        robot: Gives the joints.
        tau: Drive torques as recorded [N m or N], shape ``(N, nv)``.

    Raises:
        LogError: If the column map names a joint that the robot does not have.
    """
    _require_joints(table, robot, table.low_pass, "went through a low pass")
    if not table.low_pass:
        return tau, ()
    out, said = tau.copy(), []
    for j, joint in enumerate(robot.joint_names):
        hertz = table.low_pass.get(joint, table.low_pass.get(""))
        if hertz is None or np.ptp(tau[:, j]) == 0:
            continue
        t = table.columns["t"]
        out[:, j] += CubicSpline(t, tau[:, j])(t, 1) / (2 * np.pi * hertz)
        said.append(f"{hertz:g} Hz of {joint}")
    if not said:
        return tau, ()
    return read_only(out), (f"{table.file}: the low pass at {', '.join(said)} was taken back, as the column map says.",)


def gravity_taken(robot: Robot, q: Float[Array, "N nv"], joints: tuple[str, ...]) -> Float[Array, "N nv"]:
    """Gravity torque of some joints [N m or N], zero for the others, shape ``(N, nv)``.

    Args:
        robot: Its gravity torque is taken to be the controller's.
        q: Joint positions [rad or m], shape ``(N, nv)``.
        joints: Names of the joints whose gravity is wanted.

    Raises:
        ChainError: If a loop of a closed chain cannot be closed at a sample.
    """
    return gravity_torque(robot, q) * np.isin(robot.joint_names, joints)


def friction_taken(robot: Robot, recording: Recording, v: Float[Array, "N nv"]) -> Float[Array, "N nv"]:
    """Friction torque that a controller had subtracted from a recording [N m or N], shape ``(N, nv)``.

    Args:
        robot: Its friction is taken to be the controller's.
        recording: Names the joints whose friction was subtracted.
        v: Velocities from which the model's friction is computed as well [rad/s or m/s], shape ``(N, nv)``.
    """
    return active_friction(robot, v) * np.isin(robot.joint_names, recording.friction_taken)


def put_back_sentences(table: Table, robot: Robot) -> tuple[str, ...]:
    """Sentences on gravity and friction that are added to torques, and on what these can no longer show."""
    weightless, smooth = (joints_without(table, robot, part) for part in ("gravity", "friction"))
    rubbing = dict(zip(robot.joint_names, robot.viscous_friction + robot.coulomb_friction, strict=True))
    rough = tuple(joint for joint in smooth if rubbing[joint] > 0)
    out = []
    for joints, what, wrong in (
        (weightless, "gravity torque", "weights that are wrong in the model show"),
        (rough, "friction", "friction that is wrong in the model shows"),
    ):
        if joints:
            out.append(
                f"{table.file}: the model's {what} was put back into the torque of {', '.join(joints)}, from which a "
                f"controller had taken it, as the column map says: {wrong} as far as it was not taken out."
            )
    if smooth and not rough:
        out.append(
            f"{table.file}: the column map says that friction is compensated, but {robot.name} states none of "
            f"{', '.join(smooth)}: nothing was put back."
        )
    return tuple(out)
