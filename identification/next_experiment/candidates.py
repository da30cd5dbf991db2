"""Motions that a robot may be asked to record next: random ones of several kinds, all within its limits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.excitation.base import base_of
from identification.excitation.criteria import ConditionNumber
from identification.excitation.limits import Limits
from identification.excitation.postures import feasible_postures
from identification.excitation.problem import Grid, Problem
from identification.excitation.shapes import FourierSeries, Shapes, TrianglesAndSines
from identification.excitation.starts import joint_sizes, largest, undirected
from identification.next_experiment.small_reversals import SmallReversals
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray

# Sizes of a motion about its posture that are tried, the largest first.
_SHARES = tuple(np.geomspace(1.0, 0.02, 14).tolist())
# Speeds of slow triangles, as a share of the fastest: what falls with speed shows there.
_SLOW = 0.15
# Amplitudes of small reversals, as a share of half the range.
_SMALL = (0.01, 0.15)


@dataclass(frozen=True)
class Candidate:
    """A motion from rest to rest.

    Attributes:
        kind: What it is, in words.
        shapes: Its family.
        weights: Of the shapes, ``(K, nv)``.
    """

    kind: str
    shapes: Shapes
    weights: Float[Array, "K nv"]

    def motion(self, rate_hz: float) -> Motion:
        """The motion in equal steps, as near to the rate as ends on the last one."""
        return Grid.of(self.shapes, round(self.shapes.duration * rate_hz) + 1).motion(self.weights)


def candidates(
    robot: Robot, limits: Limits, *, duration: float, count: int, rng: np.random.Generator
) -> tuple[Candidate, ...]:
    """Random motions: Fourier series, fast and slow triangles, holds with small reversals, in turn.

    Args:
        robot: What moves.
        limits: What every one of them keeps.
        duration: Length of each [s].
        count: How many; those that cannot move within the limits are left out.
        rng: Draws them.

    Raises:
        ParameterError: If the robot cannot rest anywhere within its limits.
    """
    problem = Problem(robot, base_of(robot), ConditionNumber(), limits)
    postures = feasible_postures(problem, rng)
    draws = (_fourier, _triangles, _slow_triangles, _reversals)
    tried = [draws[k % len(draws)](problem, postures, duration, rng) for k in range(count)]
    return tuple(one for one in tried if np.abs(one.weights[1:]).max() > 0)


def _fourier(problem: Problem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    shapes = FourierSeries(duration, int(rng.integers(4, 11)))
    return Candidate("Fourier series", shapes, _random(problem, shapes, postures, rng))


def _triangles(problem: Problem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    shapes = TrianglesAndSines(duration, triangles=int(rng.integers(3, 9)), harmonics=3)
    return Candidate("triangles and sines", shapes, _random(problem, shapes, postures, rng))


def _slow_triangles(problem: Problem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    shapes = TrianglesAndSines(duration, triangles=int(rng.integers(4, 13)), harmonics=1)
    weights = _random(problem, shapes, postures, rng)
    weights[1:] *= rng.uniform(_SLOW, 0.6)
    return Candidate("slow triangles", shapes, weights)


def _random(problem: Problem, shapes: Shapes, postures: Array, rng: np.random.Generator) -> Float[Array, "K nv"]:
    """Random weights as large as the limits let them be."""
    grid = Grid.of(shapes, shapes.samples)
    posture = postures[rng.integers(len(postures))]
    still = np.zeros((grid.values.shape[2], problem.robot.nv))
    still[0] = posture
    return largest(problem, grid, still + undirected(problem, grid, rng), posture, _SHARES)


def _reversals(problem: Problem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    shapes = SmallReversals(duration, stops=int(rng.integers(3, 6)), reversals=int(rng.integers(3, 7)))
    sizes = joint_sizes(problem)
    nv = problem.robot.nv
    places = postures[rng.integers(len(postures), size=shapes.stops)]
    small = np.exp(rng.uniform(*np.log(_SMALL), size=(shapes.stops, nv))) * sizes.half
    # A triangle covers four amplitudes a period.
    small = np.minimum(small, 0.2 * sizes.speed * shapes.period)
    weights = shapes.weights(places, small, rng.random(nv) < 0.5)
    grid = Grid.of(shapes, shapes.samples)
    return Candidate("holds with small reversals", shapes, largest(problem, grid, weights, places[0], _SHARES))
