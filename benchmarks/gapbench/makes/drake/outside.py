"""Causes that are no effect of the catalogue: their torque on a joint, or what they make of a drive."""

from __future__ import annotations

import numpy as np

from .departures import Outside

NAMES = ("push", "soft_contact", "friction_warm_up", "voltage_sag", "hose", "torque_ripple_with_load")
SAG_SPEED = 0.15  # [s], how fast the supply follows the load


def on_link(of: Outside | None, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Torque from outside on the links [N m], shape ``(n,)``.

    A push is half a sine; a soft contact pushes back and never pulls; a hose is slack, then stiffens with the cube.
    """
    out = np.zeros_like(q)
    if of is None:
        return out
    j, p = of.j, of.numbers
    if of.name == "push":
        x = (t - p["begin"]) / p["length"]
        out[j] = p["torque"] * np.sin(np.pi * x) if 0.0 < x < 1.0 else 0.0
    elif of.name == "soft_contact":
        depth = p["side"] * (q[j] - p["at"])
        if depth > 0.0:
            out[j] = -p["side"] * max(p["stiffness"] * depth + p["damping"] * p["side"] * v[j], 0.0)
    elif of.name == "hose":
        pulled = q[j] - p["rest"]
        taut = np.sign(pulled) * max(abs(pulled) - p["slack"], 0.0)
        out[j] = -p["stiffness"] * taut * (1.0 + (taut / p["bend"]) ** 2)
    return out


def more_dry(of: Outside | None, t: float, n: int) -> np.ndarray:
    """Dry friction that falls while the joint warms up [N m], shape ``(n,)``."""
    out = np.zeros(n)
    if of is not None and of.name == "friction_warm_up":
        p = of.numbers
        out[of.j] = p["torque"] * (np.exp(-t / p["time"]) - p["middle"])
    return out


def of_drive(of: Outside | None, torque: np.ndarray, q: np.ndarray, load: float) -> np.ndarray:
    """What a sagging supply or a ripple in proportion to the current makes of a torque [N m], shape ``(n,)``.

    Args:
        load: Slow mean of all torques over its usual value.
    """
    if of is None:
        return torque
    p = of.numbers
    if of.name == "voltage_sag":
        return torque * (1.0 - min(p["share"] * load, 0.8))
    if of.name == "torque_ripple_with_load":
        out = torque.copy()
        out[of.j] *= 1.0 + p["share"] * np.sin(p["order"] * q[of.j] + p["phase"])
        return out
    return torque
