"""Effects of links, gravity and springs, added to recorded torques; and of encoders, added to recorded positions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.blind.makes.real import body
from benchmarks.blind.makes.real.motion import Grid
from benchmarks.blind.makes.real.scene import Effect, Rng, Rows, Scene, acting, needed

Array = np.ndarray


def _of_links(
    scene: Scene, name: str, joint: str | None, changed: Callable, parameters: Callable, start: float, most: float
) -> Effect:
    """An effect of other links or another gravity; ``changed(s)`` is the model with the effect at strength ``s``."""

    def put(s: float) -> Rows:
        other = changed(s)

        def law(g: Grid) -> Array:
            return body.torques(other, g.q, g.v, g.a) - body.torques(scene.robot.model, g.q, g.v, g.a)

        return needed(scene, scene.runs, law)

    return Effect(name, joint, put, parameters, start, most)


def payload(scene: Scene, _j: int, rng: Rng) -> Effect | None:
    """A point mass on the last link; None if the last joint is revolute and gravity does not act."""
    if not scene.robot.weighs and not scene.robot.linear[-1]:
        return None
    heavy, center = 0.1 * sum(x.mass for x in scene.robot.model.inertias), rng.uniform(-0.08, 0.12, 3)
    names = tuple(f"center_{x}" for x in "xyz")
    return _of_links(
        scene,
        "payload",
        None,
        lambda s: body.with_body(scene.robot.model, scene.n - 1, s * heavy, center),
        lambda s: {"mass": s * heavy, **dict(zip(names, map(float, center), strict=True))},
        0.3,
        10.0,
    )


def inertias(scene: Scene, j: int, rng: Rng) -> Effect:
    """Another mass, inertia and centre of mass of one link."""
    side, way = rng.choice((-1.0, 1.0)), 0.05 * rng.uniform(-1.0, 1.0, 3)
    return _of_links(
        scene,
        "inertial_parameters",
        scene.joints[j],
        lambda s: body.with_link(scene.robot.model, j, 1.0 + side * s, s * way),
        lambda s: {"mass_ratio": 1.0 + side * s, "center_shift": [float(s * x) for x in way]},
        0.3,
        0.8 if side < 0 else 3.0,
    )


def tilt(scene: Scene, _j: int, rng: Rng) -> Effect | None:
    """A base that is tilted about a horizontal axis."""
    if not scene.robot.weighs:
        return None
    angle = rng.uniform(-np.pi, np.pi)
    way = np.array([np.cos(angle), np.sin(angle), 0.0])
    return _of_links(
        scene,
        "base_tilt",
        None,
        lambda s: body.tilted(scene.robot.model, s * way),
        lambda s: {x: float(s * part) for x, part in zip(("roll", "pitch", "yaw"), way, strict=True)},
        0.03,
        0.35,
    )


def spring(scene: Scene, j: int, rng: Rng) -> Effect:
    """A linear spring on a joint, such as a cable."""
    rest, unit = scene.middle[j] + scene.reach[j] * rng.uniform(-1.0, 1.0), scene.torque[j] / scene.reach[j]
    return acting(
        scene,
        "parasitic_spring",
        j,
        lambda s: {"stiffness": s * unit, "rest_position": rest},
        lambda p, g: p["stiffness"] * (g.q[:, j] - rest),
        0.1,
    )


def _reading(scene: Scene, j: int, read: Callable[[Array], Array]) -> Rows:
    """The logs with the readings of joint ``j`` replaced by a function of the true ones."""
    out = []
    for run in scene.runs:
        q = run.q.copy()
        q[:, j] = read(q[:, j])
        out.append(replace(run, q=q))
    return tuple(out)


def encoder_offset(scene: Scene, j: int, rng: Rng) -> Effect | None:
    """An offset of the encoder of a revolute joint; None without gravity."""
    if scene.robot.linear[j] or not scene.robot.weighs:
        return None
    side = rng.choice((-1.0, 1.0))
    return Effect(
        "encoder_offset",
        scene.joints[j],
        lambda s: _reading(scene, j, lambda q: q + side * s),
        lambda s: {"offset": side * s},
        0.03,
        0.35,
    )


def eccentricity(scene: Scene, j: int, rng: Rng) -> Effect | None:
    """A periodic error of an encoder on a revolute joint."""
    if scene.robot.linear[j]:
        return None
    phase, order = float(rng.uniform(-np.pi, np.pi)), int(rng.choice((1, 1, 2)))
    return Effect(
        "encoder_eccentricity",
        scene.joints[j],
        lambda s: _reading(scene, j, lambda q: q + s * np.sin(order * q + phase)),
        lambda s: {"amplitude": s, "phase": phase, "order": order},
        0.02,
        0.3,
    )


def coarse(scene: Scene, j: int, _: Rng) -> Effect:
    """An encoder with larger steps."""
    unit = 0.01 * scene.reach[j]
    return Effect(
        "encoder_quantization",
        scene.joints[j],
        lambda s: _reading(scene, j, lambda q: np.round(q / (s * unit)) * (s * unit)),
        lambda s: {"step": s * unit},
        0.2,
        3.0,
    )
