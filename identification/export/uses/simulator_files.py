"""Writes ``isaac_lab.py`` and ``simulators.yaml``: joint parameters under the names that simulators use.

- Isaac Lab: fields of ``ActuatorBaseCfg`` and ``DelayedPDActuatorCfg``. ``friction`` is the static friction and
  ``dynamic_friction`` the friction in motion. A delay is a whole number of physics steps and belongs to a group of
  actuators, so every joint is a group.
- Gazebo (SDF): damping, friction and a spring in ``<axis><dynamics>``, and ``<limit><effort>``.
- Drake (URDF): ``damping``, ``effort``, ``drake:rotor_inertia`` and ``drake:gear_ratio``, but no joint friction.
- ros2_control: only limits.

`Simulator.fields` lists the parameters that each simulator can express. The files name the other ones that were found.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass

import yaml

from identification.export.corrected.corrected_mjcf import zeros_in_file
from identification.export.corrected.corrected_model import CorrectedModel, torque_limits
from phantom_dyn.effects.catalogue import effect_named

_CODE = '''

JOINTS = {joints}
"""Numbers by joint, in SI units on the joint side; delay is that of the torque, reference_delay that of references."""


def actuators(physics_step, stiffness, damping):
    """Actuator groups by name, for `ArticulationCfg.actuators`: one for each joint, as a group has one delay.

    Args:
        physics_step: Step of the simulation [s]; delays are rounded to whole steps.
        stiffness: Position gain of the controller, as one number or by joint.
        damping: Velocity gain of the controller, as one number or by joint.
    """
    import re

    from isaaclab.actuators import DelayedPDActuatorCfg

    groups = {{}}
    for joint, numbers in JOINTS.items():
        own = dict(numbers)
        steps = round((own.pop("delay", 0.0) + own.pop("reference_delay", 0.0)) / physics_step)
        groups[joint] = DelayedPDActuatorCfg(
            joint_names_expr=[re.escape(joint)],
            stiffness=stiffness[joint] if isinstance(stiffness, dict) else stiffness,
            damping=damping[joint] if isinstance(damping, dict) else damping,
            min_delay=steps,
            max_delay=steps,
            **own,
        )
    return groups
'''


def isaac_lab_text(corrected: CorrectedModel, name: str) -> str:
    """The text of ``isaac_lab.py``.

    Args:
        corrected: The corrected model.
        name: Name of the robot in the docstring of the file.
    """
    lines = [
        f"Actuators of {_plain(name)} for Isaac Lab, as phantom-dyn found them.",
        "",
        "Import corrected.urdf or corrected.xml for the links, and pass actuators(...) to its ArticulationCfg. The "
        "fields are those of Isaac Lab 2.3 and later with Isaac Sim 5; version 3 has the name actuator_effort_limit "
        "for effort_limit, and accepts both. DelayedPDActuatorCfg delays the command: this is exact for a "
        "reference_delay, but a delay was found to be that of the torque. This file was not loaded in Isaac Lab.",
    ]
    if missing := missing_sentences(corrected, ISAAC_LAB):
        lines += ["", "What it cannot say:", *missing]
    doc = "\n".join("\n".join(textwrap.wrap(_plain(line), 100)) for line in lines)
    joints = fields_of(corrected, ISAAC_LAB)
    for numbers in joints.values():
        numbers["dynamic_friction"] = numbers["friction"]
    body = ",\n".join(f"    {joint!r}: {numbers!r}" for joint, numbers in joints.items())
    return f'"""{doc}\n"""' + _CODE.format(joints=f"{{\n{body},\n}}")


def simulators_text(corrected: CorrectedModel, name: str) -> str:
    """The text of ``simulators.yaml``: one section for each of Gazebo, Drake and ros2_control.

    Args:
        corrected: The corrected model.
        name: Name of the robot.
    """
    drake = fields_of(corrected, DRAKE)
    for numbers in drake.values():
        # Rotor inertias are on the joint side, so the gear of the actuator is one.
        numbers["gear_ratio"] = 1.0
    limits = {
        joint: {"has_effort_limits": True, **numbers} for joint, numbers in fields_of(corrected, ROS2_CONTROL).items()
    }
    content = {
        "robot": name,
        "gazebo": {
            "where": "damping, friction, spring_stiffness, spring_reference in <joint><axis><dynamics>, effort in "
            "<axis><limit> of the SDF",
            "joints": fields_of(corrected, GAZEBO),
            "cannot_say": list(missing_sentences(corrected, GAZEBO)),
        },
        "drake": {
            "where": "damping in <dynamics> and effort in <limit> of the joint, drake:rotor_inertia and "
            "drake:gear_ratio in <actuator> of its <transmission>",
            "joints": drake,
            "cannot_say": list(missing_sentences(corrected, DRAKE)),
        },
        "ros2_control": {
            "where": "joint_limits of a controller's parameters",
            "joint_limits": limits,
            "cannot_say": list(missing_sentences(corrected, ROS2_CONTROL)),
        },
    }
    head = "# Joints of the corrected model, under the names of each simulator, in SI units on the joint side.\n"
    head += "# These numbers were not tried in the simulators.\n"
    return head + yaml.safe_dump(content, sort_keys=False, width=120, allow_unicode=True)


def _plain(text: str) -> str:
    """Text without characters that would end a docstring."""
    return text.replace("\\", "/").replace('"', "'")


@dataclass(frozen=True)
class Simulator:
    """The joint parameters that one simulator can express.

    Attributes:
        name: Name of the simulator in sentences.
        fields: The simulator's own name of each parameter, by the names in `numbers_of`.
    """

    name: str
    fields: dict[str, str]


ISAAC_LAB = Simulator(
    "Isaac Lab",
    {
        "rotor inertia": "armature",
        "Coulomb friction": "friction",
        "viscous friction": "viscous_friction",
        "torque limit": "effort_limit",
        "delay": "delay",
        "delay of references": "reference_delay",
    },
)
GAZEBO = Simulator(
    "Gazebo (SDF)",
    {
        "viscous friction": "damping",
        "Coulomb friction": "friction",
        "spring": "spring_stiffness",
        "spring rest": "spring_reference",
        "torque limit": "effort",
    },
)
DRAKE = Simulator(
    "Drake",
    {
        "viscous friction": "damping",
        "rotor inertia": "rotor_inertia",
        "torque limit": "effort",
    },
)
ROS2_CONTROL = Simulator("ros2_control", {"torque limit": "max_effort"})


def numbers_of(corrected: CorrectedModel) -> dict[str, dict[str, float]]:
    """Parameters of the corrected model by name and driven joint, in SI units on the joint side.

    Args:
        corrected: The corrected model.
    """
    robot = corrected.robot
    names = robot.joint_names
    return {
        "rotor inertia": dict(zip(names, map(float, robot.rotor_inertia), strict=True)),
        "viscous friction": dict(zip(names, map(float, robot.viscous_friction), strict=True)),
        "Coulomb friction": dict(zip(names, map(float, robot.coulomb_friction), strict=True)),
        "torque limit": torque_limits(corrected),
        "delay": corrected.delays,
        "delay of references": corrected.reference_delays,
        "spring": {joint: stiffness for joint, (stiffness, _) in corrected.springs.items()},
        "spring rest": {joint: rest for joint, (_, rest) in corrected.springs.items()},
        "lag": corrected.lags,
        "constant torque": corrected.offsets,
        "torque constant": corrected.gains,
        "play": corrected.plays,
        "spring of the transmission": corrected.compliances,
        "cogging": {joint: max(wave[1] for wave in waves) for joint, waves in corrected.cogging.items() if waves},
        "coupling": {f"{c.first}+{c.second}": c.ratio for c in corrected.couplings},
        "zero of an encoder": {} if zeros_in_file(corrected) else corrected.zeros,
    }


def missing_sentences(corrected: CorrectedModel, simulator: Simulator) -> tuple[str, ...]:
    """Sentences on the parameters and effects of the corrected model that a simulator cannot express.

    Args:
        corrected: The corrected model.
        simulator: The simulator.
    """
    out = []
    for kind, values in numbers_of(corrected).items():
        not_zero = {joint: value for joint, value in values.items() if value}
        if not_zero and kind not in simulator.fields:
            listed = ", ".join(f"{joint} {value:.4g}" for joint, value in not_zero.items())
            out.append(f"{simulator.name} has no place for {kind}: {listed}.")
    for effect in corrected.others:
        words = effect_named(effect.effect, corrected.given).words
        kept = f"it has, {words.kept}" if words.kept else "it is left out"
        out.append(f"{simulator.name} has no place for {words.lost or words.name} of {effect.joint}: {kept}.")
    return tuple(out)


def fields_of(corrected: CorrectedModel, simulator: Simulator) -> dict[str, dict[str, float]]:
    """Parameters of each joint under a simulator's own names.

    Args:
        corrected: The corrected model.
        simulator: The simulator.
    """
    numbers = numbers_of(corrected)
    out: dict[str, dict[str, float]] = {joint: {} for joint in corrected.robot.joint_names}
    for kind, name in simulator.fields.items():
        for joint, value in numbers[kind].items():
            out[joint][name] = float(value)
    return {joint: values for joint, values in out.items() if values}
