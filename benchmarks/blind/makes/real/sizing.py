"""How much of a recording an effect changes: what the model cannot explain of the change, in noise floors.

The residual is the torque of the log less what the links need for its positions, both below the end of the judged band.
Its change by an effect is the effect's own trace. The noise floor of a joint is what the corrected model leaves of part
two while nothing is added.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import lsq_linear

from benchmarks.blind.makes.real import body
from benchmarks.blind.makes.real.motion import even, low_passed
from benchmarks.blind.makes.real.scene import Effect, Rows, Scene
from benchmarks.gapbench.makes import enough_beyond

Array = np.ndarray
REACHED = 1.0 / 3.0  # of the largest gap: a joint beyond it is one that the effect reaches
EDGE = 1.0  # periods of the band's end: left out at both ends of a run, where the filter swings
SAMPLES = 2000  # of all runs together that fits are made on
INERTIA = FRICTION = 0.05  # stated tolerances, one sigma
LEAST = 1.0  # noise floors: what leaves less is no effect
CLOSE = 1.1  # factor within which a size counts as reached
TRIES = 10


@dataclass(frozen=True)
class Ruler:
    """Part two as it was recorded, thinned, with the doubts of its model.

    Attributes:
        scene: Part two.
        floor: Noise floor of each joint [N m or N], shape ``(n,)``.
        regressor: Torques per unit of each inertial parameter at the kept samples, shape ``(K, n, 10 n)``.
        q, v, a, tau, side: Of the kept samples, shape ``(K, n)``.
        doubt: What one sigma of each tolerance does, shape ``(K, n, m)``.
    """

    scene: Scene
    floor: Array
    regressor: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    side: Array
    doubt: Array


def kept(scene: Scene, k: int) -> slice:
    """Samples of a run's grid that are judged."""
    grid = scene.grids[k]
    edge = int(EDGE / (scene.band * grid.step))
    every = max(1, sum(len(g.t) for g in scene.grids) // SAMPLES)
    return slice(edge, len(grid.t) - edge, every)


def in_band(scene: Scene, values: Callable[[int], Array]) -> Array:
    """Values on the grids, given by the number of the run, below the end of the band and at the kept samples."""
    return np.concatenate(
        [low_passed(values(k), g.step, scene.band)[kept(scene, k)] for k, g in enumerate(scene.grids)]
    )


def ruler(scene: Scene, floor: Array) -> Ruler:
    """The ruler of part two."""
    model = scene.robot.model
    grids = [even(run, scene.band) for run in scene.runs]
    q, v, a, tau = (
        np.concatenate([getattr(g, name)[kept(scene, k)] for k, g in enumerate(grids)])
        for name in ("q", "v", "a", "tau")
    )
    side = in_band(scene, lambda k: scene.grids[k].side)
    columns = body.regressor(model, q, v, a)
    inertial = columns @ body.tolerated(model, INERTIA)
    dry, viscous = (
        FRICTION * level * np.eye(scene.n) * x[:, :, None]
        for level, x in ((scene.robot.dry, side), (scene.robot.viscous, v))
    )
    return Ruler(scene, floor, columns, q, v, a, tau, side, np.concatenate([inertial, dry, viscous], axis=2))


def change(by: Ruler, before: Rows, after: Rows) -> Array:
    """What the change of the logs does to the residual [N m or N], shape ``(K, n)``."""
    scene, out = by.scene, []
    for k, (old, new) in enumerate(zip(before, after, strict=True)):
        grid, where = scene.grids[k], kept(scene, k)
        more = low_passed(CubicSpline(old.t, new.tau - old.tau)(grid.t), grid.step, scene.band)[where]
        if not np.array_equal(old.q, new.q):
            first, second = even(old, scene.band), even(new, scene.band)
            more = more - (
                body.torques(scene.robot.model, second.q[where], second.v[where], second.a[where])
                - body.torques(scene.robot.model, first.q[where], first.v[where], first.a[where])
            )
        out.append(more)
    return np.concatenate(out)


def each(by: Ruler, changed: Array) -> Array:
    """Root mean square of a change at each joint [noise floors], shape ``(n,)``."""
    return np.sqrt(np.mean(changed**2, axis=0)) / by.floor


def gap(by: Ruler, changed: Array) -> float:
    """Root mean square of a change over the joints that it reaches [noise floors]."""
    x = each(by, changed)
    return float(np.sqrt(np.mean(x[x >= REACHED * x.max()] ** 2)))


def stacked(by: Ruler, columns: Array) -> Array:
    """Columns of shape ``(K, n, m)`` in noise floors, shape ``(K n, m)``."""
    return (columns / by.floor[:, None]).reshape(-1, columns.shape[2])


def beyond_tolerance(by: Ruler, changed: Array) -> float:
    """What the model moved by two sigma at most leaves of a change [noise floors, of the joints that it reaches]."""
    doubt, wanted = stacked(by, by.doubt), stacked(by, changed[:, :, None])[:, 0]
    doubt = doubt[:, np.abs(doubt).max(axis=0) > 1e-6]
    left = wanted
    if doubt.shape[1]:
        left = wanted - doubt @ lsq_linear(doubt, wanted, bounds=(-2.0, 2.0), max_iter=60).x
    share = float(np.sqrt(np.mean(left**2) / max(np.mean(wanted**2), 1e-30)))
    return min(share, 1.0) * gap(by, changed)


@dataclass(frozen=True)
class Sized:
    """An effect with its strength and what it changes, shape ``(K, n)`` [N m or N]."""

    effect: Effect
    size: float
    changed: Array
    gap: float
    beyond: float


def sized(by: Ruler, effect: Effect, target: float, *, judged: bool = True) -> Sized | None:
    """Looks for the strength that leaves a gap [noise floors]; None where none that makes sense does.

    Args:
        by: The ruler of part two.
        effect: To be sized.
        target: Gap to reach [noise floors].
        judged: The catalogue has it, so that it must also be more than the tolerances explain.
    """
    size, least, best = min(effect.start, effect.most), 0.0, None
    for _ in range(TRIES):
        changed = change(by, by.scene.runs, effect.put(size))
        reached = gap(by, changed)
        if reached < 1e-6:
            return None
        beyond = beyond_tolerance(by, changed) if judged else reached
        best = Sized(effect, size, changed, reached, beyond)
        if judged and not enough_beyond(reached, beyond):
            least = 1.5 * size
        wanted = min(max(size * float(np.clip(target / reached, 0.02, 50.0)), least), effect.most)
        if 1.0 / CLOSE < wanted / size < CLOSE:
            break
        size = wanted
    if best is None or best.gap < LEAST or not enough_beyond(best.gap, best.beyond):
        return None
    return best
