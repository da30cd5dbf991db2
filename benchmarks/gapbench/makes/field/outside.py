"""Causes that no catalogue holds: what happens to robots between two looks at them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from .effects import Effect, Rng
from .plant import put
from .robots import Robot
from .simulate import STEP
from .world import Scale, World, with_body

Array = np.ndarray


def _windows(scale: Scale, count: int, longest: float, rng: Rng) -> Array:
    """Zero outside of some stretches of time, one inside, with edges of 20 ms; shape ``(K,)``."""
    steps = round(scale.seconds / STEP)
    out, t = np.zeros(steps), np.arange(steps) * STEP
    for middle in np.linspace(0.1, 0.9, count) * scale.seconds + rng.uniform(-0.3, 0.3, count):
        out[np.abs(t - middle) < 0.5 * longest * rng.uniform(0.5, 1.0)] = rng.choice((-1.0, 1.0))
    return gaussian_filter1d(out, 0.02 / STEP)


def push(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    """Somebody leans on the arm a few times: the joint and, less, those before it."""
    when, share = _windows(scale, int(rng.integers(2, 6)), 1.0, rng), np.zeros(len(robot.names))
    share[j] = scale.torque[j]
    share[:j] = 0.4 * scale.torque[:j] * rng.uniform(-1.0, 1.0, j)
    return Effect(
        "push",
        robot.names[j],
        lambda world, s: replace(world, pushed=world.pushed + s * when[:, None] * share),
        lambda s: {"torque": s * scale.torque[j]},
        0.3,
    )


def contact(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    """An elastic stop at the end of the way."""
    side = float(rng.choice((-1.0, 1.0)))
    where, unit = scale.middle[j] + side * rng.uniform(0.4, 0.7) * scale.reach[j], scale.torque[j] / scale.reach[j]

    def kept(world: World, s: float) -> World:
        return replace(world, plant=put(world.plant, j, wall=s * unit, wall_at=where, wall_side=side))

    return Effect("contact", robot.names[j], kept, lambda s: {"stiffness": s * unit, "from": where}, 1.0)


def cable_drag(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    """A cable that rubs the more the farther the joint turns one way."""
    where, unit = scale.middle[j] + rng.uniform(-0.4, 0.2) * scale.reach[j], scale.torque[j] / scale.reach[j]

    def kept(world: World, s: float) -> World:
        return replace(world, plant=put(world.plant, j, drag=s * unit, drag_at=where))

    return Effect("cable_drag", robot.names[j], kept, lambda s: {"slope": s * unit, "from": where}, 0.2)


def warm_up(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    """Dry friction that is higher while the drive is cold, and lower than modelled in the end."""
    tau = scale.seconds * rng.uniform(0.2, 0.4)
    mean = tau / scale.seconds * (1.0 - np.exp(-scale.seconds / tau))

    def kept(world: World, s: float) -> World:
        level = s * scale.torque[j]
        plant = put(world.plant, j, warm=level)
        plant = plant._replace(warm_time=np.array([tau]))
        low = {side: max(getattr(plant, side)[j] - mean * level, 0.0) for side in ("forth", "back")}
        return replace(world, plant=put(plant, j, **low))

    most = robot.true_coulomb[j] / max(mean * scale.torque[j], 1e-9)
    return Effect("warm_up", robot.names[j], kept, lambda s: {"torque": s * scale.torque[j]}, 0.1, most)


def voltage_sag(_robot: Robot, _scale: Scale, _j: int, _: Rng) -> Effect:
    """A weak supply: all drives lose torque while all work hard, and gain some while they rest."""
    return Effect(
        "voltage_sag",
        None,
        lambda world, s: replace(world, plant=world.plant._replace(sag=np.array([s]))),
        lambda s: {"share": s},
        0.1,
        0.6,
    )


def carried_load(robot: Robot, scale: Scale, _j: int, rng: Rng) -> Effect:
    """A load that is picked up and put down in mid-recording."""
    last, steps = len(robot.names) - 1, round(scale.seconds / STEP)
    heavy = robot.given.mass[last]
    center = robot.given.center[last] + 0.4 * np.array(robot.kind.joints[last].size) * rng.uniform(-1.0, 1.0, 3)
    share = np.arange(steps) / steps
    edges = np.sort(rng.uniform(0.1, 0.9, 4)) if rng.random() < 0.5 else np.array([*rng.uniform(0.25, 0.6, 1), 0.85])
    held = sum(((share > a) & (share < b)) for a, b in zip(edges[::2], edges[1::2], strict=True)) > 0

    def kept(world: World, s: float) -> World:
        load = with_body(world.chain, last, s * heavy, center, s * heavy * 0.4 * 0.03**2 * np.eye(3))
        return replace(world, loaded=load, held=held)

    return Effect("carried_load", None, kept, lambda s: {"mass": s * heavy}, 0.4, 6.0)


def torque_ripple(robot: Robot, scale: Scale, j: int, rng: Rng) -> Effect:
    """A drive whose torque constant goes up and down with the angle."""
    order = float(np.ceil(10.0 * np.pi / scale.reach[j])) + float(rng.integers(0, 5))

    def kept(world: World, s: float) -> World:
        return replace(world, plant=put(world.plant, j, ripple=s, ripple_order=order))

    return Effect("torque_ripple", robot.names[j], kept, lambda s: {"share": s, "order": order}, 0.1, 0.6)


CAUSES: tuple[Callable[[Robot, Scale, int, Rng], Effect], ...] = (
    push,
    contact,
    cable_drag,
    warm_up,
    voltage_sag,
    carried_load,
    torque_ripple,
)
