"""Computes the drive torque of each written model or law along a recording, and the effects that a file can contain.

Each file is loaded again from its text, except the MJCF, whose torques were already compared in MuJoCo.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from identification.data.log import Log
from identification.diagnosis.columns.known_geometry import effects_on_torques
from identification.diagnosis.columns.operations import motion_of, operation_of, with_known, with_known_payloads
from identification.diagnosis.columns.terms import KnownEffect
from identification.diagnosis.replay import Replay
from identification.diagnosis.result import Adjusted
from identification.export.corrected.corrected_mjcf import compliances_in_mjcf, zeros_in_file
from identification.export.corrected.corrected_model import (
    CorrectedModel,
    added_torque,
    numbers_of_effect,
    with_zeros_moved,
)
from identification.export.corrected.corrected_urdf import robot_of_urdf
from identification.export.corrected.corrected_yaml import known_effects, read_corrected
from identification.export.corrected.found_effects import robot_within_tolerances
from identification.export.corrected.given_drives import can_delay_references
from identification.export.file_names import ISAAC, RESIDUAL
from identification.export.model_files.reload import robot_with_urdf
from identification.export.uses.feedforward import OWN_LAWS, loaded, over_samples
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.described import ModelNumbers
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.changed_robot import with_friction, with_rotor_inertia
from phantom_dyn.model.files.plain_file import unnamed_file
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.splines import interpolated

DRIVE_NUMBERS = frozenset({"gain", "limit", "delay", "lag", "reference_delay", "gap", "stiffness"})
"""Numbers of an effect that act on the command of the drive or in the transmission, not as an added torque."""
_URDF = frozenset({"viscous", "coulomb", "robot", "turned", "zero", "limit"})
_DRIVES = frozenset({"rotor_inertia", "delay"})
_MJCF = _URDF | _DRIVES | {"offset", "spring", "gain", "lag", "gap", "stiffness", "waves", "coupling"}


@dataclass(frozen=True)
class Format:
    """Numbers and laws that one kind of file can contain.

    Attributes:
        numbers: Fields of `ModelNumbers` that the file can express; None if it can express the law of every effect.
        laws: Effects for which the file has a separate law.
    """

    numbers: frozenset[str] | None
    laws: tuple[str, ...] = ()


ALL_LAWS = Format(None)
URDF_FORMAT = Format(_URDF)
MJCF_FORMAT = Format(_MJCF)
ISAAC_FORMAT = Format(_URDF | _DRIVES | {"reference_delay"})
FEEDFORWARD_FORMAT = Format(_MJCF - {"gap", "stiffness", "lag"}, OWN_LAWS)
"""A feedforward treats a lag as a delay, which is only a part of its effect."""


def contains_effect(kind: Format, corrected: CorrectedModel, effect: KnownEffect) -> bool:
    """True if a file of this kind contains an effect in full.

    Args:
        kind: Kind of the file.
        corrected: The model from which the file is built.
        effect: The effect, with its parameters in the order of the catalogue.
    """
    if kind.numbers is None or effect.effect in kind.laws:
        return True
    numbers = numbers_of_effect(corrected.given, effect)
    used = used_numbers(numbers)
    joint = str(effect.joint)
    if kind is MJCF_FORMAT and "reference_delay" in used:
        names = corrected.given.joint_names if effect.joint is None else (joint,)
        return all(can_delay_references(corrected, name) for name in names)
    if not numbers.whole or not used <= kind.numbers:
        return False
    if "zero" in used and kind is not FEEDFORWARD_FORMAT:
        return joint in zeros_in_file(corrected)
    return "stiffness" not in used or joint in compliances_in_mjcf(corrected)


def used_numbers(numbers: ModelNumbers) -> frozenset[str]:
    """Names of the numbers of an effect that are not empty or zero."""
    values = {field.name: getattr(numbers, field.name) for field in fields(ModelNumbers) if field.name != "whole"}
    empty = {name for name, x in values.items() if x is None or (isinstance(x, float | tuple) and not x)}
    return frozenset(values) - empty


# Function from the index of a log to the drive torque along this log, ``(N, nv)`` at the full rate.
LogTorque = Callable[[int], Float[Array, "N nv"]]

# PyYAML's loader in C is ten times as fast, but some installations do not have it.
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_MOST_STEPS = 20000
"""Largest number of samples of one recording at which a law that is computed step by step is evaluated. Between them
the torque is interpolated."""


def torque_of_model(
    replay: Replay,
    robot: Robot,
    effects: tuple[KnownEffect, ...] = (),
    further_torque: Callable[[Motion], Float[Array, "N nv"]] | None = None,
) -> LogTorque:
    """Drive torque of a robot with effects, by the laws of the catalogue.

    Args:
        replay: The recordings.
        robot: The model.
        effects: Effects that are added to the model.
        further_torque: Function from the motion to a drive torque that is added.
    """
    robot = replace(robot, soft_friction=replay.robot.soft_friction)

    def along_log(log: int) -> Array:
        loaded_robot = replay.robot_in(robot, log)
        operation = operation_of(loaded_robot, replay.logs[log], (), log, replay.cutoff_hz)
        if further_torque is not None:
            tau = operation.tau + further_torque(operation)
            operation = replace(operation, tau=tau, expected=tau)
        return with_known(loaded_robot, operation, effects).tau if effects else operation.tau

    return along_log


def torque_of_urdf(
    replay: Replay, text: str, corrected: CorrectedModel, config: Path | None, effects: tuple[KnownEffect, ...]
) -> LogTorque:
    """Drive torque of a URDF; rotors, loops and gravity, which a URDF cannot state, are those of the given model.

    Args:
        replay: The recordings.
        text: Text of the URDF.
        corrected: The model from which the URDF was built.
        config: The robot's ``robot.yaml``.
        effects: The findings that the URDF contains. Torque limits are applied by their own law.
    """
    robot = robot_with_urdf(text, robot_of_urdf(corrected), config)
    return torque_of_model(replay, robot, drive_effects(corrected, effects))


def torque_of_mjcf(replay: Replay, corrected: CorrectedModel, effects: tuple[KnownEffect, ...]) -> LogTorque:
    """Drive torque of an MJCF, computed from the corrected model, with which its torques were compared in MuJoCo.

    Args:
        replay: The recordings.
        corrected: The model from which the MJCF was built.
        effects: The findings that the MJCF contains. Those on drives and transmissions are applied by their own laws.
    """
    robot = with_zeros_moved(corrected.robot, zeros_in_file(corrected))
    return torque_of_model(
        replay, robot, drive_effects(corrected, effects), lambda motion: added_torque(corrected, motion)
    )


def drive_effects(corrected: CorrectedModel, effects: tuple[KnownEffect, ...]) -> tuple[KnownEffect, ...]:
    """Effects that act on the command of the drive, or between drive and link.

    Args:
        corrected: The model.
        effects: The effects to choose from.
    """
    return tuple(one for one in effects if used_numbers(numbers_of_effect(corrected.given, one)) & DRIVE_NUMBERS)


def torque_of_yaml(replay: Replay, text: str, robot: Robot, known: tuple[KnownEffect, ...]) -> LogTorque:
    """Drive torque of the given model with the effects and changes within tolerance of a ``corrected.yaml``.

    Args:
        replay: The recordings.
        text: Text of the file.
        robot: The given model.
        known: Effects that the given model already contains.
    """
    with unnamed_file(text.encode(), suffix=".yaml") as path:
        found = known_effects((path,), with_known_payloads(robot, known))
        adjusted = robot_within_tolerances(robot, read_corrected(path).adjusted)
    return torque_of_model(replay, adjusted, (*known, *effects_on_torques(found)))


def torque_of_randomisation(replay: Replay, text: str, robot: Robot, known: tuple[KnownEffect, ...]) -> LogTorque:
    """Drive torque of the robot with the central values (those found) of a ``randomisation.yaml``.

    Args:
        replay: The recordings.
        text: Text of the file.
        robot: The given model.
        known: Effects that the given model already contains.
    """
    values: dict[tuple[str, str | None], list[float]] = {}
    content = yaml.load(text, Loader=_LOADER)
    for entry in content["found"]:
        values.setdefault((entry["effect"], entry["joint"]), []).append(float(entry["value"]))
    found = tuple(KnownEffect(effect, joint, tuple(theta)) for (effect, joint), theta in values.items())
    adjusted = tuple(Adjusted(one["quantity"], one["change"], 0.0) for one in content["adjusted"])
    return torque_of_model(replay, robot_within_tolerances(robot, adjusted), (*known, *found))


def torque_of_feedforward(replay: Replay, code: str, robot: Robot) -> LogTorque:
    """Drive torque of a ``feedforward.py``, which is called with the motion after the drive's delay.

    - The torque of the file is not limited, as clipping noise on one side would cause a bias. Instead, the part of the
      recorded command beyond the drive's limit, which had no effect, is added.
    - Known loads of single recordings and measured external forces, which are not in the file, are added.

    Args:
        replay: The recordings.
        code: Text of the file.
        robot: The given model.
    """
    law = over_samples(code)
    leads, limits = np.array(law["LEAD"]), np.array(law["LIMITS"])

    def along_log(log: int) -> Array:
        motion = motion_of(replay.logs[log])
        out = np.empty_like(motion.v)
        for lead in np.unique(leads):
            ahead = [_advanced(motion.t, x, float(lead)) for x in (motion.q, motion.v, motion.a)]
            torque = law["_needed"](*([read_only(row) for row in x.T] for x in ahead))
            for j in np.flatnonzero(leads == lead):
                out[:, j] = torque[j]
        logged, external = replay.logs[log].tau, replay.logs[log].external
        out += logged - np.clip(logged, -limits, limits)
        out = out if external is None else out - external
        carrying = replay.robot_in(robot, log)
        return out if carrying is robot else out + inverse_dynamics(carrying, motion) - inverse_dynamics(robot, motion)

    return along_log


def _advanced(t: Float[Array, " N"], x: Float[Array, "N nv"], seconds: float) -> Float[Array, "N nv"]:
    """A series shifted to earlier times by ``seconds``; at the end its last value is held."""
    return x if seconds == 0 else interpolated(t + seconds, t, x)


def torque_of_actuators(
    replay: Replay, code: str, corrected: CorrectedModel, effects: tuple[KnownEffect, ...]
) -> LogTorque:
    """Drive torque of the corrected model's links with the actuators of an ``isaac_lab.py``.

    Args:
        replay: The recordings.
        code: Text of the file.
        corrected: The corrected model with its links.
        effects: The findings that the file contains. Delays and limits are applied by their own laws.
    """
    robot = with_actuators(corrected, loaded(code, ISAAC)["JOINTS"])
    return torque_of_model(replay, robot, drive_effects(corrected, effects))


def with_actuators(corrected: CorrectedModel, joints: Mapping[str, Mapping[str, float]]) -> Robot:
    """A corrected model with other friction and rotors, stated by joint under Isaac Lab's names.

    Args:
        corrected: The corrected model.
        joints: Numbers of each joint.
    """
    robot = with_zeros_moved(corrected.robot, zeros_in_file(corrected))
    for row, joint in enumerate(robot.joint_names):
        stated = joints.get(joint, {})
        robot = with_friction(
            robot,
            joint,
            viscous=stated.get("viscous_friction", 0.0) - float(robot.viscous_friction[row]),
            coulomb=stated.get("dynamic_friction", 0.0) - float(robot.coulomb_friction[row]),
        )
        robot = with_rotor_inertia(robot, joint, stated.get("armature", 0.0) - float(robot.rotor_inertia[row]))
    return robot


def torque_of_residual(replay: Replay, code: str, model: LogTorque, robot: Robot) -> LogTorque:
    """Drive torque of a model together with a ``residual.py`` on one joint.

    Args:
        replay: The recordings.
        code: Text of the file.
        model: Drive torque of the corrected model without the residual.
        robot: The model from which the inputs of the law are computed.
    """
    names = loaded(code, RESIDUAL)
    row = robot.joint_names.index(names["JOINT"])

    def along_log(log: int) -> Array:
        operation = operation_of(robot, replay.logs[log], (), log, replay.cutoff_hz)
        out = np.array(model(log))
        out[:, row] -= _law_torque(names["Residual"](), replay.logs[log], operation, robot, row)
        return out

    return along_log


def _law_torque(law: Any, log: Log, operation: Operation, robot: Robot, row: int) -> Float[Array, " N"]:
    """Torque of a law that is computed step by step; interpolated if a log has more than ``_MOST_STEPS`` samples."""
    from identification.diagnosis.law.joint_residual import (
        inputs_of,  # imported here because it loads all laws of residuals, which few runs need
    )

    inputs = inputs_of(robot, log, operation, row, [k for k in range(robot.nv) if k != row])
    every = max(math.ceil(len(inputs["t"]) / _MOST_STEPS), 1)
    few = {name: series[::every] for name, series in inputs.items()}
    return np.interp(inputs["t"], few["t"], law.along(few))
