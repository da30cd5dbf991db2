"""Converts one message of a bag to values of its joints: measured values, or references.

Measured values come from sensor_msgs/JointState, control_msgs/JointTrajectoryControllerState (with ``reference`` and
``feedback``, in older versions ``desired`` and ``actual``), control_msgs/DynamicJointState,
franka_msgs/FrankaRobotState and FrankaState, foxglove_msgs/JointStates and Unitree's LowState. References also come
from trajectory_msgs/JointTrajectory, Unitree's LowCmd and std_msgs/Float64MultiArray.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from identification.data.readers.bags.unitree import base_values
from phantom_dyn.array_types import Array

JOINT_STATE = "sensor_msgs/msg/JointState"
CONTROLLER_STATE = "control_msgs/msg/JointTrajectoryControllerState"
_INTERFACES = {
    "position": "q",
    "velocity": "v",
    "effort": "tau",
    "torque": "tau",
    "current": "i",
    "motor_current": "i",
    "temperature": "temp",
    "motor_temperature": "temp",
}
"""Quantity of each interface of ros2_control, by the interface's name."""
DOCUMENTED_ORDER = ("unitree_go/msg/LowState", "unitree_hg/msg/LowState", "unitree_legged_msgs/msg/LowState")
"""Message types that list motors without names, in an order that the maker documents."""


@dataclass(frozen=True)
class JointValues:
    """Values of the joints in one message.

    Attributes:
        names: Names of the joints; empty if the message lists its joints without names.
        values: For each quantity one value per joint, NaN for joints without a value; or an empty array.
        stamp: Time stamp of the message [ns]; None if it has no time stamp.
        is_tick: True if the stamp counts from the start of the device; False if it is the time of day.
        base: Values of the sensors on the base (`identification.data.readers.bags.unitree.base_values`); None without.
    """

    names: tuple[str, ...]
    values: Mapping[str, Array] = field(default_factory=dict)
    stamp: int | None = None
    is_tick: bool = False
    base: Array | None = None


def _stamp(message: Any) -> int:
    time = message.header.stamp if hasattr(message, "header") else message.timestamp
    return int(time.sec) * 10**9 + int(time.nanosec)


def _joint_state(message: Any) -> JointValues:
    values = {"q": message.position, "v": message.velocity, "tau": message.effort}
    return JointValues(tuple(message.name), values, _stamp(message))


def _point(message: Any, name: str, older: str) -> Any:
    """A point of a controller's state under its newer name; if it is missing or empty, under its older name."""
    newer_point = getattr(message, name, None)
    older_point = getattr(message, older, None)
    if newer_point is None or (older_point is not None and not len(newer_point.positions)):
        return older_point
    return newer_point


def _controller_state(message: Any) -> JointValues:
    reference, measured = _point(message, "reference", "desired"), _point(message, "feedback", "actual")
    values = {"q": measured.positions, "v": measured.velocities, "tau": measured.effort, "q_ref": reference.positions}
    output = getattr(message, "output", None)
    # The output of a controller that commands torques is used if no torque is measured.
    if not len(measured.effort) and output is not None:
        values["tau"] = output.effort
    return JointValues(tuple(message.joint_names), values, _stamp(message))


def _dynamic_joint_state(message: Any) -> JointValues:
    names = tuple(message.joint_names)
    values: dict[str, Array] = {}
    for k, joint in enumerate(message.interface_values[: len(names)]):
        for interface, value in zip(joint.interface_names, joint.values, strict=False):
            if (quantity := _INTERFACES.get(interface)) is not None:
                values.setdefault(quantity, np.full(len(names), np.nan))[k] = value
    return JointValues(names, values, _stamp(message))


def _franka_robot_state(message: Any) -> JointValues:
    measured, desired = message.measured_joint_state, message.desired_joint_state
    values = {"q": measured.position, "v": measured.velocity, "tau": measured.effort, "q_ref": desired.position}
    return JointValues(tuple(measured.name), values, _stamp(message))


