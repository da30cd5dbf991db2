"""The effects that a recording can be given after the fact, each from its law, with one number for its strength.

What acts on the torque is put into the recorded torque: the drive of a robot that has the effect and makes the same
motion needs so much more. What acts on time or on an encoder changes the columns. Effects that change the motion
(a limit of the torque, play, a spring in the transmission) would need a simulation of both robots and are left out.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.makes.real import body
from benchmarks.blind.makes.real.body import Body
from benchmarks.blind.makes.real.motion import Grid, at_rows, directions
from benchmarks.blind.makes.real.recordings import Run

Array = np.ndarray
Rng = np.random.Generator
Told = Mapping[str, object]
Rows = tuple[Run, ...]


@dataclass(frozen=True)
class Scene:
    """Part two as it was recorded, with what its motion is like.

    Attributes:
        robot: The given model.
        joints: From the base outwards.
        runs: As recorded; ``grids`` the same on even grids.
        band: End of the judged band [Hz].
        torque: Root mean square of each joint's torque [N m or N], shape ``(n,)``.
        speed: Top speed [rad/s or m/s]; ``usual``: root mean square of it.
        middle: Middle of the motion [rad or m]; ``reach``: half of its range.
        push: Root mean square of the acceleration.
    """

    robot: Body
    joints: tuple[str, ...]
    runs: Rows
    grids: tuple[Grid, ...]
    band: float
    torque: Array
    speed: Array
    usual: Array
    middle: Array
    reach: Array
    push: Array

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)


def scene_of(robot: Body, joints: tuple[str, ...], runs: Rows, grids: tuple[Grid, ...], band: float) -> Scene:
    """Part two with its ordinary sizes."""
    q, v, a, tau = (np.concatenate([getattr(g, x) for g in grids]) for x in ("q", "v", "a", "tau"))
    low, high = q.min(axis=0), q.max(axis=0)

    def usual(x: Array) -> Array:
        return np.sqrt(np.mean(x**2, axis=0))

    return Scene(
        robot,
        joints,
        runs,
        grids,
        band,
        torque=usual(tau),
        speed=np.quantile(np.abs(v), 0.99, axis=0),
        usual=usual(v),
        middle=0.5 * (low + high),
        reach=0.5 * (high - low),
        push=usual(a),
    )


@dataclass(frozen=True)
class Effect:
    """One effect of a shape that is drawn.

    Attributes:
        name: In the contract's words.
        joint: The joint, both joints of a coupling, None for the whole robot.
        put: The logs with the effect at a strength.
        told: Its parameters at a strength.
        start: Ordinary strength; ``most`` the largest that makes sense.
    """

    name: str
    joint: str | None
    put: Callable[[float], Rows]
    told: Callable[[float], Told]
    start: float
    most: float = np.inf


Law = Callable[[Scene, int, Rng], Effect | None]


def needed(scene: Scene, runs: Rows, torque: Callable[[Grid], Array]) -> Rows:
    """The logs when the drives have to give a torque more, which a law computes from a run, shape ``(M, n)``."""
    return tuple(
        replace(run, tau=run.tau + at_rows(run, grid, torque(grid)))
        for run, grid in zip(runs, scene.grids, strict=True)
    )


def on_joint(grid: Grid, j: int, values: Array) -> Array:
    """Torques that are zero but for one joint."""
    out = np.zeros_like(grid.tau)
    out[:, j] = values
    return out


def _acting(
    scene: Scene,
    name: str,
    j: int,
    told: Callable[[float], dict],
    law: Callable[[dict, Grid], Array],
    start: float,
    most: float = np.inf,
) -> Effect:
    """An effect that adds ``law(parameters, run)`` to what one joint's drive has to give, shape ``(M,)``."""

    def put(s: float) -> Rows:
        p = told(s)
        return needed(scene, scene.runs, lambda grid: on_joint(grid, j, law(p, grid)))

    return Effect(name, scene.joints[j], put, told, start, most)


def viscous(scene: Scene, j: int, _: Rng) -> Effect:
    unit = scene.torque[j] / scene.speed[j]
    return _acting(
        scene,
        "viscous_friction",
        j,
        lambda s: {"coefficient": s * unit},
        lambda p, g: p["coefficient"] * g.v[:, j],
        0.1,
    )


def coulomb(scene: Scene, j: int, _: Rng) -> Effect:
    unit = scene.torque[j]
    return _acting(
        scene, "coulomb_friction", j, lambda s: {"torque": s * unit}, lambda p, g: p["torque"] * g.side[:, j], 0.05
    )


