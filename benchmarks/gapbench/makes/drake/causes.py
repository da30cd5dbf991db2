"""Causes outside the catalogue, drawn like effects: each with one magnitude that its size is sought with."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .departures import Departures, Outside
from .effects import Effect, Place
from .measure import Ruler
from .robots import Robot


def _push(p: Place) -> dict[str, float]:
    end = float(p.ruler.base.t[-1])
    return {"begin": p.rng.uniform(0.15, 0.8) * end, "length": p.rng.uniform(0.2, 0.9), "side": p.sign}


def _contact(p: Place) -> dict[str, float]:
    low, high = p.span
    side = p.sign
    depth = p.rng.uniform(0.15, 0.35) * (high - low)
    return {"side": side, "at": high - depth if side > 0 else low + depth}


def _warm_up(p: Place) -> dict[str, float]:
    end = float(p.ruler.base.t[-1])
    time = p.rng.uniform(0.2, 0.5) * end
    return {"time": time, "middle": time / end * (1.0 - np.exp(-end / time))}


def _hose(p: Place) -> dict[str, float]:
    low, high = p.span
    wide = high - low
    return {"rest": p.rng.uniform(low, high), "slack": p.rng.uniform(0.05, 0.15) * wide, "bend": 0.25 * wide}


def _ripple(p: Place) -> dict[str, float]:
    low, high = p.span
    return {
        "order": float(np.ceil(2.0 * np.pi * p.rng.uniform(6.0, 15.0) / (high - low))),
        "phase": p.rng.uniform(-3, 3),
    }


# In the order of `outside.NAMES`.
SHAPES: dict[str, Callable[[Place], dict[str, float]]] = {
    "push": _push,
    "soft_contact": _contact,
    "friction_warm_up": _warm_up,
    "voltage_sag": lambda _: {},
    "hose": _hose,
    "torque_ripple_with_load": _ripple,
}


def _numbers(p: Place, name: str, shape: dict[str, float], s: float) -> dict[str, float]:
    if name == "push":
        return {**shape, "torque": s * shape["side"]}
    if name == "soft_contact":
        return {**shape, "stiffness": s, "damping": 0.02 * s}
    if name == "friction_warm_up":
        return {**shape, "torque": s}
    if name == "hose":
        return {**shape, "stiffness": s}
    return {**shape, "share": s}


def drawn_cause(rng: np.random.Generator, name: str, ruler: Ruler) -> Effect:
    """A cause of `outside.NAMES` at a joint drawn by chance."""
    parts = ruler.setup.truth.parts
    hinges = [j for j, part in enumerate(parts) if not (part.linear and name == "torque_ripple_with_load")]
    j = int(rng.choice(hinges))
    p = Place(j, parts[j].joint, rng, ruler)
    shape = {key: float(value) for key, value in SHAPES[name](p).items()}
    low, high = p.span

    def change(robot: Robot, of: Departures, s: float) -> tuple[Robot, Departures]:
        return robot, replace(of, outside=Outside(name, j, _numbers(p, name, shape, s)))

    share = p.floor / p.of("torque")
    start = {
        "push": 4.0 * p.floor,
        "soft_contact": 20.0 * p.floor / (high - low),
        "friction_warm_up": 3.0 * p.floor,
        "hose": 5.0 * p.floor / (high - low),
    }.get(name, share)
    # Friction that falls below the modelled one must not fall below nothing.
    most = {"friction_warm_up": parts[j].dry / shape["middle"]} if name == "friction_warm_up" else {}
    whole = name == "voltage_sag"
    return Effect(
        name,
        None if whole else p.name,
        change,
        lambda s: dict(_numbers(p, name, shape, s)),
        start,
        most.get(name, 0.5 if name in ("voltage_sag", "torque_ripple_with_load") else np.inf),
    )
