"""The effects of the catalogue, from their equations: what each does to the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .plant import Channel, Coupling, Encoder, JointFriction, Plant, with_point_mass
from .robots import Table, scaled_link

SINGLE_EFFECTS = (
    "viscous_friction",
    "coulomb_friction",
    "direction_dependent_friction",
    "stribeck_friction",
    "presliding_friction",
    "load_dependent_friction",
    "backlash",
    "transmission_compliance",
    "joint_coupling",
    "cogging",
    "torque_saturation",
    "torque_constant",
    "torque_offset",
    "input_delay",
    "actuator_lag",
    "rotor_inertia",
    "payload",
    "inertial_parameters",
    "base_tilt",
    "parasitic_spring",
    "encoder_offset",
    "encoder_eccentricity",
    "encoder_quantization",
)
LEVELS = ("viscous_friction", "coulomb_friction", "direction_dependent_friction", "stribeck_friction")
WHOLE = -1  # in place of a joint: the whole robot


@dataclass(frozen=True)
class Effect:
    """An effect with its parameters, named and signed as in the contract's table.

    Attributes:
        effect: Name.
        joint: Index of the link whose joint it is; `WHOLE` for all.
        parameters: By the contract's names; of a cogging its one wave.
        second: Index of the other link of a coupling.
    """

    effect: str
    joint: int
    parameters: Mapping[str, float]
    second: int = WHOLE


def joint_name(effect: Effect, table: Table) -> str | None:
    """The joint as the contract writes it."""
    if effect.joint == WHOLE or effect.effect == "payload":
        return None
    name = table.links[effect.joint].joint
    return f"{name}+{table.links[effect.second].joint}" if effect.second != WHOLE else name


def stated_parameters(effect: Effect) -> dict:
    """The parameters as the contract states them: those of a cogging are lists."""
    plain = {name: float(value) for name, value in effect.parameters.items()}
    return {name: [value] for name, value in plain.items()} if effect.effect == "cogging" else plain


def joint_friction(effect: Effect) -> JointFriction:
    """A friction effect in the one form that the simulation knows."""
    p = effect.parameters
    if effect.effect == "viscous_friction":
        return JointFriction(c_positive=p["coefficient"], c_negative=p["coefficient"])
    if effect.effect == "coulomb_friction":
        return JointFriction(p["torque"], p["torque"])
    if effect.effect == "direction_dependent_friction":
        return JointFriction(
            p["torque_positive"], p["torque_negative"], p["coefficient_positive"], p["coefficient_negative"]
        )
    level = p["coulomb_torque"]
    return JointFriction(level, level, extra=p["static_torque"] - level, speed=p["stribeck_velocity"])


def both(one: JointFriction | None, other: JointFriction) -> JointFriction:
    """Two frictions of one joint as one; at most one of them may fade with speed."""
    if one is None:
        return other
    fading = one if one.extra else other
    return JointFriction(
        one.positive + other.positive,
        one.negative + other.negative,
        one.c_positive + other.c_positive,
        one.c_negative + other.c_negative,
        fading.extra,
        fading.speed,
    )


def tilted(gravity: Sequence[float], turn: Sequence[float]) -> tuple[float, ...]:
    """Gravity turned about an axis by that axis' length [rad], by Rodrigues' formula."""
    down, angle = np.asarray(gravity, dtype=float), float(np.linalg.norm(turn))
    axis = np.asarray(turn, dtype=float) / max(angle, 1e-300)
    along = axis * (axis @ down)
    return tuple(float(x) for x in along + np.cos(angle) * (down - along) + np.sin(angle) * np.cross(axis, down))


def changed_table(effect: Effect, table: Table) -> Table:
    """The robot after an effect on inertias or gravity; the table itself for every other effect."""
    p, j = effect.parameters, effect.joint
    if effect.effect == "base_tilt":
        return replace(table, gravity=tilted(table.gravity, [p.get(name, 0.0) for name in ("roll", "pitch", "yaw")]))
    if effect.effect == "rotor_inertia":
        link = table.links[j]
        return table.with_link(j, replace(link, rotor_inertia=link.rotor_inertia + p["inertia"]))
    if effect.effect == "payload":
        place = np.array([p["center_x"], p["center_y"], p["center_z"]])
        return table.with_link(j, with_point_mass(table.links[j], p["mass"], place))
    if effect.effect == "inertial_parameters":
        factors = (p["mass_factor"], p["center_factor"], p["inertia_factor"])
        return table.with_link(j, scaled_link(table.links[j], *factors))
    return table


def _channels(plant: Plant, effect: Effect) -> Plant:
    """Delay, lag, saturation and torque constant, on one drive or on all."""
    p, name = effect.parameters, effect.effect
    change = {
        "input_delay": lambda: {"delay": p["delay"]},
        "actuator_lag": lambda: {"lag": p["time_constant"]},
        "torque_saturation": lambda: {"limit": p["limit"]},
        "torque_constant": lambda: {"ratio": p["ratio"]},
    }[name]()
    where = plant.table.active if effect.joint == WHOLE else (effect.joint,)
    return replace(
        plant,
        channels={**plant.channels, **{i: replace(plant.channels.get(i, Channel()), **change) for i in where}},
    )


def _encoder(plant: Plant, effect: Effect) -> Plant:
    p, j = effect.parameters, effect.joint
    change = {
        "encoder_offset": lambda: {"offset": p["offset"]},
        "encoder_eccentricity": lambda: {"amplitude": p["amplitude"], "phase": p["phase"], "order": p["order"]},
        "encoder_quantization": lambda: {"step": p["step"]},
    }[effect.effect]()
    return replace(plant, encoders={**plant.encoders, j: replace(plant.encoders.get(j, Encoder()), **change)})


def with_effect(plant: Plant, effect: Effect) -> Plant:
    """The machine with one more effect in it."""
    name, p, j = effect.effect, effect.parameters, effect.joint
    plant = replace(plant, table=changed_table(effect, plant.table))
    if name in LEVELS:
        return replace(plant, friction={**plant.friction, j: both(plant.friction.get(j), joint_friction(effect))})
    if name in ("input_delay", "actuator_lag", "torque_saturation", "torque_constant"):
        return _channels(plant, effect)
    if name.startswith("encoder_"):
        return _encoder(plant, effect)
    if name == "joint_coupling":
        numbers = (p["ratio"], p["coulomb_torque"], p["coefficient"], p["inertia"])
        return replace(plant, couplings=(*plant.couplings, Coupling(j, effect.second, *numbers)))
    if name == "torque_offset":
        return replace(plant, offset={**plant.offset, j: p["torque"]})
    if name == "parasitic_spring":
        return replace(plant, springs={**plant.springs, j: (p["stiffness"], p["rest_position"])})
    if name == "presliding_friction":
        return replace(plant, bristles={**plant.bristles, j: (p["torque"], p["displacement"])})
    if name == "load_dependent_friction":
        return replace(plant, load_ratio={**plant.load_ratio, j: p["ratio"]})
    if name == "backlash":
        return replace(plant, gaps={**plant.gaps, j: p["gap"]})
    if name == "transmission_compliance":
        return replace(plant, compliance={**plant.compliance, j: p["stiffness"]})
    if name == "cogging":
        return replace(plant, cogging={**plant.cogging, j: (p["order"], p["amplitude"], p["phase"])})
    return plant


def plant_with(effects: Sequence[Effect], table: Table) -> Plant:
    """The true machine with all effects in it."""
    plant = Plant(table)
    for effect in effects:
        plant = with_effect(plant, effect)
    return plant
