# pyright: reportAttributeAccessIssue=false
"""From a `Robot` to a `MapModel`: tip, limits, stiffness, posture and the branches of its inverse kinematics.

Built-in devices also have data that their robot files lack: inverse kinematics in closed form, published stiffness and
the usual posture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.devices import cea, phantom
from phantom_dyn.errors import ParameterError, RobotError, known_names
from phantom_dyn.maps.map_model import MapModel
from phantom_dyn.model.robot import Robot, tree_position_limits


@dataclass(frozen=True)
class Device:
    """A built-in device.

    Attributes:
        branches: Candidates ``(B, N, 3)`` [rad] of tip positions ``(N, 3)`` [m], NaN where there is none.
        posture: Configuration [rad] that selects the branch by default.
        stiffness: Function for the stiffness of the joints [N m/rad]; None where none is published.
        stiffness_note: Remark on the source of the stiffness, for captions.
    """

    branches: Callable[[Array], Array]
    posture: tuple[float, float, float]
    stiffness: Callable[[], Array] | None = None
    stiffness_note: str = ""


def phantom_branches(p: Array) -> Array:
    """The one assembly that the parallelogram allows."""
    return phantom.inverse_kinematics(p)[None]


def cea_branches(p: Array) -> Array:
    """Four candidates: the arm on either side of the axis of q1, with the elbow on either side.

    In the plane of the arm, q2 and q5 are absolute, so that ``(rho, -z) = d3 (cos q2, sin q2) + d4 (cos q5, sin q5)``.
    """
    d3, d4 = cea.LENGTHS.d3, cea.LENGTHS.d4
    out = []
    for side in (1.0, -1.0):
        rho, depth = side * np.hypot(p[:, 0], p[:, 1]), -p[:, 2]
        turn = np.arctan2(side * p[:, 1], side * p[:, 0])
        square = rho**2 + depth**2
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.arccos((square - d3**2 - d4**2) / (2 * d3 * d4))
        for elbow in (apart, -apart):
            q2 = np.arctan2(depth, rho) - np.arctan2(d4 * np.sin(elbow), d3 + d4 * np.cos(elbow))
            out.append(np.stack([turn, q2, q2 + elbow], axis=-1))
    return np.stack(out)


DEVICES = {
    "phantom_1_5": Device(branches=phantom_branches, posture=(0.0, 0.0, 0.0)),
    "cea_branch": Device(
        branches=cea_branches,
        posture=(0.0, -np.pi / 4, np.pi / 4),
        stiffness=cea.joint_stiffness,
        stiffness_note="joint stiffness 1000 N m/rad: the source's 1 N m/rad, read in N m/mrad (as printed it gives a "
        "few N/m, against the published 2000 to 5000 N/m)",
    ),
}


def device_of(source: str, frame: str) -> Device | None:
    """Device of a built-in name with its own tip, or None."""
    return DEVICES.get(source) if frame == "tip" else None


def map_model(
    robot: Robot,
    *,
    frame: str | None = None,
    stiffness: Float[Array, " nv"] | None = None,
    posture: Float[Array, " nv"] | None = None,
) -> MapModel:
    """A robot with the tip, limits, stiffness and posture of a map.

    Args:
        robot: A plain robot or a closed chain.
        frame: Tip; by default ``tip`` where the robot has such a frame, else its last frame.
        stiffness: Of each joint [N m/rad]; by default the published one of a built-in device, else the position gain
            ``kp`` of the controllers in ``robot.yaml``, else none.
        posture: Configuration [rad or m] near which a branch is taken; by default that of a built-in device or the
            start of a numerically closed chain, else zero, and for a joint that cannot reach zero the middle of its
            range.

    Raises:
        RobotError: If the robot has no such frame, or the frame does not move.
        ParameterError: If stiffness or posture do not fit the robot.
    """
    model = robot.model
    chosen = _frame(robot, frame)
    joint = model.frames[chosen].parentJoint
    if joint == 0:
        raise RobotError(f"The frame {model.frames[chosen].name!r} of {robot.name} does not move: name a moving one.")
    name = model.frames[chosen].name
    device = device_of(robot.source, name)
    lower, upper = tree_position_limits(robot.model)
    stiff, note = _stiffness(robot, device, stiffness)
    active = list(robot.tree_rows)
    return MapModel(
        robot=robot,
        frame=name,
        tip=chosen,
        lower=lower,
        upper=upper,
        stiffness=stiff,
        stiffness_note=note,
        posture=_posture(robot, device, posture, lower[active], upper[active]),
        branches=None if device is None else device.branches,
    )


def _frame(robot: Robot, frame: str | None) -> int:
    names = [f.name for f in robot.model.frames]
    if frame is None:
        return robot.model.getFrameId("tip") if "tip" in names else len(names) - 1
    if frame not in names:
        raise RobotError(f"{robot.name} has no frame {frame!r}: {known_names(frame, dict.fromkeys(names), 'frames')}")
    return robot.model.getFrameId(frame)


def _stiffness(robot: Robot, device: Device | None, given: Array | None) -> tuple[Array | None, str]:
    if given is not None:
        if given.shape != (robot.nv,) or not (np.isfinite(given).all() and (given > 0).all()):
            raise ParameterError(
                f"The stiffness {np.array2string(given, separator=', ')} does not fit {robot.name}: give one number "
                f"above 0 for each of {', '.join(robot.joint_names)}."
            )
        return given, f"joint stiffness as given, {_numbers(given)} N m/rad"
    if device is not None and device.stiffness is not None:
        return device.stiffness(), device.stiffness_note
    gains = [actuator.controller.kp if actuator.controller else 0.0 for actuator in robot.actuators]
    if all(gain > 0 for gain in gains):
        return np.array(gains), f"joint stiffness from the controllers' kp, {_numbers(np.array(gains))} N m/rad"
    return None, ""


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:g}" for value in values)


def _posture(robot: Robot, device: Device | None, given: Array | None, lower: Array, upper: Array) -> Array:
    if given is not None:
        if given.shape != (robot.nv,) or not np.isfinite(given).all():
            raise ParameterError(
                f"The configuration {np.array2string(given, separator=', ')} does not fit {robot.name}: give one "
                f"number for each of {', '.join(robot.joint_names)}."
            )
        return given
    if device is not None and device.posture is not None:
        return np.array(device.posture)
    if robot.chain is not None and robot.chain.anchors:
        return robot.chain.start[list(robot.chain.active)]
    bounded = np.isfinite(lower) & np.isfinite(upper)
    middle = (np.where(bounded, lower, 0.0) + np.where(bounded, upper, 0.0)) / 2
    nearest_to_zero = np.where(bounded, middle, np.clip(0.0, lower, upper))
    return np.where((lower <= 0) & (upper >= 0), 0.0, nearest_to_zero)
