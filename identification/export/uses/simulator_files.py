"""``isaac_lab.py`` and ``simulators.yaml``: joints of the corrected model in the words of simulators.

Isaac Lab's fields are those of ``ActuatorBaseCfg`` and ``DelayedPDActuatorCfg``: ``friction`` is the static effort,
``dynamic_friction`` the one in motion, delays are whole physics steps of a group, so that every joint is a group.
SDF has ``<axis><dynamics>`` with damping, friction and a spring, and ``<limit><effort>``; Drake's URDF reads
``damping``, ``effort``, ``drake:rotor_inertia`` and ``drake:gear_ratio``, and leaves joint friction out; ros2_control
knows limits alone.
"""

from __future__ import annotations

import textwrap

import yaml

from identification.export.corrected.corrected_model import CorrectedModel
from identification.export.uses.simulator_numbers import (
    DRAKE,
    GAZEBO,
    ISAAC_LAB,
    ROS2_CONTROL,
    cannot_say,
    fields_of,
)

_CODE = '''

JOINTS = {joints}
"""By joint, SI units on the joint side; delays in seconds, that of the torque and that of the references."""


def actuators(physics_step, stiffness, damping):
    """Actuator groups by name, for `ArticulationCfg.actuators`: one a joint, as a group has one delay.

    Args:
        physics_step: Of the simulation [s]; delays are rounded to whole steps.
        stiffness: Gain of the position controller, a number or one by joint.
        damping: Gain of its velocity, likewise.
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
        name: Of the robot.
    """
    lines = [
        f"Actuators of {_plain(name)} for Isaac Lab, as phantom-dyn found them.",
        "",
        "Import corrected.urdf or corrected.xml for the links, and give actuators(...) to its ArticulationCfg. The "
        "fields are those of Isaac Lab 2.3 and later with Isaac Sim 5; version 3 calls effort_limit "
        "actuator_effort_limit and takes both. The delay is that of the command, as DelayedPDActuatorCfg has it: "
        "so is a reference_delay, while a delay was found to be that of the torque. It was not loaded in Isaac Lab.",
    ]
    lines += ["", "What it cannot say:", *cannot_say(corrected, ISAAC_LAB)] if cannot_say(corrected, ISAAC_LAB) else []
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
        name: Of the robot.
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
            "cannot_say": list(cannot_say(corrected, GAZEBO)),
        },
        "drake": {
            "where": "damping in <dynamics> and effort in <limit> of the joint, drake:rotor_inertia and "
            "drake:gear_ratio in <actuator> of its <transmission>",
            "joints": drake,
            "cannot_say": list(cannot_say(corrected, DRAKE)),
        },
        "ros2_control": {
            "where": "joint_limits of a controller's parameters",
            "joint_limits": limits,
            "cannot_say": list(cannot_say(corrected, ROS2_CONTROL)),
        },
    }
    head = "# The corrected model's joints in the words of simulators; SI units on the joint side. Not loaded there.\n"
    return head + yaml.safe_dump(content, sort_keys=False, width=120, allow_unicode=True)


def _plain(text: str) -> str:
    """Words that may stand in a docstring."""
    return text.replace("\\", "/").replace('"', "'")
