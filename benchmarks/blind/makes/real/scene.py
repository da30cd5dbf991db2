"""Part two of a recording with the typical sizes of its motion, and effects that can be added to its logs."""

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
    """Part two of a recording without an added effect, with the typical sizes of its motion, each of shape ``(n,)``.

    Attributes:
        robot: The corrected model.
        joints: Names of the joints from the base outwards.
        runs: The recorded logs.
        grids: The same logs at uniform times.
        band: End of the judged band [Hz].
        torque: Root mean square of each joint's torque [N m or N].
        speed: Top speed (99th percentile) [rad/s or m/s].
        usual: Root mean square of the speed [rad/s or m/s].
        middle: Middle of the range of motion [rad or m].
        reach: Half of the range of motion [rad or m].
        push: Root mean square of the acceleration [rad/s^2 or m/s^2].
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
    """Compute the typical sizes of part two."""
    q, v, a, tau = (np.concatenate([getattr(g, x) for g in grids]) for x in ("q", "v", "a", "tau"))
    low, high = q.min(axis=0), q.max(axis=0)

    def rms(x: Array) -> Array:
        return np.sqrt(np.mean(x**2, axis=0))

    return Scene(
        robot,
        joints,
        runs,
        grids,
        band,
        torque=rms(tau),
        speed=np.quantile(np.abs(v), 0.99, axis=0),
        usual=rms(v),
        middle=0.5 * (low + high),
        reach=0.5 * (high - low),
        push=rms(a),
    )


@dataclass(frozen=True)
class Effect:
    """One effect whose strength is still free.

    Attributes:
        name: Name of the effect in the catalogue.
        joint: The joint, ``a+b`` for a coupling, None for the whole robot.
        put: Function that gives the logs with the effect at a strength.
        parameters: Function that gives the effect's parameters at a strength.
        start: Strength with which the search begins.
        most: Largest plausible strength.
    """

    name: str
    joint: str | None
    put: Callable[[float], Rows]
    parameters: Callable[[float], Parameters]
    start: float
    most: float = np.inf


Law = Callable[[Scene, int, Rng], Effect | None]


def needed(scene: Scene, runs: Rows, torque: Callable[[Grid], Array]) -> Rows:
    """The logs with an additional torque of the drives, which ``torque`` computes for each grid, shape ``(M, n)``."""
    return tuple(
        replace(run, tau=run.tau + at_rows(run, grid, torque(grid)))
        for run, grid in zip(runs, scene.grids, strict=True)
    )


def on_joint(grid: Grid, j: int, values: Array) -> Array:
    """Torques ``(M, n)`` with the given values on one joint and zero on all others."""
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
    """An effect that adds ``law(parameters, grid)``, shape ``(M,)``, to the torque of one joint's drive."""

    def put(s: float) -> Rows:
        p = parameters(s)
        return needed(scene, scene.runs, lambda grid: on_joint(grid, j, law(p, grid)))

    return Effect(name, scene.joints[j], put, parameters, start, most)
