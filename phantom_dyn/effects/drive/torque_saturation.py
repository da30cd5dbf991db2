"""A drive that gives no more than ``limit``: the true torque is the command held within ``+-limit``.

It leaves an error only where the command is beyond the limit, as large as the excess, and it spoils every other fit.
It is confused with nothing that acts below the limit. The command is smoothed a little before it is compared with
the limit: its noise beyond the limit would explain itself. URDF: ``<limit effort>``; MJCF: the actuator's
``forcerange``.
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

# Limits are tried that the command exceeds in these shares of the recording, and one that the needed torque exceeds.
_BEYOND = (0.4, 0.2, 0.1, 0.05, 0.02, 0.01)
_NEEDED_BEYOND = 0.02
# A limit is accepted if the command exceeds it for this time at least once [s]. If the command exceeds it for more than
# this share of the recording, the needed torque must certainly not rise with the command: friction that the model lacks
# looks like a limit most of the time. If it hardly ever is within the limit, nothing shows that the drive gives what is
# commanded there: of a model that lacks its load, too, the needed torque is small and flat.
_LEAST_SECONDS = 0.03
_MOST = 0.45
_NEARLY_ALWAYS = 0.95
# Range of the median of the needed torque while the command exceeds the limit, as shares of the limit.
_NEEDED = (0.6, 1.4)
# Share of a recorded torque that the motion certainly needed: the needed torque is known to about a fifth.
_SURE = 0.8
# Beyond a limit the needed torque stays constant while the command rises: its steepest slope over the command, and its
# largest spread over the limit. Without a limit the slope is one, with a weak supply about a third, at a limit zero.
# Log odds by which the slope of a weak supply may be more likely than the steepest at a limit.
_SLOPE = 0.12
_WEAK_SUPPLY = 1.0 / 3.0
_MOST_ODDS = 1.0
_SPREAD = 0.8
# Commands from this share of the limit up to the limit show how noisy the needed torque is.
_BELOW = 0.3
# Levels of the command at which a plateau of the needed torque is looked for.
_LEVELS = 200
# Time over which the command is averaged [s].
_SECONDS = 0.01


class TorqueSaturation(Effect):
    """Largest torque that the drive of one joint gives."""

    name = "torque_saturation"
    regime = "saturated"
    # The torque that the motion needs does not contain the excess of the command over the limit.
    made_of = ("torque",)
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
        """``limit`` of the true torque."""
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
        """Limits that the command exceeds for 1 % to 40 % of the recording, and two from the motion.

        However far the command is beyond the limit, the motion needs no more torque than the limit.
        """
        row = row_of(robot, joint)
        command = _command(operation, row)
        limits = np.quantile(np.abs(command), 1.0 - np.array(_BEYOND))
        needed = np.quantile(np.abs(operation.tau[:, row]), 1.0 - _NEEDED_BEYOND)
        plateau = _plateau(command, operation.tau[:, row])
        return tuple((float(x),) for x in np.unique([*limits, needed, *plateau]))

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The same limit and some next to it."""
        return tuple((factor * shape[0],) for factor in (0.9, 0.97, 0.99, 1.0, 1.01, 1.03, 1.1))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Command beyond the limit; its coefficient is one if the limit is right.

        Zero where the motion speaks against a limit there: a drive at its limit gives just that, and no drive gives
        more than its limit, so what was recorded and followed is below it.
        """
        row = row_of(robot, joint)
        excess = _excess(operation, row, shape[0])
        seen = shape[0] >= _SURE * followed(operation, row) and _plausible(operation, row, shape[0], excess)
        return on_one_joint(robot, joint, excess=(excess * seen, "1"))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """About one: with any other coefficient the effect is not a saturation."""
        return ((0.85, 1.15),)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """None: a limit of zero is no drive at all, and one that the command never reaches has no torque.

        In one short event a limit and its coefficient do the same, so neither is known well by itself.
        """
        return ()

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """The limit is the shape."""
        return np.array([shape[0]])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """It cannot be seen if a torque sensor sits behind the drive."""
        return hidden_behind_drive(robot, "the limit of the drive")

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Minus what the logged command has beyond the limit."""
        return torque_on_joint(robot, joint, -_excess(operation, row_of(robot, joint), theta.item()))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The command held within the limit."""
        limit, row = np.full(robot.nv, np.inf), row_of(robot, joint)
        limit[row] = theta.item()
        law = Law(clipped_law, row, (theta.item(),))
        return Simulated(
            series=lambda t, tau: held_within(tau, limit),
            limit=theta.item(),
            laws=(law,),
        )

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """Model files can contain all of it, as this number."""
        return ModelNumbers(whole=True, limit=theta.item())


def _command(operation: Operation, row: int) -> Array:
    key = ("command without noise", row)
    if key not in operation.kept:
        operation.kept[key] = moving_average(operation.logged[:, row], operation.dt, _SECONDS)
    return operation.kept[key]


def _plausible(operation: Operation, row: int, limit: float, excess: Array) -> bool:
    """True if the command stays beyond the limit for a while, and the needed torque is about the limit there.

    Without this, a limit near zero would make the whole logged torque its excess, noise and missing friction included.
    """
    beyond = excess != 0
    runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[False], beyond, [False]]).astype(int))))[::2]
    if len(runs) == 0 or runs.max() * operation.dt < _LEAST_SECONDS:
        return False
    # Signed, as the noise of accelerations has no sign of its own.
    needed = operation.expected[beyond, row] * np.sign(excess[beyond])
    middle = float(np.median(needed))
    if not _NEEDED[0] * limit < middle < _NEEDED[1] * limit:
        return False
    if float(needed.std()) >= _SPREAD * limit:
        return False
    if beyond.mean() > _MOST:
        return beyond.mean() < _NEARLY_ALWAYS and _is_surely_flat(operation, limit, excess[beyond], needed)
    return _is_flat(operation, row, limit, excess)


def _is_surely_flat(operation: Operation, limit: float, excess: Array, needed: Array) -> bool:
    """True if the needed torque certainly neither rises nor falls with the command, by its own scatter about the line.

    The command has to go on by more than the limit: by less it may be friction that the model lacks, which is flat too.
    """
    slope, square, scatter = _line(excess, needed)
    if square <= len(needed) * limit**2:
        return False
    return abs(slope) < _SLOPE - 2.0 * _slope_error(operation, scatter, square)


def _is_flat(operation: Operation, row: int, limit: float, excess: Array) -> bool:
    """True if beyond the limit the needed torque neither rises nor falls with the command, within its noise.

    A weak supply may not be clearly more likely: noise of a tenth alone would let its slope of a third pass.

    The noise is the deviation of the needed torque from the command below the limit, or its own scatter about the line
    if that is smaller: friction that the model lacks makes the first one large.
    """
    beyond = excess != 0
    command, needed = _command(operation, row), operation.expected[:, row]
    slope, square, noise = _line(excess[beyond], needed[beyond] * np.sign(command[beyond]))
    if square == 0.0:
        return True
    below = ~beyond & (np.abs(command) > _BELOW * limit)
    if not below.any():
        return abs(slope) < _SLOPE
    off = (needed - command)[below]
    noise = min(noise, 1.4826 * float(np.median(np.abs(off - np.median(off)))))
    error = _slope_error(operation, noise, square)
    steeper, from_weak = max(abs(slope) - _SLOPE, 0.0), max(_WEAK_SUPPLY - abs(slope), 0.0)
    return steeper <= 2.0 * error and steeper**2 - from_weak**2 <= 2.0 * _MOST_ODDS * error**2


def _line(excess: Array, needed: Array) -> tuple[float, float, float]:
    """Slope of the needed torque over the excess of the command, that excess squared and summed, scatter about it."""
    x = np.abs(excess) - np.abs(excess).mean()
    square = float(x @ x)
    slope = float(x @ needed) / square if square > 0.0 else 0.0
    return slope, square, float((needed - slope * x).std())


def _slope_error(operation: Operation, noise: float, square: float) -> float:
    """Standard error of such a slope; noise counts as equal within `_LEAST_SECONDS`."""
    return noise * float(np.sqrt(max(_LEAST_SECONDS / operation.dt, 1.0) / square))


def _plateau(command: Array, needed: Array) -> tuple[float, ...]:
    """The highest level above which the command goes on and the median of the needed torque stays at the level.

    Of a drive without a limit the needed torque is above the level wherever the command is: there is none.
    """
    size, needed = np.abs(command), needed * np.sign(command)
    levels = np.linspace(0.0, float(size.max()), _LEVELS + 1)[1:-1]
    passed, met = (np.searchsorted(levels, part, side="right") for part in (size, needed))
    # Samples whose command is at each level or above, and those of them whose needed torque is too.
    beyond, both = (
        np.cumsum(np.bincount(part, minlength=len(levels) + 1)[:0:-1])[::-1]
        for part in (passed, np.minimum(passed, met))
    )
    reached = 2 * both > beyond
    for k in np.flatnonzero(2 * both == beyond):
        reached[k] = np.median(needed[size >= levels[k]]) >= levels[k]
    last = np.flatnonzero(reached[:-1] & ~reached[1:])
    return (float(levels[last[-1]]),) if len(last) else ()


def followed(operation: Operation, row: int) -> float:
    """Largest recorded torque that the motion needed as well for a while [N m or N]: the drive has given it."""
    command = _command(operation, row)
    needed = moving_average(operation.expected[:, row], operation.dt, _SECONDS) * np.sign(command)
    samples = max(int(_LEAST_SECONDS / operation.dt), 1) if operation.dt > 0 else 1
    return max(float(ndimage.minimum_filter1d(np.minimum(np.abs(command), needed), samples).max()), 0.0)


def _excess(operation: Operation, row: int, limit: float) -> Array:
    command = _command(operation, row)
    return command - held_within(command, limit)


def held_within(tau, limit):
    """``tau`` held within ``+-limit``, numbers or arrays; kernels compile it for numbers."""
    return np.minimum(np.maximum(tau, -limit), limit)


clipped_law = command_law(jit(held_within))
