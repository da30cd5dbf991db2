"""Candidate motions of the next experiment: random Fourier series, triangles and small reversals within safe limits.

The limits are those of the robot's files, narrowed to little more than the range of the recordings. Motions that stop
in several postures, with small reversals about each, excite friction and backlash.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.data.log import Log
from identification.excitation.closable import CLEAR
from identification.excitation.criteria import ConditionNumber, DOptimality
from identification.excitation.descent import (
    constant_weights,
    descend,
    feasible_postures,
    nearest_within_limits,
    random_weights,
)
from identification.excitation.design_problem import DesignProblem, Grid, base_of, joint_sizes
from identification.excitation.limits import Limits, require_excitable, stated_limits
from identification.excitation.motion_shapes import FourierSeries, Shapes, Triangle, TrianglesAndSines
from identification.excitation.tree_gradient import singularity_distance
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion, minimum_jerk
from phantom_dyn.number_checks import require_positive

# A joint may leave its recorded range by this share of the range, at either end.
_RANGE_MARGIN = 0.5
# Limits of speed, acceleration and torque, as multiples of the largest recorded values.
_SPEED_RATIO, _ACCELERATION_RATIO, _TORQUE_RATIO = 2.0, 3.0, 2.0
# Recorded ranges, speeds and so on count as at least this large, so that a joint that was held may move a little.
_LEAST_SIZE = 1e-4
# Share of a stop's duration in which the robot moves to the posture.
_TRAVEL_SHARE = 0.3
# Share of the remaining duration in which the reversals grow from zero, and in which they decrease to zero.
_FADE_SHARE = 0.15
# Largest first and second derivative of the minimum-jerk transition from zero to one in a unit of time.
_RISE_SPEED, _RISE_ACCELERATION = 1.875, 10.0 / np.sqrt(3.0)
# Share of a period of a triangle in which its direction changes.
_TURN_SHARE = 0.2
# Relative sizes of a motion about its posture that are tried in turn until one keeps the limits.
_TRIED_SIZES = tuple(np.geomspace(1.0, 0.02, 14).tolist())
# Range of the number of periods of slow triangles (the end is excluded). They cover a wide range at low speed, and show
# effects that decrease with speed.
_SLOW_PERIODS = (1, 4)
# Amplitudes of small reversals, as shares of half the range. With smaller amplitudes a joint with friction would not
# move for a part of the time, and the recording would show less than planned.
_REVERSAL_SIZES = (0.1, 0.5)
# Standard deviation of the logarithm of a joint's size between variations; single shapes vary by a third of it.
_SIZE_DEVIATION = 0.5
# A joint moves fast enough if its RMS speed is `_FAST_ENOUGH` of its limit. A motion is used if the ratio to that
# speed, limited to 1, is at least `_LEAST_MEAN_RATIO` on average over the joints. Slower joints stick and slip, which
# no law of friction predicts, so that the rivals would not be separated as planned.
_FAST_ENOUGH, _LEAST_MEAN_RATIO = 0.125, 0.75
# Exciting motion: number of harmonics, number of random motions (the best one is improved), and numbers of rounds and
# iterations of the descent.
_HARMONICS, _STARTS, _ROUNDS, _ITERATIONS = 5, 4, 3, 12
# Number of random draws for each wanted motion; many draws are too slow.
_DRAWS = 4


def safe_limits(robot: Robot, logs: tuple[Log, ...]) -> Limits:
    """Limits of the robot's files, narrowed to the range that the recordings have shown to be safe.

    Raises:
        RobotError: If the robot has a joint that no reference can drive.
        ParameterError: If the stated limits exclude what was recorded.
    """
    require_excitable(robot, ())
    stated, rows = stated_limits(robot), list(robot.tree_rows)
    q = np.concatenate([log.motion.q for log in logs])
    reach = np.maximum(np.ptp(q, axis=0), _LEAST_SIZE)
    lower, upper, velocity = np.array(stated.lower), np.array(stated.upper), np.array(stated.velocity)
    lower[rows] = np.maximum(lower[rows], q.min(axis=0) - _RANGE_MARGIN * reach)
    upper[rows] = np.minimum(upper[rows], q.max(axis=0) + _RANGE_MARGIN * reach)
    velocity[rows] = np.minimum(velocity[rows], _SPEED_RATIO * _largest([log.motion.v for log in logs]))
    # The torque of a joint that was held may be near zero: it is allowed to overcome at least the joint's friction.
    safe_torque = np.maximum(
        _TORQUE_RATIO * _largest([log.band(log.tau) for log in logs]), 2.0 * np.array(robot.coulomb_friction)
    )
    torque = np.minimum(stated.torque, safe_torque)
    acceleration = _ACCELERATION_RATIO * _largest([log.motion.a for log in logs])
    return Limits(lower, upper, velocity, acceleration, torque, clear=_clearance(robot, logs))


def _clearance(robot: Robot, logs: tuple[Log, ...]) -> float:
    """Distance from a singularity that a motion has to keep; smaller if the recordings were nearer to a singularity."""
    recorded = [singularity_distance(robot, log.motion) for log in logs]
    return float(np.clip(min(float(each.min(initial=CLEAR)) for each in recorded), 0.01, CLEAR))


def _largest(series: list[Float[Array, "_ nv"]]) -> Float[Array, " nv"]:
    """Nearly the largest absolute value of each column (99.5 %, so that single noisy samples do not count)."""
    return np.maximum(np.percentile(np.abs(np.concatenate(series)), 99.5, axis=0), _LEAST_SIZE)


@dataclass(frozen=True)
class SmallReversals:
    """Shapes of a motion that stops in several postures and makes small reversals about each.

    One shape leads to each posture except the first, and two shapes are triangular waves about each posture: one with
    ``reversals`` periods, one with half as many. Joints that use different waves reverse at different times.

    Attributes:
        duration: Duration [s].
        stops: Number of postures.
        reversals: Periods of the faster triangle at each posture.
    """

    duration: float
    stops: int = 4
    reversals: int = 4

    def __post_init__(self):
        require_positive("the motion", duration=self.duration)
        if self.stops < 1 or self.reversals < 2:
            raise ParameterError(
                f"{self.stops} postures with {self.reversals} reversals were asked for: give at least 1 with 2."
            )

    @property
    def samples(self) -> int:
        """Number of samples from which the extremes of the motion are known."""
        return 20 * self.reversals * self.stops

    @property
    def stop(self) -> float:
        """Duration of one stop, including the motion to its posture [s]."""
        return self.duration / self.stops

    def farthest(self, velocity: Float[Array, " nv"], acceleration: Float[Array, " nv"]) -> Float[Array, " nv"]:
        """Largest distance between two successive postures [rad or m] within the limits, shape ``(nv,)``."""
        length = _TRAVEL_SHARE * self.stop
        return np.minimum(velocity * length / _RISE_SPEED, acceleration * length**2 / _RISE_ACCELERATION)

    def values(self, t: Float[Array, " N"]) -> Float[Array, "3 N K"]:
        """Position, velocity and acceleration of a constant, and of the shapes of each stop, ``(3, N, K)``."""
        constant = np.stack([np.ones(len(t)), np.zeros(len(t)), np.zeros(len(t))])
        shapes = [constant]
        for k in range(self.stops):
            start, travel = k * self.stop, _TRAVEL_SHARE * self.stop
            if k:
                shapes.append(_rise(t, start, travel))
            shapes += [self._fading_wave(t, start + travel, n) for n in (self.reversals, self.reversals // 2)]
        return np.stack(shapes, axis=2)

    def weights(self, postures: Float[Array, "s nv"], sizes: Float[Array, "s nv"], slow: Array) -> Float[Array, "K nv"]:
        """Weights of a motion through postures, shape ``(K, nv)``.

        Args:
            postures: Posture of each stop [rad or m], shape ``(s, nv)``.
            sizes: Amplitudes of the reversals at each stop [rad or m], shape ``(s, nv)``.
            slow: True for joints that use the wave with fewer periods, shape ``(nv,)``.
        """
        rows = [postures[0]]
        for k in range(self.stops):
            if k:
                rows.append(postures[k] - postures[k - 1])
            rows += [np.where(slow, 0.0, sizes[k]), np.where(slow, sizes[k], 0.0)]
        return np.array(rows)

    def _fading_wave(self, t: Float[Array, " N"], start: float, periods: int) -> Float[Array, "3 N"]:
        """A triangular wave of unit amplitude that grows from zero and decreases to zero."""
        length = (1.0 - _TRAVEL_SHARE) * self.stop
        wave = Triangle(1.0, periods / length, 0.0, _TURN_SHARE).motion(t - start)
        up = _rise(t, start, _FADE_SHARE * length)
        down = _rise(t, start + (1.0 - _FADE_SHARE) * length, _FADE_SHARE * length)
        return _product(up - down, wave)


def _rise(t: Float[Array, " N"], start: float, length: float) -> Float[Array, "3 N"]:
    """Minimum-jerk transition from zero to one, with its derivatives."""
    x, v, a = minimum_jerk(np.clip((t - start) / length, 0.0, 1.0))
    return np.stack([x, v / length, a / length**2])


def _product(f: Float[Array, "3 N"], g: Float[Array, "3 N"]) -> Float[Array, "3 N"]:
    """Product of two functions with its first two derivatives, from the functions with their derivatives."""
    return np.stack([f[0] * g[0], f[1] * g[0] + f[0] * g[1], f[2] * g[0] + 2.0 * f[1] * g[1] + f[0] * g[2]])


@dataclass(frozen=True)
class Candidate:
    """A motion from rest to rest.

    Attributes:
        kind: Description in words.
        shapes: Family of the motion.
        weights: Weights of the shapes, shape ``(K, nv)``.
    """

    kind: str
    shapes: Shapes
    weights: Float[Array, "K nv"]

    def motion(self, rate_hz: float) -> Motion:
        """The motion in equal steps that include its end, at the rate nearest to ``rate_hz``."""
        return Grid.of(self.shapes, round(self.shapes.duration * rate_hz) + 1).motion(self.weights)


def candidates(
    problem: DesignProblem, *, duration: float, count: int, rng: np.random.Generator
) -> tuple[Candidate, ...]:
    """Random motions of four kinds in turn: Fourier series, triangles and sines, slow triangles, small reversals.

    Args:
        problem: Robot and limits, from `design_of`.
        duration: Duration of each motion [s].
        count: Largest number of motions; motions that are too slow (see `fast_enough`) are left out.
        rng: Random numbers.

    Raises:
        ParameterError: If the robot cannot rest in any posture within its limits.
    """
    postures = feasible_postures(problem, rng)
    draws = (_fourier, _triangles, _slow_triangles, _reversals)
    out: list[Candidate] = []
    for k in range(_DRAWS * count):
        candidate = draws[k % len(draws)](problem, postures, duration, rng)
        if fast_enough(candidate, problem):
            out.append(candidate)
        if len(out) == count:
            break
    return tuple(out)


def exciting(problem: DesignProblem, duration: float, rng: np.random.Generator) -> Candidate:
    """D-optimal motion for the inertial parameters.

    It separates rivals such as base tilt, load and inertia much better than most random motions.

    Args:
        problem: Robot and limits.
        duration: Duration [s].
        rng: Random numbers for the start.

    Raises:
        ParameterError: If the robot cannot rest in any posture within its limits.
    """
    shapes = FourierSeries(duration, _HARMONICS)
    grid, postures = Grid.of(shapes, shapes.samples), feasible_postures(problem, rng)
    starts = [_random(problem, shapes, postures, rng) for _ in range(_STARTS)]
    information = [_information(problem, grid, weights) for weights in starts]
    start = starts[int(np.argmax(information))]
    better = descend(problem, grid, start, rounds=_ROUNDS, iterations=_ITERATIONS, criterion=DOptimality())
    still = constant_weights(grid.motion(start).q.mean(axis=0), len(start))
    kept = nearest_within_limits(problem, grid, better, still, _TRIED_SIZES)
    weights = kept if _information(problem, grid, kept) > max(information) else start
    return Candidate("an exciting Fourier series", shapes, weights)


def _information(problem: DesignProblem, grid: Grid, weights: Float[Array, "K nv"]) -> float:
    """Information of a motion on the inertial parameters: the mean logarithm of their precision."""
    return -DOptimality().cost(problem.information(problem.regressor(grid.motion(weights))))[0]


def design_of(robot: Robot, limits: Limits) -> DesignProblem:
    """Design problem of the motions. Create it once: computing the base parameters of a large robot takes long."""
    return DesignProblem(robot, base_of(robot), ConditionNumber(), limits)


def varied(candidate: Candidate, problem: DesignProblem, rng: np.random.Generator) -> Candidate:
    """A random variation of a motion: other sizes of each joint and slightly other shapes, within the limits."""
    shapes = candidate.shapes
    grid = Grid.of(shapes, shapes.samples)
    still = constant_weights(grid.motion(candidate.weights).q.mean(axis=0), len(candidate.weights))
    moving = candidate.weights - still
    size = np.abs(moving).max(axis=0)
    larger = np.exp(_SIZE_DEVIATION * rng.normal(size=problem.robot.nv))
    moving = moving * larger + _SIZE_DEVIATION * size * rng.normal(size=moving.shape) / 3.0
    return Candidate(candidate.kind, shapes, nearest_within_limits(problem, grid, moving + still, still, _TRIED_SIZES))


def fast_enough(candidate: Candidate, problem: DesignProblem) -> bool:
    """True if the joints, on average, move fast enough that they do not stick and slip (see `_FAST_ENOUGH`)."""
    v = Grid.of(candidate.shapes, candidate.shapes.samples).motion(candidate.weights).v
    wanted = _FAST_ENOUGH * problem.limits.velocity[list(problem.robot.tree_rows)]
    return float(np.minimum(np.sqrt(np.mean(v**2, axis=0)) / wanted, 1.0).mean()) >= _LEAST_MEAN_RATIO


def _fourier(problem: DesignProblem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    """A random Fourier series."""
    shapes = FourierSeries(duration, int(rng.integers(4, 11)))
    return Candidate("Fourier series", shapes, _random(problem, shapes, postures, rng))


def _triangles(problem: DesignProblem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    """Random triangles with several periods, and sines."""
    shapes = TrianglesAndSines(duration, triangles=int(rng.integers(3, 9)), harmonics=3)
    return Candidate("triangles and sines", shapes, _random(problem, shapes, postures, rng))


def _slow_triangles(problem: DesignProblem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    """Random triangles with few periods."""
    shapes = TrianglesAndSines(duration, triangles=int(rng.integers(*_SLOW_PERIODS)), harmonics=1)
    return Candidate("slow triangles", shapes, _random(problem, shapes, postures, rng))


def _random(problem: DesignProblem, shapes: Shapes, postures: Array, rng: np.random.Generator) -> Float[Array, "K nv"]:
    """Weights of a random motion about the middle of the ranges or a random posture, as large as the limits allow."""
    grid, sizes = Grid.of(shapes, shapes.samples), joint_sizes(problem)
    if rng.random() < 0.5:
        posture = postures[rng.integers(len(postures))]
    else:
        posture = postures[np.argmin(np.abs((postures - sizes.middle) / sizes.half).max(axis=1))]
    moving = random_weights(problem, grid, rng)
    still = constant_weights(posture, len(moving))
    travel, rows = grid.values[0] @ moving, list(problem.robot.tree_rows)
    # Share of the travel of each joint that its position limits leave room for.
    up = (problem.limits.upper[rows] - posture) / np.maximum(travel.max(axis=0), 1e-12)
    down = (posture - problem.limits.lower[rows]) / np.maximum(-travel.min(axis=0), 1e-12)
    weights = still + moving * np.clip(0.97 * np.minimum(up, down), 0.0, 1.0)
    return nearest_within_limits(problem, grid, weights, still, _TRIED_SIZES)


def _reversals(problem: DesignProblem, postures: Array, duration: float, rng: np.random.Generator) -> Candidate:
    """Small reversals about several random postures."""
    shapes = SmallReversals(duration, stops=int(rng.integers(3, 6)), reversals=int(rng.integers(3, 7)))
    sizes = joint_sizes(problem)
    nv = problem.robot.nv
    stops = postures[rng.integers(len(postures), size=shapes.stops)]
    # The postures are moved closer together, so that the motions between them keep the limits of each joint.
    steps = np.maximum(np.abs(np.diff(stops, axis=0)).max(axis=0), 1e-12)
    farthest = shapes.farthest(sizes.speed, problem.limits.acceleration)
    stops = stops[0] + np.minimum(1.0, 0.9 * farthest / steps) * (stops - stops[0])
    grid = Grid.of(shapes, shapes.samples)
    # The reversals may use half of the limits of speed and acceleration.
    fastest, sharpest = (np.abs(grid.values[k, :, 1]).max() for k in (1, 2))
    small = np.exp(rng.uniform(*np.log(_REVERSAL_SIZES), size=(shapes.stops, nv))) * sizes.half
    small = np.minimum(small, 0.5 * np.minimum(sizes.speed / fastest, problem.limits.acceleration / sharpest))
    weights = shapes.weights(stops, small, rng.random(nv) < 0.5)
    still = constant_weights(stops[0], len(weights))
    kept = nearest_within_limits(problem, grid, weights, still, _TRIED_SIZES)
    return Candidate("holds with small reversals", shapes, kept)
