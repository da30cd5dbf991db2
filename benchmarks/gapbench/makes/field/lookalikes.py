"""Answers that a recording cannot part from the truth: columns of each rival against the trace of the true effect.

The physics decides: a rival stands beside the truth where its best coefficients, with the model moved by about its
tolerance, leave less than a tenth of a noise floor of the trace on this robot and motion, with no more parameters.
That holds for exact twins (rotor and link inertia on a first joint, tilt and encoder offset on one horizontal axis)
and for those that this motion makes twins.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter

from .dynamics import link_torque
from .effects import Effect
from .gap import GRID, REACHED, Trace, View, stacked, tolerance_columns
from .robots import Robot
from .world import tilted, with_body

Array = np.ndarray
SAME = 0.1  # noise floors that a twin may leave
SMALL = 1e-4  # step of the differences along angles [rad]
INERTIAL = ("rotor_inertia", "payload", "inertial_parameters", "torque_constant")
COUNTS = {"inertial_parameters": 10, "payload": 4, "base_tilt": 2}  # a list or a vector counts as what it can say

Rival = tuple[str, str | None, list[Array]]


def _needed(robot: Robot, view: View) -> Array:
    return link_torque(robot.true, view.q, view.v, view.a)


def _at(like: Array, j: int, shape: Array | float) -> Array:
    out = np.zeros_like(like)
    out[:, j] = shape
    return out


def _body_columns(robot: Robot, view: View, link: int, usual: Array) -> list[Array]:
    """Torques of a small body on a link: its mass at the origin, and three places beside it."""
    out = []
    for center in (np.zeros(3), *(0.1 * np.eye(3))):
        chain = with_body(robot.true, link, 0.01, center, np.zeros((3, 3)))
        out.append(link_torque(chain, view.q, view.v, view.a) - usual)
    return out


def _inertia_columns(robot: Robot, view: View, link: int, usual: Array) -> list[Array]:
    """Torques of small moments of inertia of a link, in all six directions."""
    out = []
    for a in range(3):
        for b in range(a, 3):
            inertia = robot.true.inertia.copy()
            inertia[link, a, b] += 1e-3
            inertia[link, b, a] = inertia[link, a, b]
            out.append(link_torque(replace(robot.true, inertia=inertia), view.q, view.v, view.a) - usual)
    return out


def _late(tau: Array, effect: str, time: float) -> Array:
    """What a delay or a lag of this time takes off a torque."""
    t = np.arange(len(tau)) * GRID
    if effect == "input_delay":
        return np.stack([np.interp(t - time, t, one) for one in tau.T], axis=1) - tau
    keep = np.exp(-GRID / max(time, 1e-6))
    start = tau[:1]
    return start + lfilter([1.0 - keep], [1.0, -keep], tau - start, axis=0) - tau


def rivals(robot: Robot, view: View, step: int, time: float) -> Iterator[Rival]:
    """Every linear rival with its columns, each of shape ``(M, n)``."""
    thin = view.thin(step)
    usual = _needed(robot, thin)
    late = {name: _late(view.tau, name, time)[::step] for name in ("input_delay", "actuator_lag")}
    for name, column in late.items():
        yield name, None, [column]
    yield (
        "base_tilt",
        None,
        [link_torque(tilted(robot.true, SMALL * way), thin.q, thin.v, thin.a) - usual for way in np.eye(3)[:2]],
    )
    yield "payload", None, _body_columns(robot, thin, robot.true.n - 1, usual)
    for j, name in enumerate(robot.names):
        one, s = np.ones(len(usual)), thin.sign[:, j]
        q, v, a = thin.q[:, j], thin.v[:, j], thin.a[:, j]
        plain = {
            "coulomb_friction": [s],
            "viscous_friction": [v],
            "torque_offset": [one],
            "parasitic_spring": [q, one],
            "rotor_inertia": [a],
            "load_dependent_friction": [np.abs(usual[:, j]) * s],
            "torque_constant": [thin.tau[:, j]],
            "direction_dependent_friction": [s, one, v, np.abs(v)],
        }
        for effect, shapes in plain.items():
            yield effect, name, [_at(usual, j, shape) for shape in shapes]
        for effect, column in late.items():
            yield effect, name, [_at(usual, j, column[:, j])]
        moved = thin.q.copy()
        moved[:, j] += SMALL
        yield "encoder_offset", name, [link_torque(robot.true, moved, thin.v, thin.a) - usual]
        body = _body_columns(robot, thin, j, usual)
        yield "inertial_parameters", name, [*body, *_inertia_columns(robot, thin, j, usual)]


def _left(change: Array, columns: Array, doubt: Array) -> float:
    """What the best coefficients leave, root mean square, inside the tolerance."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0.0] / size[size > 0.0]
    free = columns.shape[1]
    if not free:
        return np.inf
    # Two deviations of one move cost as much as what a twin may leave in all samples.
    price = 0.5 * SAME * np.sqrt(len(change)) * np.eye(doubt.shape[1])
    price = np.concatenate([np.zeros((doubt.shape[1], free)), price], axis=1)
    left = np.concatenate([np.concatenate([columns, doubt], axis=1), price])
    right = np.concatenate([change, np.zeros(doubt.shape[1])])
    best = np.linalg.lstsq(left, right, rcond=1e-9)[0]
    if np.any(np.abs(best[free:]) > 2.0):
        return np.inf
    return float(np.sqrt(np.mean((change - left[: len(change)] @ best) ** 2)))


def alike(robot: Robot, effect: Effect, size: float, found: Trace) -> list[dict]:
    """Effect and joint of every rival that this recording cannot part from the true one."""
    step = max(1, len(found.change) // 400)
    change = stacked(found, [found.change[::step]], step)[:, 0]
    doubt = stacked(found, tolerance_columns(robot, found.base.thin(step)), step)
    numbers = effect.parameters(size)
    own = COUNTS.get(effect.name, sum(len(x) if isinstance(x, list) else 1 for x in numbers.values()))
    time = float(numbers.get("delay", numbers.get("time_constant", 0.003)))  # type: ignore[arg-type]  # both are numbers
    reached = {name for name, x in zip(robot.names, found.each, strict=True) if x >= REACHED * found.each.max()}
    out = []
    for name, joint, columns in rivals(robot, found.base, step, time):
        if (name, joint) == (effect.name, effect.joint) or (joint is not None and joint not in reached):
            continue
        inertial = effect.name in INERTIAL and name == "inertial_parameters"
        if len(columns) > own and not inertial:
            continue
        if _left(change, stacked(found, columns, step), doubt) < SAME:
            out.append({"effect": name, "joint": joint})
            if name == "inertial_parameters":
                out.append({"effect": name, "joint": None})
    return [dict(pair) for pair in dict.fromkeys(tuple(x.items()) for x in out)]
