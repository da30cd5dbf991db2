"""A drive that gives no more than ``limit``: the true torque is the command clipped to ``+-limit``.

While the command exceeds the limit, the logged torque is wrong by the excess, and every other effect that is fitted to
these samples becomes wrong too. No effect that acts below the limit looks like this one. The command is smoothed a
little before it is compared with the limit; otherwise the effect would explain noise beyond the limit.
URDF: ``<limit effort>``; MJCF: ``forcerange`` of the actuator.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Law,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    SpecialCase,
    command_law,
    on_one_joint,
    row_of,
    torque_on_joint,
    torque_unit,
)
from phantom_dyn.effects.support.rows import hidden_behind_drive, moving_average, stated_limit

# Below, the command is the logged torque. The needed torque is what the model needs for the recorded motion: without
# findings when limits are proposed (`Operation.tau`), with the findings so far when they are checked (`expected`).

# The tried limits are those that the command exceeds in these shares of the recording.
_BEYOND = (0.4, 0.2, 0.1, 0.05, 0.02, 0.01)
# One more limit is tried, which the needed torque exceeds in this share of the recording.
_NEEDED_BEYOND = 0.02
# The command must exceed a limit for this time at least once [s].
_LEAST_SECONDS = 0.03
# If the command exceeds the limit in more than this share of the samples, it must be statistically certain that the
# needed torque does not rise with the command (`_is_surely_flat`). Friction that the model lacks looks like a limit
# that is exceeded most of the time.
_OFTEN = 0.45
# If the command exceeds the limit in more than this share of the samples, no limit is accepted: hardly any sample then
# shows that the drive follows commands below the limit.
_NEARLY_ALWAYS = 0.95
# Allowed range of the median needed torque while the command exceeds the limit, as shares of the limit.
_NEEDED = (0.6, 1.4)
# A limit below this share of the largest torque that the drive has given is rejected: the needed torque is known to
# about a fifth.
_OF_GIVEN = 0.8
# Largest slope of the needed torque over the command beyond a limit. The ideal slope is zero with a limit, and one
# without.
_SLOPE = 0.12
# Largest standard deviation of the needed torque beyond a limit, over the limit. The torque of a drive at its limit is
# constant to some per cent; where a contact or a cable takes the excess of the command, the needed torque varies with
# the posture.
_SPREAD = 0.1
# Slope of the needed torque over the command if the supply of the drive is weak.
_WEAK_SUPPLY = 1.0 / 3.0
# A limit is rejected if the slope of a weak supply (`_WEAK_SUPPLY`) is more likely than the largest slope of a limit
# (`_SLOPE`) by more than this, as a log likelihood ratio.
_MOST_ODDS = 1.0
# Commands from this share of the limit up to the limit show how noisy the needed torque is.
_BELOW = 0.3
# Number of levels of the command at which a plateau of the needed torque is searched.
_LEVELS = 200
# Time over which the command is averaged [s].
_SECONDS = 0.01


class TorqueSaturation(Effect):
    """Torque limit of the drive of one joint."""

    name = "torque_saturation"
    regime = "saturated"
    # The torque that the motion needs does not contain the excess of the command over the limit.
    made_of = ("torque",)
    acts_as = "drive"
    shows_with = "acceleration"
    fitted = "any size"
    words = EffectWords(
        name="torque saturation",
        meaning="the drive gives less than what is commanded beyond a limit",
        next_step="Put the limit into the robot's configuration, and repeat the recording below it.",
        size="at {limit}",
        parameters={"limit": "torque beyond which the drive gives no more"},
        shown_over=("measured",),
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``limit`` of the true torque."""
        stated = stated_limit(robot, joint)
        return (
            Parameter(
                "limit",
                torque_unit(robot, joint),
                0.0,
                plausible=(0.05 * stated if np.isfinite(stated) else 0.0, 1.5 * stated),
                plausible_because="a drive gives about the limit that its data sheet states, or some share of it",
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Limits [N m or N] that the command exceeds in 1 % to 40 % of the recording, and two from the needed torque.

        The needed torque stays at the limit while the command exceeds it.
        """
        row = row_of(robot, joint)
        command = _command(operation, row)
        limits = np.quantile(np.abs(command), 1.0 - np.array(_BEYOND))
        needed = np.quantile(np.abs(operation.tau[:, row]), 1.0 - _NEEDED_BEYOND)
        plateau = _plateau(command, operation.tau[:, row])
        return tuple((float(x),) for x in np.unique([*limits, needed, *plateau]))

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The same limit, and some limits that are close to it."""
        return tuple((factor * shape[0],) for factor in (0.9, 0.97, 0.99, 1.0, 1.01, 1.03, 1.1))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Part of the command beyond the limit; its coefficient is one if the limit is right.

        It is zero if the motion contradicts this limit: if the drive has given more than the limit, or if the needed
        torque is not about the limit while the command exceeds it.
        """
        row = row_of(robot, joint)
        excess = _excess(operation, row, shape[0])
        possible = shape[0] >= _OF_GIVEN * largest_given(operation, row)
        return on_one_joint(
            robot, joint, excess=(excess * (possible and _plausible(operation, row, shape[0], excess)), "1")
        )

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """About one: with another coefficient the effect is not a saturation."""
        return ((0.85, 1.15),)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """Empty, because the coefficient does not say how certain the limit is.

        In one short event, limit and coefficient have the same effect, so that neither is well determined.
        """
        return ()

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """The limit, which is the shape."""
        return np.array([shape[0]])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the torque comes from a sensor behind the drive, which does not show the limit."""
        return hidden_behind_drive(robot, "the limit of the drive")

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """True torque minus command: minus the part of the command beyond the limit."""
        return torque_on_joint(robot, joint, -_excess(operation, row_of(robot, joint), theta.item()))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A command law that clips the command to the limit."""
        limit, row = np.full(robot.nv, np.inf), row_of(robot, joint)
        limit[row] = theta.item()
        law = Law(clipped_law, row, (theta.item(),))
        return Simulated(series=lambda t, tau: clipped(tau, limit), limit=theta.item(), laws=(law,))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The limit, which describes the effect completely."""
        return ModelNumbers(whole=True, limit=theta.item())


def _command(operation: Operation, row: int) -> Array:
    """Logged torque of a joint, smoothed."""
    key = ("command without noise", row)
    if key not in operation.kept:
        operation.kept[key] = moving_average(operation.logged[:, row], operation.dt, _SECONDS)
    return operation.kept[key]


def _plausible(operation: Operation, row: int, limit: float, excess: Array) -> bool:
    """True if the command exceeds the limit for some time, and the needed torque is about the limit then.

    Without this condition the fit could choose a limit near zero, so that the excess would be the whole logged torque.
    """
    beyond = excess != 0
    # Starts and ends of the runs of samples beyond the limit alternate; every other difference is the length of a run.
    starts_and_ends = np.flatnonzero(np.diff(np.concatenate([[False], beyond, [False]]).astype(int)))
    run_lengths = np.diff(starts_and_ends)[::2]
    if len(run_lengths) == 0 or run_lengths.max() * operation.dt < _LEAST_SECONDS:
        return False
    # Multiplied by the sign of the excess, because the size of the torque would give the noise a positive mean.
    needed = operation.expected[beyond, row] * np.sign(excess[beyond])
    middle = float(np.median(needed))
    if not _NEEDED[0] * limit < middle < _NEEDED[1] * limit:
        return False
    if _slow_deviation(needed, np.flatnonzero(beyond), operation.dt) >= _SPREAD * limit:
        return False
    if beyond.mean() > _OFTEN:
        return beyond.mean() < _NEARLY_ALWAYS and _is_surely_flat(operation, limit, excess[beyond], needed)
    return _is_flat(operation, row, limit, excess)


def _slow_deviation(needed: Array, samples: Array, dt: float) -> float:
    """Standard deviation of means over up to `_LEAST_SECONDS`, which has little of the noise of accelerations.

    Args:
        needed: Needed torque at some samples, ``(n,)``.
        samples: Indices of these samples, ``(n,)``. A mean is over neighbours only.
        dt: Time between samples [s].
    """
    steps = np.arange(len(samples)) // max(int(_LEAST_SECONDS / dt), 1)
    starts = np.flatnonzero(np.concatenate([[True], (np.diff(samples) > 1) | (np.diff(steps) > 0)]))
    counts = np.diff(np.append(starts, len(samples)))
    means = np.add.reduceat(needed, starts) / counts
    return float(np.sqrt(np.average((means - needed.mean()) ** 2, weights=counts)))


def _is_surely_flat(operation: Operation, limit: float, excess: Array, needed: Array) -> bool:
    """True if the slope of the needed torque over the command is below `_SLOPE` by more than two standard errors.

    The standard deviation of the command must be larger than the limit: otherwise the cause may be friction that the
    model lacks, which is constant too.
    """
    slope, square, scatter = _line(excess, needed)
    if square <= len(needed) * limit**2:
        return False
    return abs(slope) < _SLOPE - 2.0 * _slope_error(operation, scatter, square)


def _is_flat(operation: Operation, row: int, limit: float, excess: Array) -> bool:
    """True if, beyond the limit, the slope of the needed torque over the command is below `_SLOPE` within its noise.

    False if a weak supply of the drive explains the slope clearly better: for a standard error of 0.11, the slope of a
    weak supply (a third) is within two standard errors of `_SLOPE`.

    The noise is the smaller one of two: the scatter of the needed torque minus the command below the limit, which is
    large if the model lacks friction, and the scatter about the line beyond the limit.
    """
    beyond = excess != 0
    command, needed = _command(operation, row), operation.expected[:, row]
    slope, square, noise = _line(excess[beyond], needed[beyond] * np.sign(command[beyond]))
    if square == 0.0:
        return True
    below = ~beyond & (np.abs(command) > _BELOW * limit)
    if not below.any():
        return abs(slope) < _SLOPE
    difference = (needed - command)[below]
    noise = min(noise, 1.4826 * float(np.median(np.abs(difference - np.median(difference)))))
    error = _slope_error(operation, noise, square)
    beyond_limit_slope = max(abs(slope) - _SLOPE, 0.0)
    short_of_weak_slope = max(_WEAK_SUPPLY - abs(slope), 0.0)
    weak_is_likelier = beyond_limit_slope**2 - short_of_weak_slope**2 > 2.0 * _MOST_ODDS * error**2
    return beyond_limit_slope <= 2.0 * error and not weak_is_likelier


def _line(excess: Array, needed: Array) -> tuple[float, float, float]:
    """Straight line through the needed torque over the size of the excess.

    Returns:
        Slope of the needed torque over ``|excess|``, sum of squares of ``|excess|`` about its mean, and standard
        deviation of the needed torque about the line.
    """
    x = np.abs(excess) - np.abs(excess).mean()
    square = float(x @ x)
    slope = float(x @ needed) / square if square > 0.0 else 0.0
    return slope, square, float((needed - slope * x).std())


def _slope_error(operation: Operation, noise: float, square: float) -> float:
    """Standard error of the slope of `_line`, for noise that stays the same over `_LEAST_SECONDS`."""
    return noise * float(np.sqrt(max(_LEAST_SECONDS / operation.dt, 1.0) / square))


def _plateau(command: Array, needed: Array) -> tuple[float, ...]:
    """The highest level at which the needed torque stays while the command rises above it; empty if there is none.

    Over all samples with a higher command than this level, the median needed torque reaches the level; at the next
    level it no longer does. Without a limit the needed torque rises with the command, so that there is no such level.
    """
    size, needed = np.abs(command), needed * np.sign(command)
    levels = np.linspace(0.0, float(size.max()), _LEVELS + 1)[1:-1]
    # For each sample, the number of levels that are not above its command, and that are not above its needed torque.
    of_command, of_needed = (np.searchsorted(levels, part, side="right") for part in (size, needed))
    # For each level, the number of samples whose command reaches the level, and of those whose needed torque does, too.
    beyond, both = (
        np.cumsum(np.bincount(part, minlength=len(levels) + 1)[:0:-1])[::-1]
        for part in (of_command, np.minimum(of_command, of_needed))
    )
    # The median needed torque reaches a level if more than half of the samples do; a tie needs the median itself.
    reached = 2 * both > beyond
    for k in np.flatnonzero(2 * both == beyond):
        reached[k] = np.median(needed[size >= levels[k]]) >= levels[k]
    last = np.flatnonzero(reached[:-1] & ~reached[1:])
    return (float(levels[last[-1]]),) if len(last) else ()


def largest_given(operation: Operation, row: int) -> float:
    """Largest torque [N m or N] that was both commanded and needed for `_LEAST_SECONDS`, so that the drive gave it."""
    command = _command(operation, row)
    needed = moving_average(operation.expected[:, row], operation.dt, _SECONDS) * np.sign(command)
    samples = max(int(_LEAST_SECONDS / operation.dt), 1) if operation.dt > 0 else 1
    return max(float(ndimage.minimum_filter1d(np.minimum(np.abs(command), needed), samples).max()), 0.0)


def _excess(operation: Operation, row: int, limit: float) -> Array:
    command = _command(operation, row)
    return command - clipped(command, limit)


def clipped(tau, limit):
    """``tau`` clipped to ``+-limit``, for numbers or arrays; `clipped_law` is compiled for numbers."""
    return np.minimum(np.maximum(tau, -limit), limit)


clipped_law = command_law(jit(clipped))
