"""Reads controller gains from a ros2_control file, the YAML of a controller manager."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phantom_dyn.errors import RobotError, shortened
from phantom_dyn.model.files.settings_file import describe
from phantom_dyn.model.robot_config import ControllerConfig, JointConfig, RobotConfig

PARAMETERS = "ros__parameters"
_LARGEST = 1e12


class Ros2Config(RobotConfig, frozen=True):
    """Controllers of a ros2_control file, and sentences about their ignored parts."""

    sentences: tuple[str, ...] = ()


def is_ros2_control(content: Mapping[str, Any]) -> bool:
    """Whether this is the content of a file of ROS 2 parameters."""
    return any(isinstance(value, dict) and PARAMETERS in value for value in content.values())


def ros2_config(content: Mapping[str, Any], path: Path) -> Ros2Config:
    """Controllers of a ros2_control file: ``gains.<joint>.p`` and ``.d`` of controllers that command effort.

    Args:
        content: Parsed content of the file.
        path: The file, for messages.

    Raises:
        RobotError: If no controller has gains, two controllers have gains for one joint, or a gain is negative or not
            a number.
    """
    joints: dict[str, JointConfig] = {}
    integral: list[str] = []
    without_effort: list[str] = []
    for controller, value in content.items():
        parameters = value.get(PARAMETERS) if isinstance(value, dict) else None
        gains = parameters.get("gains") if isinstance(parameters, dict) else None
        if not isinstance(gains, dict):
            continue
        interfaces = parameters.get("command_interfaces") if isinstance(parameters, dict) else None
        if isinstance(interfaces, list) and "effort" not in interfaces:
            without_effort.append(str(controller))
            continue
        for joint, own in gains.items():
            if not isinstance(own, dict):
                continue
            where = f"{path}: {controller}.{PARAMETERS}.gains.{shortened(str(joint))}"
            if joint in joints:
                raise RobotError(f"{where} is stated in another controller, too: give a file with one of them.")
            kp, kd, ki = (_gain(own, key, where) for key in ("p", "d", "i"))
            joints[str(joint)] = JointConfig(controller=ControllerConfig(kp=kp, kd=kd))
            integral += [str(joint)] if ki else []
    if not joints:
        only = f" ({', '.join(without_effort)} command no effort)" if without_effort else ""
        raise RobotError(
            f"{path} is a file of ROS 2 parameters without gains of a controller that commands effort{only}: give one "
            "with gains: {<joint>: {p: ..., d: ...}}, or a robot.yaml."
        )
    sentence = f"{path}: the integral parts of {', '.join(integral)} are left out: a gap may come from them."
    return Ros2Config(joints=joints, sentences=(sentence,) if integral else ())


def _gain(own: Mapping[str, Any], key: str, where: str) -> float:
    value = own.get(key, 0.0)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= _LARGEST:
        raise RobotError(f"{where}.{key} is {describe(value)}, wanted a number of 0 or more.")
    return float(value)