def by_direction(scene: Scene, j: int, rng: Rng) -> Effect:
    side, more, faster = rng.choice((-1.0, 1.0)), rng.uniform(0.3, 0.8), rng.uniform(-0.8, 0.8)
    level, slope = scene.torque[j], 0.6 * scene.torque[j] / scene.speed[j]

    def told(s: float) -> dict:
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

    return _acting(scene, "direction_dependent_friction", j, told, law, 0.05)


def stribeck(scene: Scene, j: int, rng: Rng) -> Effect:
    higher, slide = rng.uniform(1.6, 3.0), scene.speed[j] * rng.uniform(0.05, 0.15)

    def told(s: float) -> dict:
        level = s * scene.torque[j]
        return {"coulomb_torque": level, "static_torque": higher * level, "stribeck_velocity": slide}

    def law(p: dict, g: Grid) -> Array:
        more = (p["static_torque"] - p["coulomb_torque"]) * np.exp(-((g.v[:, j] / p["stribeck_velocity"]) ** 2))
        return (p["coulomb_torque"] + more) * g.side[:, j]

    return _acting(scene, "stribeck_friction", j, told, law, 0.05)


def bristle(q: Array, torque: float, displacement: float) -> Array:
    """Dahl's friction along positions: ``dF/dx = (T - F sign(dx)) / d``, from rest, shape ``(M,)``.

    Between two samples the joint goes one way, and the law is solved exactly.
    """
    out = np.zeros(len(q))
    for k, step in enumerate(np.diff(q)):
        end = torque * np.sign(step)
        out[k + 1] = end + (out[k] - end) * np.exp(-abs(step) / displacement)
    return out


def presliding(scene: Scene, j: int, rng: Rng) -> Effect:
    reach = scene.reach[j] * rng.uniform(0.02, 0.12)
    return _acting(
        scene,
        "presliding_friction",
        j,
        lambda s: {"torque": s * scene.torque[j], "displacement": reach},
        lambda p, g: bristle(g.q[:, j], p["torque"], p["displacement"]),
        0.05,
    )


def loaded(scene: Scene, j: int, _: Rng) -> Effect:
    def law(p: dict, g: Grid) -> Array:
        passed = body.torques(scene.robot.model, g.q, g.v, g.a)[:, j]
        return p["ratio"] * np.abs(passed) * g.side[:, j]

    return _acting(scene, "load_dependent_friction", j, lambda s: {"ratio": s}, law, 0.05, 0.6)


def coupling(scene: Scene, j: int, rng: Rng) -> Effect | None:
    if scene.n < 2:
        return None
    i = min(j, scene.n - 2)
    ratio = float(rng.choice((-1.0, 1.0)) * rng.choice((0.5, 1.0)))
    unit, slope = min(scene.torque[i : i + 2]), rng.uniform(0.2, 0.8) / max(scene.speed[i : i + 2])
    inertia = rng.uniform(0.0, 0.3) / max(scene.push[i : i + 2])

    def told(s: float) -> dict:
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
        return needed(scene, scene.runs, lambda g: law(told(s), g))

    return Effect("joint_coupling", f"{scene.joints[i]}+{scene.joints[i + 1]}", put, told, 0.05)


def cogging(scene: Scene, j: int, rng: Rng) -> Effect | None:
    if scene.robot.linear[j]:
        return None
    # At least a dozen cycles within the motion, and at its usual speed within the judged band.
    least = int(np.ceil(12.0 * np.pi / scene.reach[j]))
    most = int(2.0 * np.pi * scene.band / scene.usual[j])
    if least > most:
        return None
    order, phase = int(rng.integers(least, min(most, 4 * least) + 1)), float(rng.uniform(-np.pi, np.pi))

    def told(s: float) -> dict:
        return {"order": [order], "amplitude": [s * scene.torque[j]], "phase": [phase]}

    # It acts on the joint, so the drive has to give the opposite.
    return _acting(scene, "cogging", j, told, lambda p, g: -p["amplitude"][0] * np.sin(order * g.q[:, j] + phase), 0.05)


def torque_constant(scene: Scene, j: int, rng: Rng) -> Effect | None:
    if scene.robot.source == "sensor":
        return None  # it sits behind the drive
    side = rng.choice((-1.0, 1.0))

    def put(s: float) -> Rows:
        # True torque is the ratio times the recorded one.
        scale = np.ones(scene.n)
        scale[j] = 1.0 / (1.0 + side * s)
        return tuple(replace(run, tau=run.tau * scale) for run in scene.runs)

    return Effect("torque_constant", scene.joints[j], put, lambda s: {"ratio": 1.0 + side * s}, 0.1, 0.45)


