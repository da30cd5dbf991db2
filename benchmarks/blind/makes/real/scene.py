"""A part of a recording that gets an effect, and what an effect is: logs and parameters at a strength."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.blind.makes.real.body import Body
from benchmarks.blind.makes.real.motion import Grid, at_rows
from benchmarks.blind.makes.real.recordings import Run

Array = np.ndarray
Rng = np.random.Generator
Parameters = Mapping[str, object]
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
        parameters: Its parameters at a strength.
        start: Ordinary strength; ``most`` the largest that makes sense.
    """

    name: str
    joint: str | None
    put: Callable[[float], Rows]
    parameters: Callable[[float], Parameters]
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


def acting(
    scene: Scene,
    name: str,
    j: int,
    parameters: Callable[[float], dict],
    law: Callable[[dict, Grid], Array],
    start: float,
    most: float = np.inf,
) -> Effect:
    """An effect that adds ``law(parameters, run)`` to what one joint's drive has to give, shape ``(M,)``."""

    def put(s: float) -> Rows:
        p = parameters(s)
        return needed(scene, scene.runs, lambda grid: on_joint(grid, j, law(p, grid)))

    return Effect(name, scene.joints[j], put, parameters, start, most)
