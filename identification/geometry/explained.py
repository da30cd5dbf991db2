"""The line of a fit of poses: start, noise, poses that stray, search, and the fit again where the slopes have moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.geometry.equations import Equations, Estimate, Problem
from identification.geometry.fit import fitted, start_of
from identification.geometry.search import Fits, chosen_terms, fits_of, price_of
from identification.geometry.whitened import BLOCKS, Noise, Whitened, noise_of, whitened
from phantom_dyn.array_types import Bool, Int

Array = np.ndarray

_ROUNDS = 5
_FAR = 6.0
"""Noises from which on a pose is no measurement of the target: in a thousand poses none is by chance beyond 5."""
_MOST_FAR = 0.05


@dataclass(frozen=True)
class ExplainedPoses:
    """A fit of poses by few terms.

    Attributes:
        problem: Poses and terms.
        estimate: Nuisances and the terms that were found; others are zero.
        found: Equations there.
        noise: Of the poses.
        equations: In units of noise, as if no term had been taken in.
        fits: Their products.
        price: Squares that a term has to explain.
        chosen: Places of the terms that were found.
        kept: False for rows of poses that stray, ``(m,)``.
    """

    problem: Problem
    estimate: Estimate
    found: Equations
    noise: Noise
    equations: Whitened
    fits: Fits
    price: float
    chosen: tuple[int, ...]
    kept: Bool[Array, " m"]


def explained_poses(problem: Problem) -> ExplainedPoses:
    """The few terms that explain poses, with what it rests on.

    Args:
        problem: Poses and all that may be wrong.
    """
    units, names = [term.unit for term in problem.terms], [_name(k, problem) for k in range(len(problem.terms))]
    moving = np.repeat([one.moving for one in problem.sets], 2)
    weights = np.ones(2 * len(problem.sets))
    estimate, found = fitted(problem, start_of(problem), (), weights)
    kept = np.ones(len(found.left), dtype=bool)
    block = _blocks(problem, found)
    chosen: tuple[int, ...] = ()
    tried: list[tuple[int, ...]] = []
    for turn in range(_ROUNDS):
        noise = noise_of(found, units, names, moving, kept)
        if turn == 1:
            kept = _without_strays(found, noise, kept)
            noise = noise_of(found, units, names, moving, kept)
        equations = whitened(found, estimate.values, noise, block, kept, (units, names))
        fits = fits_of(equations, problem.terms)
        price = price_of(equations.rank, noise.free)
        now = chosen_terms(fits, price)
        if now == chosen and turn > 1:
            break
        if now in tried[:-1] and turn > 2:
            break
        chosen = now
        tried.append(now)
        values = np.zeros(len(problem.terms))
        values[list(chosen)] = estimate.values[list(chosen)]
        start = Estimate(values, estimate.base, estimate.tool, estimate.delay)
        estimate, found = fitted(problem, start, chosen, noise.weights, kept)
    noise = noise_of(found, units, names, moving, kept)
    equations = whitened(found, estimate.values, noise, block, kept, (units, names))
    fits = fits_of(equations, problem.terms)
    return ExplainedPoses(
        problem, estimate, found, noise, equations, fits, price_of(equations.rank, noise.free), chosen, kept
    )


def _name(k: int, problem: Problem) -> str:
    term = problem.terms[k]
    return f"{term.joint}.{term.effect}.{term.parameter}"


def _blocks(problem: Problem, found: Equations) -> Int[Array, " m"]:
    """Block of each row: stretches of a recording from its beginning to its end, frames of a recording alike."""
    of_pose = np.concatenate(
        [BLOCKS * one.recording + np.arange(len(one.t)) * BLOCKS // len(one.t) for one in problem.sets]
    )
    return of_pose[found.pose]


def _without_strays(found: Equations, noise: Noise, kept: Bool[Array, " m"]) -> Bool[Array, " m"]:
    """Rows without poses that lie far from all others; all, where there are many: then it is no matter of a few."""
    size = np.abs(found.left) / np.array([_spread(found, s) for s in range(len(noise.sigma))])[found.series]
    far = np.unique(found.pose[size > _FAR])
    if len(far) > _MOST_FAR * len(np.unique(found.pose)):
        return kept
    return kept & ~np.isin(found.pose, far)


def _spread(found: Equations, series: int) -> float:
    """Standard deviation of what is left in a series, by the median, which a few strays do not move."""
    values = np.abs(found.left[found.series == series])
    return max(1.4826 * float(np.median(values)), 1e-300) if len(values) else 1.0
