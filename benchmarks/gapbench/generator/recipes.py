"""How each effect is drawn: the joint, the shape, and what one magnitude makes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .effects import WHOLE, Effect
from .robots import Table

PASSIVE_SHARE = 0.35  # of Coulomb and viscous friction on a closed chain: at a passive joint
COMMON_SHARE = 0.6  # of delays and lags: the same at all joints


@dataclass(frozen=True)
class Recipe:
    """An effect whose one magnitude is still open; the other numbers are drawn."""

    effect: str
    joint: int
    shape: Mapping[str, float]
    second: int = WHOLE


def _direction(rng: np.random.Generator, sign: float) -> dict[str, float]:
    level, viscous = sign * rng.uniform(0.2, 0.7), float(rng.choice((0.0, 1.0), p=(0.25, 0.75)))
    return {
        "positive": 1.0 + level,
        "negative": 1.0 - level,
        "c_positive": viscous * rng.uniform(0.1, 0.9),
        "c_negative": viscous * rng.uniform(0.1, 0.9),
    }


def _coupling(rng: np.random.Generator) -> dict[str, float]:
    """A drive that moves two joints: mostly friction, some inertia."""
    return {
        "ratio": float(rng.choice((-1.0, 1.0))) * rng.uniform(0.5, 1.0),
        "torque": rng.uniform(0.6, 1.0),
        "coefficient": rng.uniform(0.0, 0.6),
        "inertia": rng.uniform(0.0, 0.05),
    }


def _place(rng: np.random.Generator, table: Table) -> dict[str, float]:
    """A point about as far out as the last moving link reaches."""
    center = np.asarray(table.links[payload_link(table)].center)
    aside = max(0.3 * float(np.linalg.norm(center)), 0.05 if table.name != "phantom" else 0.0)
    place = 2.0 * center * rng.uniform(0.6, 1.1) + rng.uniform(-aside, aside, size=3)
    return {f"center_{axis}": float(x) for axis, x in zip("xyz", place, strict=True)}


def payload_link(table: Table) -> int:
    """Where a payload sits: on the last moving link, of a closed chain on the forearm that carries the tip."""
    return next((i for i, link in enumerate(table.links) if link.joint == "elbow"), len(table.links) - 1)


def _changed_link(rng: np.random.Generator, sign: float) -> dict[str, float]:
    pull = rng.uniform(0.3, 1.0, size=3)
    return {n: float(sign * x) for n, x in zip(("mass", "center", "inertia"), pull / pull.max(), strict=True)}


def draw_recipe(rng: np.random.Generator, effect: str, table: Table) -> Recipe | None:
    """Joint and shape of an effect; None where this robot cannot have it."""
    joint, sign = int(rng.choice(table.active)), float(rng.choice((-1.0, 1.0)))
    passive = [i for i in range(len(table.links)) if i not in table.active]
    if effect in ("coulomb_friction", "viscous_friction") and passive and rng.random() < PASSIVE_SHARE:
        joint = int(rng.choice(passive))
    if effect == "joint_coupling":
        if len(table.active) < 2:
            return None
        first = int(rng.integers(len(table.active) - 1))
        return Recipe(effect, table.active[first], _coupling(rng), table.active[first + 1])
    if effect in ("input_delay", "actuator_lag"):
        common = len(table.active) == 1 or rng.random() < COMMON_SHARE
        return Recipe(effect, WHOLE if common else joint, {})
    if effect == "base_tilt":
        angle = rng.uniform(0.0, 2.0 * np.pi)
        # About the two axes of the base that gravity does not point along.
        across = [name for name, g in zip(("roll", "pitch", "yaw"), table.gravity, strict=True) if g == 0.0]
        return Recipe(effect, WHOLE, dict(zip(across, (float(np.cos(angle)), float(np.sin(angle))), strict=True)))
    if effect == "payload":
        return Recipe(effect, payload_link(table), _place(rng, table))
    middle = table.posture[table.active.index(joint)] if table.posture else 0.0
    orders = np.array([4, 6, 7, 8, 10, 11, 12, 14, 18, 22, 24, 28, 36])
    shapes = {
        "direction_dependent_friction": lambda: _direction(rng, sign),
        "stribeck_friction": lambda: {
            "coulomb": rng.uniform(0.3, 0.65),
            "speed": float(np.exp(rng.uniform(np.log(0.05), np.log(0.3)))),
        },
        "presliding_friction": lambda: {"displacement": float(np.exp(rng.uniform(np.log(0.004), np.log(0.06))))},
        "joint_coupling": lambda: _coupling(rng),
        "cogging": lambda: {"order": float(rng.choice(orders)), "phase": rng.uniform(-np.pi, np.pi)},
        "torque_offset": lambda: {"sign": sign},
        "torque_constant": lambda: {"sign": sign},
        "inertial_parameters": lambda: _changed_link(rng, sign),
        "parasitic_spring": lambda: {"rest": middle + rng.uniform(-0.5, 0.5)},
        "encoder_offset": lambda: {"sign": sign},
        "encoder_eccentricity": lambda: {"phase": rng.uniform(-np.pi, np.pi)},
    }
    return Recipe(effect, joint, shapes.get(effect, dict)())


def realised(recipe: Recipe, m: float) -> Effect:
    """The effect at magnitude ``m`` > 0: a torque, a coefficient, a mass, a time, an angle or a relative change."""
    s = recipe.shape
    build = {
        "viscous_friction": lambda: {"coefficient": m},
        "coulomb_friction": lambda: {"torque": m},
        "direction_dependent_friction": lambda: {
            "torque_positive": m * s["positive"],
            "torque_negative": m * s["negative"],
            "coefficient_positive": m * s["c_positive"],
            "coefficient_negative": m * s["c_negative"],
        },
        "stribeck_friction": lambda: {
            "coulomb_torque": m * s["coulomb"],
            "static_torque": m,
            "stribeck_velocity": s["speed"],
        },
        "presliding_friction": lambda: {"torque": m, "displacement": s["displacement"]},
        "load_dependent_friction": lambda: {"ratio": m},
        "backlash": lambda: {"gap": m},
        "transmission_compliance": lambda: {"stiffness": 1.0 / m},
        "joint_coupling": lambda: {
            "ratio": s["ratio"],
            "coulomb_torque": m * s["torque"],
            "coefficient": m * s["coefficient"],
            "inertia": m * s["inertia"],
        },
        "cogging": lambda: {"order": s["order"], "amplitude": m, "phase": s["phase"]},
        "torque_saturation": lambda: {"limit": 1.0 / m},
        "torque_constant": lambda: {"ratio": 1.0 + s["sign"] * m},
        "torque_offset": lambda: {"torque": s["sign"] * m},
        "input_delay": lambda: {"delay": m},
        "actuator_lag": lambda: {"time_constant": m},
        "rotor_inertia": lambda: {"inertia": m},
        "payload": lambda: {"mass": m, **s},
        "inertial_parameters": lambda: {f"{name}_factor": 1.0 + m * x for name, x in s.items()},
        "base_tilt": lambda: {name: m * part for name, part in s.items()},
        "parasitic_spring": lambda: {"stiffness": m, "rest_position": s["rest"]},
        "encoder_offset": lambda: {"offset": s["sign"] * m},
        "encoder_eccentricity": lambda: {"amplitude": m, "phase": s["phase"], "order": 1.0},
        "encoder_quantization": lambda: {"step": m},
    }
    return Effect(recipe.effect, recipe.joint, build[recipe.effect](), recipe.second)
