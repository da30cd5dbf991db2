"""Registers definitions of message types: those in the bag, or built-in ones.

SQLite bags of older ROS 2 versions contain no definitions.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from phantom_dyn.errors import LogError

_MOST = 4096
"""Largest length of a fixed array in a definition: a reader allocates the whole array; joints need no longer one."""

_CONTROLLER_STATE = """
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint reference
trajectory_msgs/JointTrajectoryPoint feedback
trajectory_msgs/JointTrajectoryPoint error
trajectory_msgs/JointTrajectoryPoint output
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
string[] multi_dof_joint_names
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_reference
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_feedback
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_error
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_output
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_desired
trajectory_msgs/MultiDOFJointTrajectoryPoint multi_dof_actual
"""
_DYNAMIC = """
std_msgs/Header header
string[] joint_names
InterfaceValue[] interface_values
================================================================================
MSG: control_msgs/InterfaceValue
string[] interface_names
float64[] values
"""
_IMU = """
float32[4] quaternion
float32[3] gyroscope
float32[3] accelerometer
float32[3] rpy
{temperature} temperature
"""
_COMMAND = """
uint8 mode
float32 q
float32 dq
float32 tau
float32 kp
float32 kd
"""
_MOTOR = """
uint8 mode
float32 q
float32 dq
float32 ddq
float32 tau_est
"""
_RULE = "=" * 80
_GO = """
uint8[2] head
uint8 level_flag
uint8 frame_reserve
uint32[2] sn
uint32[2] version
uint16 bandwidth
"""
_GO_STATE = f"""{_GO}
IMUState imu_state
MotorState[20] motor_state
BmsState bms_state
int16[4] foot_force
int16[4] foot_force_est
uint32 tick
uint8[40] wireless_remote
uint8 bit_flag
float32 adc_reel
int8 temperature_ntc1
int8 temperature_ntc2
float32 power_v
float32 power_a
uint16[4] fan_frequency
uint32 reserve
uint32 crc
{_RULE}
MSG: unitree_go/IMUState
{_IMU.format(temperature="int8")}
{_RULE}
MSG: unitree_go/MotorState
{_MOTOR}
float32 q_raw
float32 dq_raw
float32 ddq_raw
int8 temperature
uint32 lost
uint32[2] reserve
{_RULE}
MSG: unitree_go/BmsState
uint8 version_high
uint8 version_low
uint8 status
uint8 soc
int32 current
uint16 cycle
int8[2] bq_ntc
int8[2] mcu_ntc
uint16[15] cell_vol
"""
_GO_COMMAND = f"""{_GO}
MotorCmd[20] motor_cmd
BmsCmd bms_cmd
uint8[40] wireless_remote
uint8[12] led
uint8[2] fan
uint8 gpio
uint32 reserve
uint32 crc
{_RULE}
MSG: unitree_go/BmsCmd
uint8 off
uint8[3] reserve
{_RULE}
MSG: unitree_go/MotorCmd
{_COMMAND}
uint32[3] reserve
"""
_HG_STATE = f"""
uint32[2] version
uint8 mode_pr
uint8 mode_machine
uint32 tick
IMUState imu_state
MotorState[35] motor_state
uint8[40] wireless_remote
uint32[4] reserve
uint32 crc
{_RULE}
MSG: unitree_hg/IMUState
{_IMU.format(temperature="int16")}
{_RULE}
MSG: unitree_hg/MotorState
{_MOTOR}
int16[2] temperature
float32 vol
uint32[2] sensor
uint32 motorstate
uint32[4] reserve
"""
_HG_COMMAND = f"""
uint8 mode_pr
uint8 mode_machine
MotorCmd[35] motor_cmd
uint32[4] reserve
uint32 crc
{_RULE}
MSG: unitree_hg/MotorCmd
{_COMMAND}
uint32 reserve
"""
_KNOWN = {
    "control_msgs/msg/JointTrajectoryControllerState": _CONTROLLER_STATE,
    "control_msgs/msg/DynamicJointState": _DYNAMIC,
    "unitree_go/msg/LowState": _GO_STATE,
    "unitree_go/msg/LowCmd": _GO_COMMAND,
    "unitree_hg/msg/LowState": _HG_STATE,
    "unitree_hg/msg/LowCmd": _HG_COMMAND,
}
"""Definitions from ROS 2 Humble and from Unitree's own packages."""


def register_types(file: str, store: Any, connections: Iterable[Any]) -> None:
    """Add the message types of some connections to a type store of rosbags.

    Args:
        file: Name of the bag, for messages.
        store: Type store; types that it has already are not changed.
        connections: Connections of the bag.

    Raises:
        LogError: If there is neither a definition of a type in the bag nor a built-in one, or if a definition would
            need very much memory.
    """
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    for connection in connections:
        name = connection.msgtype
        if name in store.types:
            continue
        definition = connection.msgdef
        if definition.format is MessageDefinitionFormat.IDL:
            found = get_types_from_idl(definition.data)
        elif definition.data.strip():
            found = get_types_from_msg(definition.data, name)
        elif name in _KNOWN:
            found = get_types_from_msg(_KNOWN[name], name)
        else:
            raise LogError(
                f"{file} does not hold the definition of {name} on {connection.topic}: convert it to MCAP, which does, "
                "with ros2 bag convert where that message is installed."
            )
        _require_small(file, found)
        store.register({key: value for key, value in found.items() if key not in store.types})


def _require_small(file: str, types: Any) -> None:
    """Raise an error for definitions with which a message of few bytes becomes millions of objects."""
    # The description of a field with a fixed array is ``(kind, (element, length))``.
    for name, (_, fields) in types.items():
        lengths = [kind[1][1] for _, kind in fields if isinstance(kind[1], tuple) and isinstance(kind[1][1], int)]
        if not fields or max(lengths, default=0) > _MOST:
            raise LogError(
                f"{file}: the definition of {name} has no fields, or an array of more than {_MOST}: no message about "
                "joints is so; record the bag again."
            )
