"""What was found, in the numbers that simulators have places for, by kind and joint; and which simulator holds which.

One list says what each simulator can hold; what it cannot say is the rest of the same list.
"""

from __future__ import annotations

from dataclasses import dataclass

from identification.export.corrected.corrected_mjcf import zeros_in_file
from identification.export.corrected.corrected_model import CorrectedModel, torque_limits
from phantom_dyn.effects.catalogue import effect_named


@dataclass(frozen=True)
class Simulator:
    """One simulator.

    Attributes:
        name: For readers.
        fields: Its own name of each kind of number that it can hold; kinds are those of `numbers_of`.
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
    """Numbers of the corrected model by kind and active joint, SI units on the joint side; kinds without any are empty.

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


def cannot_say(corrected: CorrectedModel, simulator: Simulator) -> tuple[str, ...]:
    """A sentence on each number of the corrected model that a simulator has no place for.

    Args:
        corrected: The corrected model.
        simulator: Which one.
    """
    out = []
    for kind, values in numbers_of(corrected).items():
        there = {joint: value for joint, value in values.items() if value}
        if there and kind not in simulator.fields:
            told = ", ".join(f"{joint} {value:.4g}" for joint, value in there.items())
            out.append(f"{simulator.name} has no place for {kind}: {told}.")
    for effect in corrected.others:
        words = effect_named(effect.effect, corrected.given).words
        kept = f"it has, {words.kept}" if words.kept else "it is left out"
        out.append(f"{simulator.name} has no place for {words.lost or words.name} of {effect.joint}: {kept}.")
    return tuple(out)


def fields_of(corrected: CorrectedModel, simulator: Simulator) -> dict[str, dict[str, float]]:
    """Numbers by joint under a simulator's own names.

    Args:
        corrected: The corrected model.
        simulator: Which one.
    """
    numbers = numbers_of(corrected)
    out: dict[str, dict[str, float]] = {joint: {} for joint in corrected.robot.joint_names}
    for kind, name in simulator.fields.items():
        for joint, value in numbers[kind].items():
            out[joint][name] = float(value)
    return {joint: values for joint, values in out.items() if values}
