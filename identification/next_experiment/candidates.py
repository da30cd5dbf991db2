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
# Periods of slow triangles, which cover their range at little speed: what falls with speed shows there.
_SLOW = (1, 4)
# Amplitudes of small reversals, as a share of half the range.
_SMALL = (0.01, 0.15)
# Deviation of the logarithm of a joint's size from one variation to the next; single shapes vary by a third of it.
_VARIED = 0.5
# A motion is left out whose joints have less than three quarters, on average, of this share of their largest speed:
# joints that creep stick and slip, which no law of friction predicts, and what a plan promises of them does not come.
_LIVELY, _JOINTS = 0.125, 0.75
# Draws for each motion that is wanted, as many are not lively.
_DRAWS = 4


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


def candidates(problem: Problem, *, duration: float, count: int, rng: np.random.Generator) -> tuple[Candidate, ...]:
    """Random motions: Fourier series, fast and slow triangles, holds with small reversals, in turn.

    Args:
        problem: What moves within which limits, see `design_of`.
        duration: Length of each [s].
        count: How many at most; those that creep are left out, see `lively`.
        rng: Draws them.

    Raises:
        ParameterError: If the robot cannot rest anywhere within its limits.
    """
    postures = feasible_postures(problem, rng)
    draws = (_fourier, _triangles, _slow_triangles, _reversals)
    out: list[Candidate] = []
    for k in range(_DRAWS * count):
        one = draws[k % len(draws)](problem, postures, duration, rng)
        if lively(one, problem):
            out.append(one)
        if len(out) == count:
            break
    return tuple(out)


def design_of(robot: Robot, limits: Limits) -> Problem:
    """What motions are designed for; the base parameters of a large robot take a while, so make it once."""
    return Problem(robot, base_of(robot), ConditionNumber(), limits)


def varied(one: Candidate, problem: Problem, rng: np.random.Generator) -> Candidate:
    """A motion with other sizes of each joint and slightly other shapes, as large as the limits let it be."""
    nv = problem.robot.nv
    grid = Grid.of(one.shapes, one.shapes.samples)
    posture = grid.motion(one.weights).q.mean(axis=0)
    moving = one.weights.copy()
    moving[0] -= posture
    size = np.abs(moving).max(axis=0)
    moving = moving * np.exp(_VARIED * rng.normal(size=nv)) + _VARIED * size * rng.normal(size=moving.shape) / 3.0
    weights = moving.copy()
    weights[0] += posture
    return Candidate(one.kind, one.shapes, largest(problem, grid, weights, posture, _SHARES))


def lively(one: Candidate, problem: Problem) -> bool:
    """True if the joints move fast enough for laws of friction to hold, on average."""
    v = Grid.of(one.shapes, one.shapes.samples).motion(one.weights).v
    wanted = _LIVELY * problem.limits.velocity[list(problem.robot.tree_rows)]
    return float(np.minimum(np.sqrt(np.mean(v**2, axis=0)) / wanted, 1.0).mean()) >= _JOINTS


def _fourier(problem: Problem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    shapes = FourierSeries(duration, int(rng.integers(4, 11)))
    return Candidate("Fourier series", shapes, _random(problem, shapes, postures, rng))


def _triangles(problem: Problem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    shapes = TrianglesAndSines(duration, triangles=int(rng.integers(3, 9)), harmonics=3)
    return Candidate("triangles and sines", shapes, _random(problem, shapes, postures, rng))


def _slow_triangles(problem: Problem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    shapes = TrianglesAndSines(duration, triangles=int(rng.integers(*_SLOW)), harmonics=1)
    return Candidate("slow triangles", shapes, _random(problem, shapes, postures, rng))


def _random(problem: Problem, shapes: Shapes, postures: Array, rng: np.random.Generator) -> Float[Array, "K nv"]:
    """Random weights about the middle or about a random posture, each joint as large as its own limits let it be."""
    grid, sizes = Grid.of(shapes, shapes.samples), joint_sizes(problem)
    if rng.random() < 0.5:
        posture = postures[rng.integers(len(postures))]
    else:
        posture = postures[np.argmin(np.abs((postures - sizes.middle) / sizes.half).max(axis=1))]
    still = np.zeros((grid.values.shape[2], problem.robot.nv))
    still[0] = posture
    moving = undirected(problem, grid, rng)
    moved, rows = grid.values[0] @ moving, list(problem.robot.tree_rows)
    up = (problem.limits.upper[rows] - posture) / np.maximum(moved.max(axis=0), 1e-12)
    down = (posture - problem.limits.lower[rows]) / np.maximum(-moved.min(axis=0), 1e-12)
    return largest(problem, grid, still + moving * np.clip(0.97 * np.minimum(up, down), 0.0, 1.0), posture, _SHARES)


def _reversals(problem: Problem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    shapes = SmallReversals(duration, stops=int(rng.integers(3, 6)), reversals=int(rng.integers(3, 7)))
    sizes = joint_sizes(problem)
    nv = problem.robot.nv
    places = postures[rng.integers(len(postures), size=shapes.stops)]
    # The way to the next posture keeps the speed and acceleration of each joint.
    steps = np.maximum(np.abs(np.diff(places, axis=0)).max(axis=0), 1e-12)
    farthest = shapes.farthest(sizes.speed, problem.limits.acceleration)
    places = places[0] + np.minimum(1.0, 0.9 * farthest / steps) * (places - places[0])
    grid = Grid.of(shapes, shapes.samples)
    # So do the reversals, with room for the way to them.
    fastest, sharpest = (np.abs(grid.values[k, :, 1]).max() for k in (1, 2))
    small = np.exp(rng.uniform(*np.log(_SMALL), size=(shapes.stops, nv))) * sizes.half
    small = np.minimum(small, 0.5 * np.minimum(sizes.speed / fastest, problem.limits.acceleration / sharpest))
    weights = shapes.weights(places, small, rng.random(nv) < 0.5)
    return Candidate("holds with small reversals", shapes, largest(problem, grid, weights, places[0], _SHARES))
