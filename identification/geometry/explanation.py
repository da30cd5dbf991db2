"""Explanation of measured poses: noise, outliers and a search for few terms, repeated as the linearisation changes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.engine.chance import squares_by_chance
from identification.engine.search.few_columns import SetFits, few_columns, set_fits, until_same_set
from identification.geometry.equations import Equations, Estimate, PoseProblem
from identification.geometry.fit import fitted, start_of
from identification.geometry.terms import PoseTerm, bounds_of
from identification.geometry.whitened import BLOCKS, Noise, Whitened, noise_of, whitened
from phantom_dyn.array_types import Array, Bool, Int

CHANCE = 0.005
"""Probability that in a robot without a gap chance puts the best of all terms above its price."""
_FAR = 6.0
"""Residual, in units of the noise, of an outlier: in a thousand poses none is beyond 5 by chance."""
_MOST_FAR = 0.05


@dataclass(frozen=True)
class ExplainedPoses:
    """A fit of poses by few terms.

    Attributes:
        problem: Poses and terms.
        estimate: Nuisances and the chosen terms; others are zero.
        found: Equations there.
        noise: Of the poses.
        equations: In units of noise, with the residual before any term.
        fits: Their products.
        price: Squares that a term has to explain.
        chosen: Places of the chosen terms.
        kept: False for rows of outliers, ``(m,)``.
    """

    problem: PoseProblem
    estimate: Estimate
    found: Equations
    noise: Noise
    equations: Whitened
    fits: SetFits
    price: float
    chosen: tuple[int, ...]
    kept: Bool[Array, " m"]


@dataclass(frozen=True)
class _At:
    """A fit of poses at which columns are computed: its estimate, the equations there, and the rows that are used."""

    estimate: Estimate
    found: Equations
    kept: Bool[Array, " m"]
    noise: Noise


def explain_poses(problem: PoseProblem) -> ExplainedPoses:
    """The few terms that explain poses, with the fit behind them.

    Args:
        problem: Poses and all candidate errors.
    """
    terms = problem.terms
    named = [term.unit for term in terms], [_name(term) for term in terms]
    moving = np.repeat([one.moving for one in problem.sets], 2)
    first = fitted(problem, start_of(problem), (), np.ones(2 * len(problem.sets)))
    block = _blocks(problem, first[1])

    def noise(at: _At) -> Noise:
        return noise_of(at.found, *named, moving, at.kept)

    def equations_at(at: _At) -> tuple[Whitened, SetFits, float]:
        equations = whitened(at.found, at.estimate.values, at.noise, block, at.kept, named)
        fits = set_fits(equations.columns, equations.left, bounds_of(terms), equations.seen)
        return equations, fits, squares_by_chance(equations.rank, at.noise.free, CHANCE)

    def search(at: _At, turn: int) -> tuple[_At, tuple[int, ...]]:
        at = replace(at, noise=noise(at))
        if turn == 1:
            at = replace(at, kept=_without_strays(at.found, at.noise, at.kept))
            at = replace(at, noise=noise(at))
        return at, few_columns(*equations_at(at)[1:])

    def retake(at: _At, chosen: tuple[int, ...]) -> _At:
        values = np.zeros(len(terms))
        values[list(chosen)] = at.estimate.values[list(chosen)]
        start = replace(at.estimate, values=values)
        estimate, found = fitted(problem, start, chosen, at.noise.weights, at.kept)
        return replace(at, estimate=estimate, found=found)

    every = np.ones(len(first[1].left), dtype=bool)
    at, chosen = until_same_set(_At(*first, every, noise_of(first[1], *named, moving, every)), search, retake)
    at = replace(at, noise=noise(at))
    return ExplainedPoses(problem, at.estimate, at.found, at.noise, *equations_at(at), chosen, at.kept)


def _name(term: PoseTerm) -> str:
    return f"{term.joint}.{term.effect}.{term.parameter}"


def _blocks(problem: PoseProblem, found: Equations) -> Int[Array, " m"]:
    """Block of each row: stretches of a recording from its beginning to its end, frames of a recording alike."""
    of_pose = np.concatenate(
        [BLOCKS * one.recording + np.arange(len(one.t)) * BLOCKS // len(one.t) for one in problem.sets]
    )
    return of_pose[found.pose]


def _without_strays(found: Equations, noise: Noise, kept: Bool[Array, " m"]) -> Bool[Array, " m"]:
    """Rows without outliers; all rows where so many poses are far off that they are no outliers."""
    size = np.abs(found.left) / np.array([_spread(found, s) for s in range(len(noise.sigma))])[found.series]
    far = np.unique(found.pose[size > _FAR])
    if len(far) > _MOST_FAR * len(np.unique(found.pose)):
        return kept
    return kept & ~np.isin(found.pose, far)


def _spread(found: Equations, series: int) -> float:
    """Standard deviation of the residual in a series, by its median, which a few outliers do not change."""
    values = np.abs(found.left[found.series == series])
    return max(1.4826 * float(np.median(values)), 1e-300) if len(values) else 1.0
