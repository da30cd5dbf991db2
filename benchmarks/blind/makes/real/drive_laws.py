"""Effects of drives, added to recorded torques: cogging, torque constant, offset, delay, lag and rotor inertia."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.blind.makes.real.motion import Grid
from benchmarks.blind.makes.real.recordings import Run
from benchmarks.blind.makes.real.scene import Effect, Rng, Rows, Scene, acting, needed, on_joint

Array = np.ndarray


def cogging(scene: Scene, j: int, rng: Rng) -> Effect | None:
    """A torque that is a sine of the position of a revolute joint."""
    if scene.robot.linear[j]:
        return None
    # At least a dozen cycles within the motion, and at its usual speed within the judged band.
    least = int(np.ceil(12.0 * np.pi / scene.reach[j]))
    most = int(2.0 * np.pi * scene.band / scene.usual[j])
    if least > most:
        return None
    order, phase = int(rng.integers(least, min(most, 4 * least) + 1)), float(rng.uniform(-np.pi, np.pi))

    def parameters(s: float) -> dict:
        return {"order": [order], "amplitude": [s * scene.torque[j]], "phase": [phase]}

    # Cogging acts on the joint, so the drive has to give the opposite torque.
    return acting(
        scene, "cogging", j, parameters, lambda p, g: -p["amplitude"][0] * np.sin(order * g.q[:, j] + phase), 0.05
    )


def torque_constant(scene: Scene, j: int, rng: Rng) -> Effect | None:
    """A wrong torque constant, which scales the recorded torque of one joint."""
    if scene.robot.source == "sensor":
        return None  # a sensor measures the torque of the drive itself
    side = rng.choice((-1.0, 1.0))

    def put(s: float) -> Rows:
        # The true torque is the ratio times the recorded one.
        scale = np.ones(scene.n)
        scale[j] = 1.0 / (1.0 + side * s)
        return tuple(replace(run, tau=run.tau * scale) for run in scene.runs)

    return Effect("torque_constant", scene.joints[j], put, lambda s: {"ratio": 1.0 + side * s}, 0.1, 0.45)


def torque_offset(scene: Scene, j: int, rng: Rng) -> Effect:
    """A constant torque on a joint."""
    unit = rng.choice((-1.0, 1.0)) * scene.torque[j]
    return acting(
        scene, "torque_offset", j, lambda s: {"torque": s * unit}, lambda p, g: np.full(len(g.t), -p["torque"]), 0.05
    )


def _advanced(run: Run, time: float, which: slice | int) -> Array:
    """Torques with some columns shifted to an earlier time by ``time`` seconds, shape ``(N, n)``."""
    tau = run.tau.copy()
    columns = range(tau.shape[1]) if isinstance(which, slice) else (which,)
    for k in columns:
        tau[:, k] = np.interp(run.t + time, run.t, run.tau[:, k])
    return tau


def input_delay(scene: Scene, j: int, rng: Rng) -> Effect | None:
    """A delay between commanded and true torque, of one joint or of all."""
    if scene.robot.source != "command":
        return None  # a measured torque is delayed already
    common = scene.n == 1 or rng.random() < 0.5
    which = slice(None) if common else j

    def put(s: float) -> Rows:
        # The true torque follows the command later, so the command was logged earlier than the torque acts.
        return tuple(replace(run, tau=_advanced(run, s, which)) for run in scene.runs)

    return Effect("input_delay", None if common else scene.joints[j], put, lambda s: {"delay": s}, 0.005, 0.04)


def actuator_lag(scene: Scene, j: int, rng: Rng) -> Effect | None:
    """A first-order lag between commanded and true torque, of one joint or of all."""
    if scene.robot.source != "command":
        return None
    common = scene.n == 1 or rng.random() < 0.5

    def law(s: float, g: Grid) -> Array:
        # The command of a first-order drive is its torque plus the time constant times the rate of its torque.
        rate = s * np.gradient(g.tau, g.step, axis=0)
        return rate if common else on_joint(g, j, rate[:, j])

    def put(s: float) -> Rows:
        return needed(scene, scene.runs, lambda g: law(s, g))

    return Effect("actuator_lag", None if common else scene.joints[j], put, lambda s: {"time_constant": s}, 0.005, 0.04)


def rotor(scene: Scene, j: int, _: Rng) -> Effect | None:
    """A rotor inertia that the model lacks."""
    if scene.robot.source == "sensor":
        return None
    unit = scene.torque[j] / scene.push[j]
    return acting(
        scene, "rotor_inertia", j, lambda s: {"inertia": s * unit}, lambda p, g: p["inertia"] * g.a[:, j], 0.1
    )
