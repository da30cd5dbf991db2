"""Causes outside the catalogue, from their equations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .plant import Outside
from .robots import Table
from .sizing import Ruler, rms

NAMES = ("friction_warm_up", "shaker", "soft_contact", "voltage_sag", "drifting_offset")
WARM_FRICTION = 3.0  # modelled friction of a robot that warms up, over what is drawn otherwise


def prepared(table: Table, name: str) -> Table:
    """The owner's robot for a cause: one that can warm up has enough friction to lose."""
    if name != "friction_warm_up":
        return table
    return replace(table, links=tuple(replace(x, coulomb=WARM_FRICTION * x.coulomb) for x in table.links))


def draw_outside(rng: np.random.Generator, name: str, measure: Ruler) -> Callable[[float], Outside]:
    """The cause with one magnitude open; its unit is about one noise floor."""
    table, session, q = measure.truth, measure.session, measure.run.q
    j = int(rng.integers(len(table.joints)))
    i, floor, duration = table.active[j], float(measure.floor[j]), len(q) / session.rate
    tau = rms(measure.run.command)
    if name == "friction_warm_up":
        time = float(rng.uniform(0.2, 0.45) * duration)
        settled = time / duration * (1.0 - float(np.exp(-duration / time)))
        return lambda m: Outside(name, i, {"torque": 3.5 * m * floor, "time_constant": time, "settled": settled})
    if name == "shaker":
        p = {"frequency": float(np.exp(rng.uniform(np.log(0.8), np.log(9.0)))), "phase": rng.uniform(-np.pi, np.pi)}
        return lambda m: Outside(name, i, {"amplitude": 1.4 * m * floor, **p})
    if name == "soft_contact":
        side = float(rng.choice((-1.0, 1.0)))
        place = float(np.quantile(side * q[:, j], rng.uniform(0.75, 0.9)) * side)
        depth = np.maximum(side * (q[:, j] - place), 0.0)
        unit = floor / float(np.sqrt(np.mean(depth**2)))
        p = {"position": place, "side": side}
        return lambda m: Outside(name, i, {"stiffness": m * unit, "damping": 0.02 * m * unit, **p})
    if name == "voltage_sag":
        load = float(np.abs(measure.run.command).sum(axis=1).mean())
        p = {"scale": load, "time_constant": rng.uniform(0.02, 0.3)}
        return lambda m: Outside(name, -1, {"depth": m * float(np.sqrt(np.mean((measure.floor / tau) ** 2))), **p})
    sign = float(rng.choice((-1.0, 1.0)))
    return lambda m: Outside(name, i, {"torque": 1.7 * m * sign * floor, "duration": duration})


def sound(cause: Outside, table: Table) -> bool:
    """Physically possible: friction stays positive, a supply does not turn its sign."""
    p = cause.parameters
    if cause.name == "friction_warm_up":
        return p["torque"] * p["settled"] < 0.95 * table.links[cause.joint].coulomb
    if cause.name == "voltage_sag":
        return p["depth"] < 0.35
    return True
