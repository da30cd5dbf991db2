"""Laws of joint friction, added to recorded torques."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.makes.real import body
from benchmarks.blind.makes.real.motion import Grid, directions
from benchmarks.blind.makes.real.scene import Effect, Rng, Rows, Scene, acting, needed, on_joint

Array = np.ndarray


def viscous(scene: Scene, j: int, _: Rng) -> Effect:
    """Friction proportional to the velocity."""
    unit = scene.torque[j] / scene.speed[j]
    return acting(
        scene,
        "viscous_friction",
        j,
        lambda s: {"coefficient": s * unit},
        lambda p, g: p["coefficient"] * g.v[:, j],
        0.1,
    )


def coulomb(scene: Scene, j: int, _: Rng) -> Effect:
    """Friction of constant torque against the motion."""
    unit = scene.torque[j]
    return acting(
        scene, "coulomb_friction", j, lambda s: {"torque": s * unit}, lambda p, g: p["torque"] * g.side[:, j], 0.05
    )


def by_direction(scene: Scene, j: int, rng: Rng) -> Effect:
    """Coulomb and viscous friction that differ by the direction of motion."""
    side, more, faster = rng.choice((-1.0, 1.0)), rng.uniform(0.3, 0.8), rng.uniform(-0.8, 0.8)
    level, slope = scene.torque[j], 0.6 * scene.torque[j] / scene.speed[j]

    def parameters(s: float) -> dict:
        return {
            "torque_positive": s * level * (1 + side * more),
            "torque_negative": s * level * (1 - side * more),
            "coefficient_positive": s * slope * (1 + faster),
            "coefficient_negative": s * slope * (1 - faster),
        }

    def law(p: dict, g: Grid) -> Array:
        v = g.v[:, j]
        forth = p["torque_positive"] + p["coefficient_positive"] * np.maximum(v, 0.0)
        back = p["torque_negative"] + p["coefficient_negative"] * np.maximum(-v, 0.0)
        return np.where(g.side[:, j] > 0.0, forth, -back)

    return acting(scene, "direction_dependent_friction", j, parameters, law, 0.05)


def stribeck(scene: Scene, j: int, rng: Rng) -> Effect:
    """Friction that decreases from static to Coulomb friction as the velocity grows."""
    higher, slide = rng.uniform(1.6, 3.0), scene.speed[j] * rng.uniform(0.05, 0.15)

    def parameters(s: float) -> dict:
        level = s * scene.torque[j]
        return {"coulomb_torque": level, "static_torque": higher * level, "stribeck_velocity": slide}

    def law(p: dict, g: Grid) -> Array:
        more = (p["static_torque"] - p["coulomb_torque"]) * np.exp(-((g.v[:, j] / p["stribeck_velocity"]) ** 2))
        return (p["coulomb_torque"] + more) * g.side[:, j]

    return acting(scene, "stribeck_friction", j, parameters, law, 0.05)


def bristle(q: Array, torque: float, displacement: float) -> Array:
    """Dahl's friction along positions: ``dF/dx = (T - F sign(dx)) / d``, from zero, shape ``(M,)``.

    The joint is assumed to move in one direction between two samples. The law is then solved exactly.
    """
    out = np.zeros(len(q))
    for k, step in enumerate(np.diff(q)):
        end = torque * np.sign(step)
        out[k + 1] = end + (out[k] - end) * np.exp(-abs(step) / displacement)
    return out


def presliding(scene: Scene, j: int, rng: Rng) -> Effect:
    """Dahl's friction, see `bristle`."""
    reach = scene.reach[j] * rng.uniform(0.02, 0.12)
    return acting(
        scene,
        "presliding_friction",
        j,
        lambda s: {"torque": s * scene.torque[j], "displacement": reach},
        lambda p, g: bristle(g.q[:, j], p["torque"], p["displacement"]),
        0.05,
    )


def loaded(scene: Scene, j: int, _: Rng) -> Effect:
    """Coulomb friction in proportion to the torque of the links."""

    def law(p: dict, g: Grid) -> Array:
        passed = body.torques(scene.robot.model, g.q, g.v, g.a)[:, j]
        return p["ratio"] * np.abs(passed) * g.side[:, j]

    return acting(scene, "load_dependent_friction", j, lambda s: {"ratio": s}, law, 0.05, 0.6)


def coupling(scene: Scene, j: int, rng: Rng) -> Effect | None:
    """Friction and inertia of a motor that moves with a sum of two neighbouring joints."""
    if scene.n < 2:
        return None
    i = min(j, scene.n - 2)
    ratio = float(rng.choice((-1.0, 1.0)) * rng.choice((0.5, 1.0)))
    unit, slope = min(scene.torque[i : i + 2]), rng.uniform(0.2, 0.8) / max(scene.speed[i : i + 2])
    inertia = rng.uniform(0.0, 0.3) / max(scene.push[i : i + 2])

    def parameters(s: float) -> dict:
        level = s * unit
        return {
            "ratio": ratio,
            "coulomb_torque": level,
            "coefficient": slope * level,
            "inertia": inertia * level,
        }

    def law(p: dict, g: Grid) -> Array:
        q, v, a = (x[:, i] + ratio * x[:, i + 1] for x in (g.q, g.v, g.a))
        side = directions(q[:, None], np.array([g.back[i] + abs(ratio) * g.back[i + 1]]))[:, 0]
        opposing = p["coulomb_torque"] * side + p["coefficient"] * v + p["inertia"] * a
        return on_joint(g, i, opposing) + on_joint(g, i + 1, ratio * opposing)

    def put(s: float) -> Rows:
        return needed(scene, scene.runs, lambda g: law(parameters(s), g))

    return Effect("joint_coupling", f"{scene.joints[i]}+{scene.joints[i + 1]}", put, parameters, 0.05)
