# pyright: reportAttributeAccessIssue=false
"""Laws that MuJoCo does not have: evaluated at every law step, they set friction levels and add torques."""

from __future__ import annotations

from collections.abc import Callable
from math import exp, sin

import mujoco
import numpy as np

from .plant import JointFriction, Plant

# (data, friction levels to add to, torques to add to, damping to set) at a time [s]
Law = Callable[[mujoco.MjData, float, np.ndarray, np.ndarray, np.ndarray], None]


def _speed_friction(plant: Plant, i: int, law: JointFriction) -> Law:
    d, viscous = plant.drive(i), plant.table.links[i].viscous

    def act(data, t, level, torque, damping) -> None:
        v = float(data.qvel[d])
        level[d] += law.extra * exp(-min((v / law.speed) ** 2, 700.0))
        damping[d] = viscous + (law.c_positive if v > 0 else law.c_negative)

    return act


def _dahl(plant: Plant, i: int, level_torque: float, displacement: float, start: float) -> Law:
    """dF/dx = (torque/displacement) (1 - F sign(dx)/torque), solved over each displacement; -F acts on the joint."""
    d, state = plant.drive(i), [0.0, start]

    def act(data, t, level, torque, damping) -> None:
        q = float(data.qpos[d])
        moved = q - state[1]
        goal = level_torque if moved > 0 else -level_torque
        state[0] = goal + (state[0] - goal) * exp(-abs(moved) / displacement)
        state[1] = q
        torque[d] -= state[0]

    return act


def _load(plant: Plant, i: int, ratio: float) -> Law:
    """Friction level ratio |tl|: what passes the joint is all torque on it less what its rotor takes."""
    d, rotor = plant.drive(i), plant.table.links[i].rotor_inertia

    def act(data, t, level, torque, damping) -> None:
        own = float(data.qfrc_applied[d] + data.qfrc_passive[d] + data.qfrc_constraint[d])
        level[d] += ratio * abs(own - rotor * float(data.qacc[d]))

    return act


def _cogging(plant: Plant, i: int, order: float, amplitude: float, phase: float) -> Law:
    d = plant.drive(i)

    def act(data, t, level, torque, damping) -> None:
        torque[d] += amplitude * sin(order * float(data.qpos[d]) + phase)

    return act


def _outside(plant: Plant) -> Law | None:
    cause = plant.outside
    if cause is None or cause.name == "voltage_sag":
        return None
    p, i = cause.parameters, cause.joint
    d = plant.drive(i)

    def warm_up(data, t, level, torque, damping) -> None:
        level[d] += p["torque"] * (exp(-t / p["time_constant"]) - p["settled"])

    def shaker(data, t, level, torque, damping) -> None:
        torque[d] += p["amplitude"] * sin(2.0 * np.pi * p["frequency"] * t + p["phase"])

    def contact(data, t, level, torque, damping) -> None:
        side = p["side"]
        depth = side * (float(data.qpos[i]) - p["position"])
        if depth > 0.0:
            force = p["stiffness"] * depth + p["damping"] * side * float(data.qvel[i])
            torque[i] -= side * max(force, 0.0)

    def drift(data, t, level, torque, damping) -> None:
        torque[d] += p["torque"] * (2.0 * t / p["duration"] - 1.0)

    known = {"friction_warm_up": warm_up, "shaker": shaker, "soft_contact": contact, "drifting_offset": drift}
    return known[cause.name]


def laws_of(plant: Plant, start: np.ndarray) -> list[Law]:
    """All laws of the machine with their own state; ``start`` are the active joints at the beginning."""
    place = dict(zip(plant.table.active, start, strict=True))
    laws = [
        _speed_friction(plant, i, law)
        for i, law in plant.friction.items()
        if law.extra != 0.0 or law.c_positive != law.c_negative
    ]
    laws += [_dahl(plant, i, *numbers, float(place[i])) for i, numbers in plant.bristles.items()]
    laws += [_load(plant, i, ratio) for i, ratio in plant.load_ratio.items()]
    laws += [_cogging(plant, i, *wave) for i, wave in plant.cogging.items()]
    outside = _outside(plant)
    return [*laws, outside] if outside else laws
