"""Values of joints in messages of bags: measured ones and references, by their standard quantities.

Read are sensor_msgs/JointState, control_msgs/JointTrajectoryControllerState (with ``reference`` and ``feedback``, older
with ``desired`` and ``actual``), control_msgs/DynamicJointState, franka_msgs/FrankaRobotState and FrankaState,
foxglove_msgs/JointStates and Unitree's LowState; for references also trajectory_msgs/JointTrajectory, Unitree's LowCmd
and std_msgs/Float64MultiArray.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from identification.data.readers.bags.unitree import base_of
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
"""Names of interfaces of ros2_control and their quantities."""
DOCUMENTED_ORDER = ("unitree_go/msg/LowState", "unitree_hg/msg/LowState", "unitree_legged_msgs/msg/LowState")
"""Types whose numbers have an order that the maker documents."""


@dataclass(frozen=True)
class JointValues:
    """Values of the joints in one message.

    Attributes:
        names: Names of the joints; empty where the message numbers them.
        values: By quantity, one a joint, or empty; NaN for a joint of which nothing is said.
        stamp: Time of the message [ns], None where it has none.
        is_tick: True for a stamp that counts from a start of its own.
        base: What it says of the base, see `base_of_low_states`; None where it says nothing.
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
    """A point of a controller's state; the older name is taken where the newer one is not there or empty."""
    point = getattr(message, name, None)
    other = getattr(message, older, None)
    return other if point is None or (other is not None and not len(point.positions)) else point


def _controller_state(message: Any) -> JointValues:
    asked, found = _point(message, "reference", "desired"), _point(message, "feedback", "actual")
    values = {"q": found.positions, "v": found.velocities, "tau": found.effort, "q_ref": asked.positions}
    output = getattr(message, "output", None)
    # What the controller sends to the drives, where it commands torques and nobody measures them.
    if not len(found.effort) and output is not None:
        values["tau"] = output.effort
    return JointValues(tuple(message.joint_names), values, _stamp(message))


def _dynamic_joint_state(message: Any) -> JointValues:
    names = tuple(message.joint_names)
    values: dict[str, Array] = {}
    for k, one in enumerate(message.interface_values[: len(names)]):
        for interface, value in zip(one.interface_names, one.values, strict=False):
            if (quantity := _INTERFACES.get(interface)) is not None:
                values.setdefault(quantity, np.full(len(names), np.nan))[k] = value
    return JointValues(names, values, _stamp(message))


def _franka_robot_state(message: Any) -> JointValues:
    found, asked = message.measured_joint_state, message.desired_joint_state
    values = {"q": found.position, "v": found.velocity, "tau": found.effort, "q_ref": asked.position}
    return JointValues(tuple(found.name), values, _stamp(message))


def _franka_state(message: Any) -> JointValues:
    return JointValues(
        (), {"q": message.q, "v": message.dq, "tau": message.tau_J, "q_ref": message.q_d}, _stamp(message)
    )


def _foxglove_states(message: Any) -> JointValues:
    fields = {"q": "position", "v": "velocity", "tau": "effort"}
    values = {key: np.array([_optional(joint, name) for joint in message.joints]) for key, name in fields.items()}
    return JointValues(tuple(joint.name for joint in message.joints), values, _stamp(message))


def _optional(joint: Any, name: str) -> float:
    """An optional number, which ROS has as a list of at most one."""
    value = np.atleast_1d(getattr(joint, name, np.nan))
    return float(value[0]) if len(value) else np.nan


def _low_state(message: Any) -> JointValues:
    motors = message.motor_state if hasattr(message, "motor_state") else message.motorState
    torque = "tau_est" if hasattr(motors[0], "tau_est") else "tauEst"
    values = {key: _of_motors(motors, name) for key, name in (("q", "q"), ("v", "dq"), ("tau", torque))}
    # Of the two temperatures of newer motors the second is that of the winding.
    values["temp"] = np.array([np.atleast_1d(motor.temperature)[-1] for motor in motors], dtype=float)
    tick = getattr(message, "tick", None)
    return JointValues((), values, None if not tick else int(tick) * 10**6, is_tick=True, base=base_of(message))


def _of_motors(motors: Sequence[Any], name: str) -> Array:
    return np.array([getattr(motor, name) for motor in motors], dtype=float)


def _low_command(message: Any) -> JointValues:
    motors = message.motor_cmd if hasattr(message, "motor_cmd") else message.motorCmd
    return JointValues((), {"q_ref": _of_motors(motors, "q")})


def _trajectory(message: Any) -> JointValues:
    # A controller that streams sends one point at a time; of a whole trajectory nothing holds at that instant.
    positions = message.points[0].positions if len(message.points) == 1 else np.empty(0)
    return JointValues(tuple(message.joint_names), {"q_ref": positions}, _stamp(message))


def _numbers(message: Any) -> JointValues:
    return JointValues((), {"q_ref": message.data})


def _as_reference(read: Callable[[Any], JointValues]) -> Callable[[Any], JointValues]:
    def reference(message: Any) -> JointValues:
        found = read(message)
        return JointValues(found.names, {"q_ref": found.values["q"]}, found.stamp)

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
"""Readers of measured joint states by type of message."""

REFERENCES: dict[str, Callable[[Any], JointValues]] = {
    JOINT_STATE: _as_reference(_joint_state),
    CONTROLLER_STATE: _controller_state,
    "franka_msgs/msg/FrankaRobotState": _franka_robot_state,
    "franka_msgs/msg/FrankaState": _franka_state,
    "trajectory_msgs/msg/JointTrajectory": _trajectory,
    "std_msgs/msg/Float64MultiArray": _numbers,
    "unitree_go/msg/LowCmd": _low_command,
    "unitree_hg/msg/LowCmd": _low_command,
    "unitree_legged_msgs/msg/LowCmd": _low_command,
}
"""Readers of references by type of message; their quantity is ``q_ref``."""
