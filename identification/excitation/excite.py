"""Designs a motion from which a robot's inertial parameters can be identified, within its limits (optimal excitation).

1. Random motions about postures within the limits are tried.
2. A descent improves the best of them.
3. The limits are checked at ten times the samples of the descent. If a limit is exceeded between the samples, the
   motion is made smaller, or the descent is repeated with more samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.excitation.criteria import ConditionNumber, Criterion, condition_number
from identification.excitation.descent import (
    SHARES,
    constant_weights,
    descend,
    feasible_postures,
    nearest_within_limits,
    random_motion,
    random_weights,
)
from identification.excitation.design_problem import DesignProblem, Grid, base_of
from identification.excitation.limits import Limits, limits_of
from identification.excitation.motion_shapes import Shapes
from identification.stages import Announcement, Progress, Stage
from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.number_checks import require_positive
from phantom_dyn.random_streams import random_stream

_DENSE = 10
"""Number of samples in the final check for each sample of the design."""
_FINER = (2, 4)
"""Numbers of samples for each sample of the design, in further descents if limits are exceeded between samples."""
_ACCEPTED_LOSS = 0.05
"""A motion that is made smaller to keep limits is accepted if the criterion increases by no more than this; otherwise a
further descent follows."""
_ROWS = 5_000_000
"""Largest number of rows of a reference; more rows are a mistake in rate or duration."""
# Relative sizes of a motion about its posture that are tried after a descent, the largest first.
_REPAIRS = (1.0, 0.998, 0.995, 0.99, 0.98, 0.96, 0.93, 0.89, 0.84, 0.78, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05, 0.02)


@dataclass(frozen=True)
class PlannedRecording:
    """The recording for which a motion is designed.

    Attributes:
        rate_hz: Sample rate [Hz], which determines the weight relative to earlier recordings.
        noise: Torque noise [N m or N] of each joint, or one number, by which joints are weighted; None for equal
            weights.
        earlier: Triangular factor of earlier recordings, from `earlier_factor`; the motion excites mainly parameters
            that they did not excite.
    """

    rate_hz: float = 100.0
    noise: float | Sequence[float] | None = None
    earlier: Float[Array, "k p"] | None = None


@dataclass(frozen=True)
class Excitation(ReadOnlyArrays):
    """A designed motion.

    Attributes:
        robot: The robot for which it was designed.
        shapes: Family of the motion.
        weights: Weight of each shape for each joint, shape ``(K, nv)``.
        rank: Number of base parameters.
        condition: Condition number of the base regressor of motion and earlier recordings, with columns of norm one.
        start: Condition number of the best random motion within the limits, from which the descent started.
        reached: Labels of limits that the motion nearly reaches.
        notes: Sentences for the user.
    """

    robot: Robot
    shapes: Shapes
    weights: Float[Array, "K nv"]
    rank: int
    condition: float
    start: float
    reached: tuple[str, ...]
    notes: tuple[str, ...]

    def motion(self, rate_hz: float) -> Motion:
        """The motion in equal time steps, at the rate nearest to ``rate_hz`` with a sample at the end.

        Raises:
            ParameterError: If the rate is too low for the motion.
        """
        return Grid.of(self.shapes, _count(self.shapes, rate_hz)).motion(self.weights)

    def columns(self, rate_hz: float) -> dict[str, Float[Array, " N"]]:
        """Columns of the reference motion: ``t``, and ``q_ref.<joint>``, ``v_ref.<joint>`` and ``a_ref.<joint>``."""
        motion, joints = self.motion(rate_hz), self.robot.joint_names
        out = {"t": motion.t}
        for name, values in (("q_ref", motion.q), ("v_ref", motion.v), ("a_ref", motion.a)):
            out |= {f"{name}.{joint}": values[:, k] for k, joint in enumerate(joints)}
        return out

    def summary(self) -> str:
        """Two sentences: one on the condition number, one on the limits that the motion reaches."""
        limits = ", ".join(self.reached) if self.reached else "none"
        return (
            f"{self.robot.name}: condition number {self.condition:.3g} of {self.rank} base parameters over "
            f"{self.shapes.duration:g} s from rest to rest, columns of norm one (the best of some random motions: "
            f"{self.start:.3g}).\n"
            f"Limits that it reaches: {limits}."
        )


def excite(
    robot: Robot,
    shapes: Shapes,
    *,
    limits: Limits | None = None,
    criterion: Criterion | None = None,
    planned: PlannedRecording | None = None,
    starts: int = 24,
    seed: int = 0,
    progress: Progress = lambda _: None,
) -> Excitation:
    """The best motion that was found within all limits.

    Args:
        robot: The robot, which may contain closed chains.
        shapes: Family of the motion from `identification.excitation.motion_shapes`.
        limits: Limits; by default those that the robot states, from `limits_of`.
        criterion: Criterion; by default the condition number.
        planned: The planned recording: rate, noise, and earlier recordings; by default 100 Hz.
        starts: Number of random motions; the best one is improved.
        seed: Seed of the random motions.
        progress: Called at the start of each stage.

    Raises:
        ParameterError: If no motion keeps the limits (the message names the limit with the largest excess), or an
            argument is out of range.
        RobotError: If a joint has no drive.
    """
    if starts < 1:
        raise ParameterError(f"{starts} starts were asked for: give at least one.")
    kept = limits_of(robot) if limits is None else limits
    planned = PlannedRecording() if planned is None else planned
    samples = float(_count(shapes, planned.rate_hz))
    base = base_of(robot, planned=samples, noise=planned.noise, earlier=planned.earlier)
    problem = DesignProblem(robot, base, ConditionNumber() if criterion is None else criterion, kept)
    grid, dense = Grid.of(shapes, shapes.samples), Grid.of(shapes, _DENSE * shapes.samples)
    rng = np.random.default_rng(seed)
    progress(Announcement(Stage.POSTURES))
    postures = feasible_postures(problem, rng)
    progress(Announcement(Stage.RANDOM_MOTIONS))
    tried = []
    for _ in range(starts):
        posture = postures[rng.integers(len(postures))]
        weights = random_motion(problem, grid, posture, rng)
        tried.append((criterion_of(problem, grid, weights), weights, posture))
    _, start, posture = min(tried, key=lambda one: one[0])
    still = constant_weights(posture, len(start))
    start = nearest_within_limits(problem, dense, start, still)
    _require_motion(problem, dense, start, still)
    designed = descend(problem, grid, start, progress=progress)
    found = [start, *_smaller_motions(problem, dense, designed, start, still)]
    for finer in _FINER:
        # No finer descent is needed if the criterion is nearly as good with the limits kept between the samples.
        lost = min(criterion_of(problem, grid, one) for one in found) - criterion_of(problem, grid, designed)
        if lost <= _ACCEPTED_LOSS:
            break
        finer_grid = Grid.of(shapes, finer * shapes.samples)
        designed = descend(problem, finer_grid, designed, rounds=4, first=4, iterations=25)
        found += _smaller_motions(problem, dense, designed, start, still)
    weights = min(found, key=lambda one: criterion_of(problem, grid, one))
    motion = dense.motion(weights)
    W = problem.regressor(motion)
    return Excitation(
        robot,
        shapes,
        weights,
        len(base.columns),
        condition_number(problem.information(W)),
        condition_of(problem, grid, start),
        problem.bounds.reached(problem.limited(motion, W)),
        (*kept.notes, *(kept.collisions.notes if kept.collisions is not None else ())),
    )


def criterion_of(problem: DesignProblem, grid: Grid, weights: Float[Array, "K nv"]) -> float:
    """Value of the criterion for a motion."""
    return problem.criterion.cost(problem.information(problem.regressor(grid.motion(weights))))[0]


def condition_of(problem: DesignProblem, grid: Grid, weights: Float[Array, "K nv"]) -> float:
    """Condition number of the base regressor of a motion and earlier recordings, with columns of norm one."""
    return condition_number(problem.information(problem.regressor(grid.motion(weights))))


def _smaller_motions(
    problem: DesignProblem,
    dense: Grid,
    weights: Float[Array, "K nv"],
    start: Float[Array, "K nv"],
    still: Float[Array, "K nv"],
) -> tuple[Float[Array, "K nv"], Float[Array, "K nv"]]:
    """Two motions near the given one that keep every limit at the samples of the check.

    The first is the given motion, made smaller about the posture of the start. The second is a mixture of the given
    motion and the start. It is needed for a closed chain if the given motion is about another posture, with a
    singularity between the two postures.
    """
    return (
        nearest_within_limits(problem, dense, weights, still, _REPAIRS),
        nearest_within_limits(problem, dense, weights, start, _REPAIRS),
    )


def _require_motion(
    problem: DesignProblem, dense: Grid, weights: Float[Array, "K nv"], still: Float[Array, "K nv"]
) -> None:
    """Raise an error if the start does not move, because even the smallest motion about its posture exceeds a limit."""
    if np.abs(dense.motion(weights).v).max() > 0:
        return
    rng = random_stream("sizes of a design")
    motion = dense.motion(still + SHARES[-1] * random_weights(problem, dense, rng))
    values = problem.limited(motion, problem.regressor(motion))
    raise ParameterError(
        f"{problem.robot.name} can rest within its limits, but no motion about that posture keeps them: in a small one "
        f"{problem.bounds.worst(values)}; widen that limit, or another that prevents it."
    )


def _count(shapes: Shapes, rate_hz: float) -> int:
    """Number of samples of a recording with both ends, after a check of the rate."""
    require_positive(sample_rate=rate_hz)
    if shapes.duration * rate_hz > _ROWS:
        raise ParameterError(
            f"{shapes.duration:g} s at {rate_hz:g} Hz are more than {_ROWS} rows: give a lower rate or less time."
        )
    count = round(shapes.duration * rate_hz) + 1
    if count < shapes.samples // 3:
        least = (shapes.samples // 3) / shapes.duration
        raise ParameterError(f"A rate of {rate_hz:g} Hz is too low to show this motion: give at least {least:.3g} Hz.")
    return count
