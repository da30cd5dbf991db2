"""Finds the effects that a recording cannot distinguish from the true effect.

A rival cannot be distinguished if its columns explain the change by the true effect to within a tenth of a noise floor.
The model may then differ from the given one within about its tolerance, and the rival may not have more parameters.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.blind.makes.real import body
from benchmarks.blind.makes.real.friction_laws import bristle
from benchmarks.blind.makes.real.sizing import REACHED, Ruler, Sized, each, in_band, stacked

Array = np.ndarray
SAME = 0.1  # largest residual of a rival that cannot be distinguished [noise floors]
SMALL = 1e-4  # step of finite differences by angles [rad]
INERTIAL = ("rotor_inertia", "payload", "inertial_parameters", "torque_constant")
COUNTS = {"inertial_parameters": 10, "payload": 4, "base_tilt": 2}
REACHES = (0.02, 0.05, 0.12)  # presliding displacements that are tried, as shares of half the range of motion
SLIDES = (0.05, 0.1, 0.2)  # Stribeck velocities that are tried, as shares of the top speed

Rival = tuple[str, str | None, int, Array]  # effect, joint, number of parameters, columns (K, n, m)


def _at(by: Ruler, j: int, *shapes: Array) -> Array:
    """Columns ``(K, n, m)`` that act on joint ``j`` alone."""
    out = np.zeros((*by.q.shape, len(shapes)))
    for k, shape in enumerate(shapes):
        out[:, j, k] = shape
    return out


def _rate(by: Ruler) -> Array:
    """Rate of the torques, shape ``(K, n)``: a delay or lag changes them by about this rate times its time."""
    return in_band(by.scene, lambda k: np.gradient(by.scene.grids[k].tau, by.scene.grids[k].step, axis=0))


def _shaped(by: Ruler, j: int) -> Iterator[Rival]:
    """Friction laws with a nonlinear parameter, for a few values of this parameter."""
    scene, name = by.scene, by.scene.joints[j]
    for share in REACHES:
        reach = share * scene.reach[j]
        column = in_band(scene, lambda k, reach=reach: bristle(scene.grids[k].q[:, j], 1.0, reach)[:, None])[:, 0]
        yield "presliding_friction", name, 2, _at(by, j, column)
    for share in SLIDES:
        slide = share * scene.speed[j]
        peak = in_band(
            scene,
            lambda k, slide=slide: (scene.grids[k].side * np.exp(-((scene.grids[k].v / slide) ** 2)))[:, j : j + 1],
        )[:, 0]
        yield "stribeck_friction", name, 3, _at(by, j, by.side[:, j], peak)


def rivals(by: Ruler) -> Iterator[Rival]:
    """All rivals that are linear in their parameters, or become linear for given values of the others."""
    scene, model = by.scene, by.scene.robot.model
    usual, rate = body.torques(model, by.q, by.v, by.a), _rate(by)
    late = [] if scene.robot.source != "command" else ["input_delay", "actuator_lag"]
    for name in late:
        yield name, None, 1, rate[:, :, None]
    if scene.robot.weighs:
        ways = [body.torques(body.tilted(model, SMALL * way), by.q, by.v, by.a) - usual for way in np.eye(3)[:2]]
        yield "base_tilt", None, 2, np.stack(ways, axis=2)
    last = 10 * (scene.n - 1)
    yield "payload", None, 4, by.regressor[:, :, last : last + 4]
    yield "inertial_parameters", None, 10, by.regressor
    for j, name in enumerate(scene.joints):
        q, v, a, side, one = (x[:, j] for x in (by.q, by.v, by.a, by.side, np.ones_like(by.q)))
        yield "coulomb_friction", name, 1, _at(by, j, side)
        yield "viscous_friction", name, 1, _at(by, j, v)
        yield "torque_offset", name, 1, _at(by, j, one)
        yield "parasitic_spring", name, 2, _at(by, j, q, one)
        yield "load_dependent_friction", name, 1, _at(by, j, np.abs(usual[:, j]) * side)
        yield "direction_dependent_friction", name, 4, _at(by, j, side, one, v, np.abs(v))
        yield from _shaped(by, j)
        yield "inertial_parameters", name, 10, by.regressor[:, :, 10 * j : 10 * j + 10]
        if scene.robot.source != "sensor":
            yield "rotor_inertia", name, 1, _at(by, j, a)
            yield "torque_constant", name, 1, _at(by, j, by.tau[:, j])
        for effect in late:
            yield effect, name, 1, _at(by, j, rate[:, j])
        moved = by.q.copy()
        moved[:, j] += SMALL
        yield "encoder_offset", name, 1, (body.torques(model, moved, by.v, by.a) - usual)[:, :, None]


def residual(wanted: Array, columns: Array, doubt: Array) -> float:
    """Root mean square residual of the best fit; infinite if the fit needs a model beyond two standard deviations.

    Args:
        wanted: Change by the true effect [noise floors], shape ``(K n,)``.
        columns: Columns of the rival [noise floors], shape ``(K n, m)``.
        doubt: Columns of the model's tolerances, one standard deviation each [noise floors].
    """
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0.0] / size[size > 0.0]
    free = columns.shape[1]
    if not free:
        return np.inf
    # A change of the model by two standard deviations costs as much as the largest allowed residual in all samples.
    price = 0.5 * SAME * np.sqrt(len(wanted)) * np.eye(doubt.shape[1])
    price = np.concatenate([np.zeros((doubt.shape[1], free)), price], axis=1)
    stack = np.concatenate([np.concatenate([columns, doubt], axis=1), price])
    best = np.linalg.lstsq(stack, np.concatenate([wanted, np.zeros(doubt.shape[1])]), rcond=1e-9)[0]
    if np.any(np.abs(best[free:]) > 2.0):
        return np.inf
    return float(np.sqrt(np.mean((wanted - stack[: len(wanted)] @ best) ** 2)))


def alike(by: Ruler, one: Sized) -> list[dict]:
    """Effect and joint of every rival that this recording cannot distinguish from the true effect."""
    wanted, doubt = stacked(by, one.changed[:, :, None])[:, 0], stacked(by, by.doubt)
    numbers = one.effect.parameters(one.size)
    own = COUNTS.get(one.effect.name, sum(len(x) if isinstance(x, list) else 1 for x in numbers.values()))
    sizes = each(by, one.changed)
    reached = {name for name, x in zip(by.scene.joints, sizes, strict=True) if x >= REACHED * sizes.max()}
    out = {}
    for name, joint, count, columns in rivals(by):
        if (name, joint) == (one.effect.name, one.effect.joint) or (joint is not None and joint not in reached):
            continue
        inertial = one.effect.name in INERTIAL and name == "inertial_parameters"
        if count > own and not inertial:
            continue
        if (name, joint) not in out and residual(wanted, stacked(by, columns), doubt) < SAME:
            out[name, joint] = {"effect": name, "joint": joint}
    return list(out.values())