def _franka_state(message: Any) -> JointValues:
    return JointValues(
        (), {"q": message.q, "v": message.dq, "tau": message.tau_J, "q_ref": message.q_d}, _stamp(message)
    )


def _foxglove_states(message: Any) -> JointValues:
    fields = {"q": "position", "v": "velocity", "tau": "effort"}
    values = {key: np.array([_optional(joint, name) for joint in message.joints]) for key, name in fields.items()}
    return JointValues(tuple(joint.name for joint in message.joints), values, _stamp(message))


def _optional(joint: Any, name: str) -> float:
    """An optional number, NaN if it is missing; ROS stores it as a list of at most one number."""
    value = np.atleast_1d(getattr(joint, name, np.nan))
    return float(value[0]) if len(value) else np.nan


def _low_state(message: Any) -> JointValues:
    motors = message.motor_state if hasattr(message, "motor_state") else message.motorState
    torque = "tau_est" if hasattr(motors[0], "tau_est") else "tauEst"
    values = {key: _motor_values(motors, name) for key, name in (("q", "q"), ("v", "dq"), ("tau", torque))}
    # Newer motors have two temperatures; the second one is the winding's.
    values["temp"] = np.array([np.atleast_1d(motor.temperature)[-1] for motor in motors], dtype=float)
    tick = getattr(message, "tick", None)
    return JointValues((), values, None if not tick else int(tick) * 10**6, is_tick=True, base=base_values(message))


def _motor_values(motors: Sequence[Any], name: str) -> Array:
    return np.array([getattr(motor, name) for motor in motors], dtype=float)


def _low_command(message: Any) -> JointValues:
    motors = message.motor_cmd if hasattr(message, "motor_cmd") else message.motorCmd
    return JointValues((), {"q_ref": _motor_values(motors, "q")})


def _trajectory(message: Any) -> JointValues:
    # A message with one point is a reference for its own time. A message with a whole trajectory is not.
    positions = message.points[0].positions if len(message.points) == 1 else np.empty(0)
    return JointValues(tuple(message.joint_names), {"q_ref": positions}, _stamp(message))


def _unnamed_references(message: Any) -> JointValues:
    return JointValues((), {"q_ref": message.data})


def _as_reference(read: Callable[[Any], JointValues]) -> Callable[[Any], JointValues]:
    """A reader that returns the positions of a joint state as references."""

    def reference(message: Any) -> JointValues:
        values = read(message)
        return JointValues(values.names, {"q_ref": values.values["q"]}, values.stamp)

    return reference


STATES: dict[str, Callable[[Any], JointValues]] = {
    JOINT_STATE: _joint_state,
    CONTROLLER_STATE: _controller_state,
    "control_msgs/msg/DynamicJointState": _dynamic_joint_state,
    "franka_msgs/msg/FrankaRobotState": _franka_robot_state,
    "franka_msgs/msg/FrankaState": _franka_state,
    "foxglove_msgs/msg/JointStates": _foxglove_states,
    "unitree_go/msg/LowState": _low_state,
    "unitree_hg/msg/LowState": _low_state,
    "unitree_legged_msgs/msg/LowState": _low_state,
}
"""Reader of measured values for each type of message."""

REFERENCES: dict[str, Callable[[Any], JointValues]] = {
    JOINT_STATE: _as_reference(_joint_state),
    CONTROLLER_STATE: _controller_state,
    "franka_msgs/msg/FrankaRobotState": _franka_robot_state,
    "franka_msgs/msg/FrankaState": _franka_state,
    "trajectory_msgs/msg/JointTrajectory": _trajectory,
    "std_msgs/msg/Float64MultiArray": _unnamed_references,
    "unitree_go/msg/LowCmd": _low_command,
    "unitree_hg/msg/LowCmd": _low_command,
    "unitree_legged_msgs/msg/LowCmd": _low_command,
}
"""Reader of references (``q_ref``) for each type of message."""
