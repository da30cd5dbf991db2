"""Causes outside the catalogue, added to the torque of one joint over the whole of part two."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.blind.makes.real.motion import at_rows
from benchmarks.blind.makes.real.scene import Effect, Rng, Rows, Scene

Array = np.ndarray


def _times(scene: Scene) -> list[Array]:
    """Time of each sample since the beginning of part two [s], as if its runs followed each other without a pause."""
    lengths = [g.t[-1] + g.step for g in scene.grids]
    return [g.t + before for g, before in zip(scene.grids, np.cumsum([0.0, *lengths[:-1]]), strict=True)]


def _put(scene: Scene, j: int, more: list[Array]) -> Rows:
    """The logs with an additional torque of one joint's drive, given as one array per run."""
    out = []
    for run, grid, values in zip(scene.runs, scene.grids, more, strict=True):
        added = np.zeros((len(grid.t), scene.n))
        added[:, j] = values
        out.append(replace(run, tau=run.tau + at_rows(run, grid, added)))
    return tuple(out)


def warm_up(scene: Scene, j: int, rng: Rng) -> Effect:
    """Coulomb friction that decays exponentially, minus its mean over time."""
    times = _times(scene)
    end = times[-1][-1]
    slow = rng.uniform(0.2, 0.45) * end
    mean = slow / end * (1.0 - np.exp(-end / slow))
    shape = [(np.exp(-t / slow) - mean) * g.side[:, j] for t, g in zip(times, scene.grids, strict=True)]
    unit = scene.torque[j]
    return Effect(
        "friction_warm_up",
        scene.joints[j],
        lambda s: _put(scene, j, [s * unit * x for x in shape]),
        lambda s: {"torque": s * unit, "time": slow},
        0.1,
    )


def shaker(scene: Scene, j: int, rng: Rng) -> Effect:
    """A sine of a frequency inside the judged band."""
    frequency, phase = rng.uniform(0.15, 0.8) * min(scene.band, 10.0), rng.uniform(-np.pi, np.pi)
    shape = [np.sin(2.0 * np.pi * frequency * t + phase) for t in _times(scene)]
    unit = scene.torque[j]
    return Effect(
        "shaker",
        scene.joints[j],
        lambda s: _put(scene, j, [s * unit * x for x in shape]),
        lambda s: {"amplitude": s * unit, "frequency": frequency},
        0.1,
    )


def drifting_offset(scene: Scene, j: int, _: Rng) -> Effect:
    """A torque that changes linearly from one value to its opposite."""
    times = _times(scene)
    shape = [2.0 * t / times[-1][-1] - 1.0 for t in times]
    unit = scene.torque[j]
    return Effect(
        "drifting_offset",
        scene.joints[j],
        lambda s: _put(scene, j, [s * unit * x for x in shape]),
        lambda s: {"torque": s * unit},
        0.1,
    )


CAUSES = (warm_up, shaker, drifting_offset)
