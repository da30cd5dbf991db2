"""Coulomb friction that depends on the position: ``-T(q) sign(v)``, with ``T`` linear between some positions.

A worn, dirty or misaligned screw, guide or bearing has more friction at some places of its travel than at others.
Before the first and after the last position the friction is constant. At every reversal the measured torque jumps by an
amount that depends on the position; Coulomb friction is the special case of a constant amount. The torque of cogging or
a spring is the same in both directions, while the torque of this effect changes its sign. Friction that grows with the
load looks similar if the load depends on the position, as on a slow pendulum: several loads at one place separate them.
The effect is searched only if its columns predict, on held-out data, a part of the residual that constant and
load-dependent friction do not predict.
URDF: ``<dynamics friction>``, MJCF: ``frictionloss``, for the mean over the positions only.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Float,
    Law,
    ModelNumbers,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    SpecialCase,
    row_of,
    torque_law,
    torque_on_joint,
    torque_unit,
)
from phantom_dyn.effects.support.changed_robot import with_friction
from phantom_dyn.effects.support.rows import dry_range, modelled_friction_of, never_reverses

# Numbers of positions that are tried; the largest number resolves a bump over a tenth of the travel.
_COUNTS = (5, 9, 14)
# Percentage of the samples before the first and after the last position. The joint may visit the ends of its travel
# only once, in a single block, so that held-out blocks could not confirm the friction there.
_BEYOND = 3.0
# Number of blocks, of which every other one is held out.
_BLOCKS = 16
# Largest number of samples for the comparison on held-out blocks.
_SAMPLES = 4000
# Share by which the columns of the effect have to reduce the squared error of a fit with plain columns.
_LEAST_GAIN = 0.1
# Share of the blocks in which the columns of the effect have to reduce the error.
_LEAST_BLOCKS = 0.6


class PositionDependentFriction(Effect):
    """Coulomb friction of one joint that varies with its position."""

    name = "position_dependent_friction"
    regime = "posture"
    acts_as = "dry friction"
    fitted = "shape held"
    changes_with = "friction"
    words = EffectWords(
        name="position-dependent friction",
        meaning="friction that is higher at some places of the travel than at others",
        next_step="Look for wear, dirt or misalignment where it is highest; a slow run over the whole travel in both "
        "directions confirms it.",
        size="of {torque} at {position}",
        parameters={
            "position": "places of the joint",
            "torque": "friction torque at each of these places, linear in between",
        },
        shown_over=("position",),
        kept="of position-dependent friction, the mean over its places",
        lost="how friction changes with position",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Positions and torques; ``theta`` holds all positions, then all torques."""
        row = row_of(robot, joint)
        return (
            Parameter(
                "position",
                robot.position_units[row],
                plausible=(-np.inf, np.inf),
                plausible_because="a joint may rub at any place of its travel",
                listed=True,
            ),
            replace(dry_range(robot, joint, "torque"), listed=True),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """First position, last position and their number; empty if the residual does not show the effect."""
        row = row_of(robot, joint)
        q, v = operation.q[:, row], operation.v[:, row]
        first, last = np.percentile(q, [_BEYOND, 100.0 - _BEYOND])
        if not last > first:
            return ()
        # Torque that other findings explain may be due to this friction, so it is added to the residual.
        torque = operation.residual[:, row] + operation.expected[:, row] - operation.tau[:, row]
        s, load, need = np.sign(v), operation.transmitted[:, row], operation.tau[:, row]
        plain = np.column_stack([np.ones(len(q)), v, s, q - q.mean(), operation.a[:, row], need, np.abs(load) * s])
        # The plain columns contain constant friction, which is the sum of all weights: the first weight is left out.
        places = np.linspace(first, last, _COUNTS[1])
        if not predicts_held_out(torque, plain, interpolation_weights(q, places)[:, 1:] * s[:, None]):
            return ()
        return tuple((float(first), float(last), float(count)) for count in _COUNTS)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """One column for each position: its interpolation weight times the sign of the velocity."""
        row, unit = row_of(robot, joint), torque_unit(robot, joint)
        weights = interpolation_weights(operation.q[:, row], grid_positions(shape))
        columns = weights * np.sign(operation.v[:, row])[:, None]
        names = tuple(f"torque_{k + 1}" for k in range(columns.shape[1]))
        return Signature((row,), columns[:, None, :], names, (unit,) * len(names))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower bounds: minus the modelled Coulomb torque, so that the sum is not negative at any position."""
        return ((-modelled_friction_of(robot, joint)[1], np.inf),) * len(grid_positions(shape))

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """No friction, and the same friction at all positions, which is Coulomb friction."""
        return SpecialCase((), coefficients), SpecialCase(("coulomb_friction",), np.diff(coefficients))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Positions, then torques; the number of positions is the number of coefficients."""
        return np.concatenate([grid_positions((shape[0], shape[1], float(len(coefficients)))), coefficients])

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: friction at the first position."""
        return "torque", np.array([1.0])

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the joint never reverses: the effect then looks like a torque that depends on position."""
        return never_reverses(robot, operation, joint)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """``-T(q) sign(v)`` on the joint."""
        row = row_of(robot, joint)
        return torque_on_joint(robot, joint, -_level(operation.q[:, row], theta) * np.sign(operation.v[:, row]))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """Smallest torque as Coulomb friction of the robot, which sticks at rest; the rest as torque laws."""
        row = row_of(robot, joint)
        places, torques = np.split(np.asarray(theta, dtype=float), 2)
        least = float(torques.min())
        return Simulated(
            robot=lambda moved: with_friction(moved, joint, coulomb=least),
            laws=tuple(Law(bent_law, row, numbers) for numbers in _bends(places, torques - least)),
        )

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The mean torque over the positions."""
        return ModelNumbers(coulomb=float(np.mean(np.split(np.asarray(theta, dtype=float), 2)[1])))


def grid_positions(shape: Shape) -> Float[Array, " k"]:
    """Positions between which the friction is interpolated, evenly spaced from the first to the last one."""
    return np.linspace(shape[0], shape[1], round(shape[2]))


def interpolation_weights(q: Float[Array, " N"], places: Float[Array, " k"]) -> Float[Array, "N k"]:
    """Weights of a linear interpolation between positions, which is constant before the first and after the last."""
    return np.column_stack([np.interp(q, places, one) for one in np.eye(len(places))])


def _level(q: Float[Array, " N"], theta: Float[Array, " p"]) -> Float[Array, " N"]:
    """Friction torque at positions ``q``; ``theta`` holds positions in rising order, then the torques there."""
    places, torques = np.split(np.asarray(theta, dtype=float), 2)
    return np.interp(q, places, torques)


def _bends(places: Float[Array, " k"], torques: Float[Array, " k"]) -> tuple[tuple[float, float, float], ...]:
    """The friction as a sum of `bent_law`: level, change of slope and place of each law; only the first has a level."""
    slopes = np.concatenate([[0.0], np.diff(torques) / np.diff(places), [0.0]])
    levels = np.concatenate([torques[:1], np.zeros(len(places) - 1)])
    return tuple(zip(levels.tolist(), np.diff(slopes).tolist(), places.tolist(), strict=True))


@torque_law
@jit
def bent_law(q: float, v: float, level: float, slope: float, place: float) -> float:
    """Friction torque at position ``q``, whose size is a level up to a place and changes linearly after it."""
    return -(level + slope * max(q - place, 0.0)) * np.sign(v)


def predicts_held_out(torque: Float[Array, " N"], plain: Float[Array, "N p"], columns: Float[Array, "N k"]) -> bool:
    """True if the columns predict, on held-out blocks, part of the torque that the plain columns do not explain.

    A least-squares fit to the even blocks predicts the odd ones, and the other way round.

    Args:
        torque: Torque to be explained.
        plain: Columns of other causes.
        columns: Columns of the effect.
    """
    step = math.ceil(len(torque) / _SAMPLES)
    y, both = torque[::step], np.column_stack([plain, columns])[::step]
    both = both / np.maximum(np.sqrt(np.mean(both**2, axis=0)), 1e-300)
    block = np.arange(len(y)) * _BLOCKS // len(y)
    squared_error = np.zeros((2, _BLOCKS))
    for held_out in (0, 1):
        train = block % 2 != held_out
        for k, x in enumerate((both[:, : plain.shape[1]], both)):
            fitted = np.linalg.lstsq(x[train].T @ x[train], x[train].T @ y[train], rcond=1e-10)[0]
            squared_error[k] += np.bincount(block[~train], (y - x @ fitted)[~train] ** 2, _BLOCKS)
    gain = squared_error[0] - squared_error[1]
    enough = gain.sum() > _LEAST_GAIN * squared_error[0].sum()
    return bool(enough and (gain > 0.0).sum() > _LEAST_BLOCKS * _BLOCKS)
