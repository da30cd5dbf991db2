"""The effects, from their equations: how each is drawn, what it does to the plant, and the torque it adds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.generator.plant import JointFriction, Plant, bare_plant, rigid_torque, with_point_mass
from benchmarks.blind.generator.robots import Table, scaled_link

SINGLE_EFFECTS = (
    "viscous_friction",
    "coulomb_friction",
    "direction_dependent_friction",
    "stribeck_friction",
    "torque_offset",
    "rotor_inertia",
    "payload",
    "inertial_parameters",
    "torque_constant",
    "parasitic_spring",
)
FRICTION = SINGLE_EFFECTS[:4]
INERTIAL = ("rotor_inertia", "payload", "inertial_parameters")


@dataclass(frozen=True)
class Recipe:
    """An effect whose one magnitude is still open; the other numbers are drawn."""

    effect: str
    joint: int
    shape: Mapping[str, float]


@dataclass(frozen=True)
class Effect:
    """An effect with its parameters, named and signed as in the contract's table; ``joint`` is an index."""

    effect: str
    joint: int
    parameters: Mapping[str, float]


def draw_recipe(rng: np.random.Generator, effect: str, table: Table) -> Recipe:
    """Joint and shape of an effect; the joint is one whose torque the effect can reach."""
    nv = len(table.links)
    joint, sign = int(rng.integers(nv)), float(rng.choice((-1.0, 1.0)))
    shape: dict[str, float] = {}
    if effect == "direction_dependent_friction":
        level = sign * rng.uniform(0.2, 0.7)
        viscous = float(rng.choice((0.0, 1.0), p=(0.25, 0.75)))
        shape = {
            "positive": 1.0 + level,
            "negative": 1.0 - level,
            "c_positive": viscous * rng.uniform(0.1, 0.9),
            "c_negative": viscous * rng.uniform(0.1, 0.9),
        }
    elif effect == "stribeck_friction":
        shape = {"coulomb": rng.uniform(0.3, 0.65), "speed": float(np.exp(rng.uniform(np.log(0.05), np.log(0.3))))}
    elif effect in ("torque_offset", "torque_constant"):
        shape = {"sign": sign}
    elif effect == "parasitic_spring":
        shape = {"rest": rng.uniform(-0.5, 0.5)}
    elif effect == "payload":
        joint = nv - 1
        tip = 2.0 * np.asarray(table.links[-1].center) * rng.uniform(0.6, 1.1) + rng.uniform(-0.04, 0.04, size=3)
        shape = {f"center_{axis}": float(x) for axis, x in zip("xyz", tip, strict=True)}
    elif effect == "inertial_parameters":
        # Of a link behind a vertical first joint only one moment is visible; the others carry gravity too.
        joint = int(rng.integers(1, nv)) if abs(table.links[0].axis[2]) > 0.5 else joint
        pull = rng.uniform(0.3, 1.0, size=3)
        shape = {
            name: float(sign * x) for name, x in zip(("mass", "center", "inertia"), pull / pull.max(), strict=True)
        }
    return Recipe(effect, joint, shape)


def realised(recipe: Recipe, m: float) -> Effect:
    """The effect at magnitude ``m`` > 0 (a torque, a coefficient, a mass or a relative change)."""
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
        "torque_offset": lambda: {"torque": s["sign"] * m},
        "rotor_inertia": lambda: {"inertia": m},
        "payload": lambda: {"mass": m, **s},
        "inertial_parameters": lambda: {f"{name}_factor": 1.0 + m * x for name, x in s.items()},
        "torque_constant": lambda: {"ratio": 1.0 + s["sign"] * m},
        "parasitic_spring": lambda: {"stiffness": m, "rest_position": s["rest"]},
    }
    return Effect(recipe.effect, recipe.joint, build[recipe.effect]())


def largest_magnitude(recipe: Recipe) -> float:
    """Beyond this the machine is no longer the same robot, or not physical."""
    if recipe.effect == "torque_constant":
        return 0.5
    if recipe.effect == "inertial_parameters":
        return 0.6 if recipe.shape["mass"] < 0 else 1.5
    return np.inf


def _at(values: tuple, joint: int, value) -> tuple:
    return (*values[:joint], value, *values[joint + 1 :])


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
    return JointFriction(
        p["coulomb_torque"],
        p["coulomb_torque"],
        extra=p["static_torque"] - p["coulomb_torque"],
        speed=p["stribeck_velocity"],
    )


def changed_table(effect: Effect, table: Table) -> Table:
    """The links after an effect on inertias; the table itself for every other effect."""
    p, link = effect.parameters, table.links[effect.joint]
    if effect.effect == "rotor_inertia":
        link = replace(link, rotor_inertia=link.rotor_inertia + p["inertia"])
    elif effect.effect == "payload":
        link = with_point_mass(link, p["mass"], np.array([p["center_x"], p["center_y"], p["center_z"]]))
    elif effect.effect == "inertial_parameters":
        link = scaled_link(link, p["mass_factor"], p["center_factor"], p["inertia_factor"])
    return Table(table.name, _at(table.links, effect.joint, link))


def plant_with(effect: Effect | None, table: Table) -> Plant:
    """The true machine with the effect in it; None is the machine without one."""
    if effect is None:
        return bare_plant(table)
    plant, j, p = bare_plant(changed_table(effect, table)), effect.joint, effect.parameters
    if effect.effect in FRICTION:
        return replace(plant, friction=_at(plant.friction, j, joint_friction(effect)))
    if effect.effect == "torque_offset":
        return replace(plant, offset=_at(plant.offset, j, p["torque"]))
    if effect.effect == "torque_constant":
        return replace(plant, ratio=_at(plant.ratio, j, p["ratio"]))
    if effect.effect == "parasitic_spring":
        return replace(
            plant,
            stiffness=_at(plant.stiffness, j, p["stiffness"]),
            rest=_at(plant.rest, j, p["rest_position"]),
        )
    return plant


def needed_torque(
    effect: Effect, table: Table, q: np.ndarray, v: np.ndarray, a: np.ndarray, tau: np.ndarray
) -> np.ndarray:
    """Logged torque that the motion needs more because of the effect, ``(N, nv)`` [N m].

    Args:
        effect: What the model lacks.
        table: True links without the effect.
        q: Motion, ``(N, nv)``.
        v: Its velocity.
        a: Its acceleration.
        tau: Logged torque of the same motion without the effect.
    """
    p, j, out = effect.parameters, effect.joint, np.zeros_like(q)
    sign = np.tanh(v[:, j] / 1e-3)
    if effect.effect in FRICTION:
        law = joint_friction(effect)
        up, down = law.positive + law.c_positive * v[:, j], -law.negative + law.c_negative * v[:, j]
        # A blend over a millirad per second stands for the step at zero: only the size is set with it.
        out[:, j] = 0.5 * (1.0 + sign) * up + 0.5 * (1.0 - sign) * down
        out[:, j] += law.extra * np.exp(-((v[:, j] / law.speed) ** 2)) * sign
    elif effect.effect == "torque_offset":
        out[:, j] = -p["torque"]
    elif effect.effect == "parasitic_spring":
        out[:, j] = p["stiffness"] * (q[:, j] - p["rest_position"])
    elif effect.effect == "torque_constant":
        out[:, j] = tau[:, j] / p["ratio"] - tau[:, j]
    else:
        out = rigid_torque(changed_table(effect, table), q, v, a) - rigid_torque(table, q, v, a)
    return out
