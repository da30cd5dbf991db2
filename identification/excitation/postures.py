"""Postures in which a robot can rest within all its limits, or the limit that stands against it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.excitation.descent import MARGIN, descend
from identification.excitation.design_problem import Grid, Problem
from identification.excitation.starts import random_postures, rest, worst_excess
from phantom_dyn.errors import ParameterError

Array = np.ndarray

_TRIED = 6  # postures that are led towards the limits where none keeps them
_STILL = Grid(np.array([0.0, 1.0]), np.stack([np.ones((2, 1)), np.zeros((2, 1)), np.zeros((2, 1))]))


@dataclass(frozen=True)
class AnyMotion:
    """A criterion that every motion meets alike: what is left is to keep the limits."""

    def cost(self, G: Float[Array, "r r"]) -> tuple[float, Float[Array, "r r"]]:
        """Zero, and no slope."""
        return 0.0, np.zeros_like(G)


def feasible_postures(problem: Problem, rng: np.random.Generator) -> Float[Array, "n nv"]:
    """Postures in which the robot can rest, at least one, with a margin to every limit.

    Raises:
        ParameterError: If none is found: the sentence says which limit is broken most, and by how much at the least.
    """
    tried = random_postures(problem, rng)
    excess = worst_excess(problem, rest(tried), MARGIN)
    if (excess <= 0).any():
        return tried[excess <= 0]
    led = [
        descend(problem, _STILL, posture[None], rounds=4, iterations=40, criterion=AnyMotion())
        for posture in tried[np.argsort(excess)[:_TRIED]]
    ]
    found = np.concatenate(led)
    # A descent ends at the edge of the margin, from outside.
    excess = worst_excess(problem, rest(found), 0.5 * MARGIN)
    if (excess <= 0).any():
        return found[excess <= 0]
    best = rest(found[[int(np.argmin(excess))]])
    values = problem.limited(best, problem.regressor(best))
    raise ParameterError(
        f"{problem.robot.name} can rest in no posture that was found: in the best one {problem.bounds.worst(values)}; "
        "widen that limit, or another that stands against it."
    )