def torque_offset(scene: Scene, j: int, rng: Rng) -> Effect:
    unit = rng.choice((-1.0, 1.0)) * scene.torque[j]
    return _acting(
        scene, "torque_offset", j, lambda s: {"torque": s * unit}, lambda p, g: np.full(len(g.t), -p["torque"]), 0.05
    )


def _advanced(run: Run, time: float, which: slice | int) -> Array:
    """Torques as they were asked for a time earlier, shape ``(N, n)``."""
    tau = run.tau.copy()
    columns = range(tau.shape[1]) if isinstance(which, slice) else (which,)
    for k in columns:
        tau[:, k] = np.interp(run.t + time, run.t, run.tau[:, k])
    return tau


def input_delay(scene: Scene, j: int, rng: Rng) -> Effect | None:
    if scene.robot.source != "command":
        return None  # what was measured has it already
    common = scene.n == 1 or rng.random() < 0.5
    which = slice(None) if common else j

    def put(s: float) -> Rows:
        # The true torque is the recorded one of a time before: it was written down that much earlier.
        return tuple(replace(run, tau=_advanced(run, s, which)) for run in scene.runs)

    return Effect("input_delay", None if common else scene.joints[j], put, lambda s: {"delay": s}, 0.005, 0.04)


def actuator_lag(scene: Scene, j: int, rng: Rng) -> Effect | None:
    if scene.robot.source != "command":
        return None
    common = scene.n == 1 or rng.random() < 0.5

    def law(s: float, g: Grid) -> Array:
        # A first-order drive gives what was asked less the time constant times the rate of what it gives.
        rate = s * np.gradient(g.tau, g.step, axis=0)
        return rate if common else on_joint(g, j, rate[:, j])

    def put(s: float) -> Rows:
        return needed(scene, scene.runs, lambda g: law(s, g))

    return Effect("actuator_lag", None if common else scene.joints[j], put, lambda s: {"time_constant": s}, 0.005, 0.04)


def rotor(scene: Scene, j: int, _: Rng) -> Effect | None:
    if scene.robot.source == "sensor":
        return None
    unit = scene.torque[j] / scene.push[j]
    return _acting(
        scene, "rotor_inertia", j, lambda s: {"inertia": s * unit}, lambda p, g: p["inertia"] * g.a[:, j], 0.1
    )


def _of_links(
    scene: Scene, name: str, joint: str | None, changed: Callable, told: Callable, start: float, most: float
) -> Effect:
    """An effect of a robot with other links or gravity; ``changed(s)`` is its model."""

    def put(s: float) -> Rows:
        other = changed(s)

        def law(g: Grid) -> Array:
            return body.torques(other, g.q, g.v, g.a) - body.torques(scene.robot.model, g.q, g.v, g.a)

        return needed(scene, scene.runs, law)

    return Effect(name, joint, put, told, start, most)


def payload(scene: Scene, _j: int, rng: Rng) -> Effect | None:
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
    rest, unit = scene.middle[j] + scene.reach[j] * rng.uniform(-1.0, 1.0), scene.torque[j] / scene.reach[j]
    return _acting(
        scene,
        "parasitic_spring",
        j,
        lambda s: {"stiffness": s * unit, "rest_position": rest},
        lambda p, g: p["stiffness"] * (g.q[:, j] - rest),
        0.1,
    )


def _reading(scene: Scene, j: int, read: Callable[[Array], Array]) -> Rows:
    """The logs of an encoder that reads otherwise."""
    out = []
    for run in scene.runs:
        q = run.q.copy()
        q[:, j] = read(q[:, j])
        out.append(replace(run, q=q))
    return tuple(out)


def encoder_offset(scene: Scene, j: int, rng: Rng) -> Effect | None:
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
    unit = 0.01 * scene.reach[j]
    return Effect(
        "encoder_quantization",
        scene.joints[j],
        lambda s: _reading(scene, j, lambda q: np.round(q / (s * unit)) * (s * unit)),
        lambda s: {"step": s * unit},
        0.2,
        3.0,
    )


EFFECTS: tuple[Law, ...] = (
    viscous,
    coulomb,
    by_direction,
    stribeck,
    presliding,
    loaded,
    coupling,
    cogging,
    torque_constant,
    torque_offset,
    input_delay,
    actuator_lag,
    rotor,
    payload,
    inertias,
    tilt,
    spring,
    encoder_offset,
    eccentricity,
    coarse,
)
