"""First guesses of magnitudes: how much one unit of an effect changes, to first order, along the run without it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .effects import WHOLE, changed_table
from .inverse import rigid_torque
from .recipes import Recipe, realised
from .sizing import Ruler, at_samples, banded, rms, size_of

STEP = 1e-3  # of relative changes and angles, for differences
LEAST_CROSSINGS = 6  # sign changes of the transmitted torque, without which a gap leaves nothing


def transmitted(measure: Ruler, i: int) -> np.ndarray:
    """Torque that the transmission of link ``i`` passes on, ``(n,)``: what the links need, without its rotor."""
    j = measure.truth.active.index(i)
    q, v, a, _ = measure.thin
    return rigid_torque(measure.truth, q, v, a)[:, j] - measure.truth.links[i].rotor_inertia * a[:, j]


def rotors_off(measure: Ruler, i: int) -> Ruler:
    """The ruler for a robot whose link ``i`` has no rotor (it stays with the encoder)."""
    link = replace(measure.truth.links[i], rotor_inertia=0.0)
    return replace(measure, truth=measure.truth.with_link(i, link))


def moved(measure: Ruler, j: int, by: np.ndarray, rate: float) -> np.ndarray:
    """Change of the needed torque when joint ``j`` is elsewhere by ``by`` ``(n,)``, in noise floors ``(n, nv)``."""
    q, v, a, _ = measure.thin
    shift = [np.zeros_like(q) for _ in range(3)]
    for order, x in enumerate((by, np.gradient(by, 1.0 / rate), np.gradient(np.gradient(by, 1.0 / rate), 1.0 / rate))):
        shift[order][:, j] = x
    there = rigid_torque(measure.truth, q + shift[0], v + shift[1], a + shift[2])
    return (there - rigid_torque(measure.truth, q, v, a)) / measure.floor


def _only(measure: Ruler, i: int, x: np.ndarray) -> np.ndarray:
    """A torque on joint ``i`` of the tree as seen on the active joints, in noise floors."""
    return np.outer(x, measure.truth.selection()[i]) / measure.floor


def thin_rate(measure: Ruler) -> float:
    """Of the thinned samples [Hz]."""
    return measure.session.rate / max(1, round(measure.session.rate / 100.0))


def _timing(measure: Ruler, joint: int) -> np.ndarray:
    rate = measure.session.rate
    late = banded(np.gradient(at_samples(measure.run.command), 1.0 / rate, axis=0), rate) / measure.floor
    if joint == WHOLE:
        return late
    return late * (np.arange(late.shape[1]) == measure.truth.active.index(joint))


def _table_change(measure: Ruler, recipe: Recipe, m: float) -> np.ndarray:
    effect, thin = realised(recipe, m), measure.thin[:3]
    change = rigid_torque(changed_table(effect, measure.truth), *thin) - rigid_torque(measure.truth, *thin)
    return change / m / measure.floor


def clipped_limit(measure: Ruler, joint: int, size: float) -> float:
    """1/limit at which the clipped part of the torque has the size, by bisection."""
    rate, j = measure.session.rate, measure.truth.active.index(joint)
    tau = measure.run.command[:, j]
    low, high = 0.1 * np.abs(tau).max(), np.abs(tau).max()
    for _ in range(20):
        limit = 0.5 * (low + high)
        left = (tau - np.clip(tau, -limit, limit))[:, None]
        size_here = rms(banded(left, rate))[0] / measure.floor[j]
        low, high = (limit, high) if size_here > size else (low, limit)
    return 1.0 / low


def unit_change(recipe: Recipe, measure: Ruler) -> np.ndarray | None:
    """Change per unit of magnitude ``(n, nv)`` in noise floors; None where no first order exists."""
    i, s, name = recipe.joint, recipe.shape, recipe.effect
    select, (q, v, a, tau) = measure.truth.selection(), measure.thin
    rate, tree = thin_rate(measure), [x @ select.T for x in (q, v, a)]
    sign = np.tanh(tree[1] / 5e-3)
    j = measure.truth.active.index(i) if i in measure.truth.active else -1

    def stretched() -> np.ndarray:
        bare = rotors_off(measure, i)
        by = transmitted(measure, i) / 1e6
        return moved(bare, j, by, rate) * 1e6

    def coupled() -> np.ndarray:
        w = tree[1][:, i] + s["ratio"] * tree[1][:, recipe.second]
        law = s["torque"] * np.tanh(w / 5e-3) + s["coefficient"] * w + s["inertia"] * np.gradient(w, 1.0 / rate)
        return _only(measure, i, law) + s["ratio"] * _only(measure, recipe.second, law)

    def directed() -> np.ndarray:
        up, down = 0.5 * (1.0 + sign[:, i]), 0.5 * (1.0 - sign[:, i])
        x = tree[1][:, i]
        return _only(
            measure, i, up * (s["positive"] + s["c_positive"] * x) - down * (s["negative"] - s["c_negative"] * x)
        )

    def faded() -> np.ndarray:
        return _only(
            measure, i, sign[:, i] * (s["coulomb"] + (1 - s["coulomb"]) * np.exp(-((tree[1][:, i] / s["speed"]) ** 2)))
        )

    known: dict[str, Callable[[], np.ndarray]] = {
        "viscous_friction": lambda: _only(measure, i, tree[1][:, i]),
        "coulomb_friction": lambda: _only(measure, i, sign[:, i]),
        "direction_dependent_friction": directed,
        "stribeck_friction": faded,
        "presliding_friction": lambda: 0.85 * _only(measure, i, sign[:, i]),
        "load_dependent_friction": lambda: _only(measure, i, np.abs(transmitted(measure, i)) * sign[:, i]),
        "transmission_compliance": stretched,
        "joint_coupling": coupled,
        "cogging": lambda: _only(measure, i, 0.8 * np.sin(s["order"] * tree[0][:, i] + s["phase"])),
        "torque_constant": lambda: _only(measure, i, tau[:, j]),
        "torque_offset": lambda: _only(measure, i, np.ones(len(q))),
        "input_delay": lambda: _timing(measure, i),
        "actuator_lag": lambda: _timing(measure, i),
        "rotor_inertia": lambda: _only(measure, i, tree[2][:, i]),
        "payload": lambda: _table_change(measure, recipe, STEP * measure.truth.links[i].mass),
        "inertial_parameters": lambda: _table_change(measure, recipe, STEP),
        "base_tilt": lambda: _table_change(measure, recipe, STEP),
        "parasitic_spring": lambda: _only(measure, i, tree[0][:, i] - s["rest"]),
        "encoder_offset": lambda: moved(measure, j, np.full(len(q), STEP), rate) / STEP,
        "encoder_eccentricity": lambda: moved(measure, j, STEP * np.sin(q[:, j] + s["phase"]), rate) / STEP,
    }
    return known[name]() if name in known else None


def first_guess(recipe: Recipe, measure: Ruler, size: float) -> float:
    """Magnitude at which the effect should have about the wanted size; 0 where physics leaves no signal."""
    if recipe.effect == "torque_saturation":
        return clipped_limit(measure, recipe.joint, size)
    if recipe.effect == "backlash":
        torque = transmitted(measure, recipe.joint)
        loud = torque[np.abs(torque) > 0.1 * rms(torque[:, None])[0]]
        return 2e-3 if int(np.sum(np.diff(np.sign(loud)) != 0)) >= LEAST_CROSSINGS else 0.0
    if recipe.effect == "encoder_quantization":
        return 5e-4 * size
    change = unit_change(recipe, measure)
    unit = 0.0 if change is None else size_of(change)
    return size / unit if unit > 1e-6 else 0.0


def largest_magnitude(recipe: Recipe, measure: Ruler) -> float:
    """Beyond this the machine is no longer the same robot, or not physical."""
    i, table = recipe.joint, measure.truth
    fixed = {
        "backlash": 0.08,
        "torque_constant": 0.5,
        "input_delay": 0.02,
        "actuator_lag": 0.03,
        "base_tilt": 0.3,
        "encoder_offset": 0.3,
        "encoder_eccentricity": 0.15,
        "encoder_quantization": 0.03,
        "load_dependent_friction": 0.6,
    }
    if recipe.effect in fixed:
        return fixed[recipe.effect]
    if recipe.effect == "inertial_parameters":
        return 0.6 if recipe.shape["mass"] < 0 else 1.5
    if recipe.effect == "payload":
        return 3.0 * table.links[i].mass
    if recipe.effect == "transmission_compliance":
        return 0.1 / float(rms(transmitted(measure, i)[:, None])[0])
    strength = rms(measure.run.command)
    if recipe.effect == "torque_saturation":
        return 2.5 / float(np.abs(measure.run.command[:, table.active.index(i)]).max())
    if recipe.effect in ("coulomb_friction", "presliding_friction", "stribeck_friction", "joint_coupling", "cogging"):
        return 1.5 * float(strength[table.active.index(i)] if i in table.active else strength.min())
    return np.inf
