"""Measures in noise floors how much an effect changes the residual of a recording, and chooses the effect's strength.

The residual is the logged torque minus the torque of the links for the logged motion, both below the end of the judged
band. The noise floor of a joint is the residual of the corrected model in part two without an added effect. Part of
the change may be within the tolerances of the model; only the rest can be found.
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
REACHED = 1.0 / 3.0  # an effect changes a joint if the joint's gap is at least this share of the largest gap
EDGE = 1.0  # periods of the band's end that are excluded at both ends of a run, where the filter has transients
SAMPLES = 2000  # number of samples in fits, over all runs
INERTIA = FRICTION = 0.05  # stated tolerances: one standard deviation, relative
LEAST = 1.0  # smallest gap of an effect [noise floors]
CLOSE = 1.1  # the search for a strength ends if the next strength differs by less than this factor
TRIES = 10  # largest number of strengths that are tried


@dataclass(frozen=True)
class Ruler:
    """Part two without an added effect, at fewer samples, with all that is needed to measure an effect.

    Attributes:
        scene: Part two.
        floor: Noise floor of each joint [N m or N], shape ``(n,)``.
        regressor: Torque per unit of each inertial parameter at the kept samples, shape ``(K, n, 10 n)``.
        q, v, a, tau, side: Motion, torque and direction of motion at the kept samples, shape ``(K, n)``.
        doubt: Torque by one standard deviation of each tolerance of the model [N m or N], shape ``(K, n, m)``.
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
    """The samples of the grid of run ``k`` that are used."""
    grid = scene.grids[k]
    edge = int(EDGE / (scene.band * grid.step))
    every = max(1, sum(len(g.t) for g in scene.grids) // SAMPLES)
    return slice(edge, len(grid.t) - edge, every)


def in_band(scene: Scene, values: Callable[[int], Array]) -> Array:
    """Values of all runs after the low pass of the band, at the kept samples; ``values(k)`` are those of run ``k``."""
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
    """Change of the residual if the logs ``before`` become the logs ``after`` [N m or N], shape ``(K, n)``."""
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
    """Root mean square of a change over the joints that it changes most, see `REACHED` [noise floors]."""
    x = each(by, changed)
    return float(np.sqrt(np.mean(x[x >= REACHED * x.max()] ** 2)))


def stacked(by: Ruler, columns: Array) -> Array:
    """Columns of shape ``(K, n, m)`` as columns in noise floors over all samples and joints, shape ``(K n, m)``."""
    return (columns / by.floor[:, None]).reshape(-1, columns.shape[2])


def beyond_tolerance(by: Ruler, changed: Array) -> float:
    """Part of `gap` that changes of the model by at most two standard deviations cannot explain [noise floors]."""
    doubt, wanted = stacked(by, by.doubt), stacked(by, changed[:, :, None])[:, 0]
    doubt = doubt[:, np.abs(doubt).max(axis=0) > 1e-6]
    residual = wanted
    if doubt.shape[1]:
        residual = wanted - doubt @ lsq_linear(doubt, wanted, bounds=(-2.0, 2.0), max_iter=60).x
    share = float(np.sqrt(np.mean(residual**2) / max(np.mean(wanted**2), 1e-30)))
    return min(share, 1.0) * gap(by, changed)


@dataclass(frozen=True)
class Sized:
    """An effect with its strength, its change of the residual ``(K, n)`` [N m or N], and its gap [noise floors]."""

    effect: Effect
    size: float
    changed: Array
    gap: float
    beyond: float


def sized(by: Ruler, effect: Effect, target: float, *, judged: bool = True) -> Sized | None:
    """The effect with the strength that gives a gap of about ``target``; None if no plausible strength does.

    Args:
        by: The ruler of part two.
        effect: The effect.
        target: Wanted gap [noise floors].
        judged: True for an effect of the catalogue; it has to be larger than the tolerances can explain.
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
