"""A wrong torque constant: the true torque is ``ratio`` times the logged one.

The ratio scales the whole torque of the joint, including gravity and friction. The column is the modelled torque,
because the noise of the measured torque would bias the fit. A wrong mass of all links behind the joint looks the same;
a known mass or known friction separates the two. Equal drives may have the same ratio, for example if the scale of
their current sensors is wrong. One ratio on all drives cannot be separated from a factor on all inertias and frictions.
URDF has no place for it; MJCF: actuator ``gear``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phantom_dyn._kernels.jit import inlined_jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    FormulaTerm,
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
)
from phantom_dyn.effects.support.rows import hidden_behind_drive, rows_of

# Range of ratios that are fitted; a ratio outside means another unit, or a torque on the other side of a gear.
_LEAST, _MOST = 0.1, 10.0


class TorqueConstant(Effect):
    """Ratio of the true to the logged torque of one joint, or of joints with equal drives."""

    name = "torque_constant"
    regime = "high_load"
    built_in = True
    made_of = ("acceleration", "whole joint")
    acts_as = "drive"
    changes_with = "temperature"
    words = EffectWords(
        name="a wrong torque constant",
        meaning="the true torque is a fixed multiple of the one that is recorded",
        next_step="Multiply the torque constant by the ratio; a known weight at a known distance checks it.",
        size=": the true torque is {ratio} times the recorded one",
        parameters={"ratio": "true torque over recorded torque"},
        shown_over=("modelled",),
        separated_by="weighing",
    )

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if the torque comes from a sensor behind the drive, which does not show the torque constant."""
        return hidden_behind_drive(robot, "the torque constant")

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``ratio`` of true to logged torque."""
        return (
            Parameter(
                "ratio",
                "1",
                _LEAST,
                _MOST,
                plausible=(0.5, 2.0),
                plausible_because="torque constants of one type of motor differ by some per cent, hot by a third; a "
                "factor of two is another motor, and more is a unit or a gear ratio",
                either_sign=True,
            ),
        )

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Modelled torque; its coefficient is ``1/ratio - 1``."""
        rows = rows_of(robot, joint)
        # Friction jumps where a joint reverses; the other part of the torque follows the acceleration, with its noise.
        steps = operation.own_friction[:, rows][:, :, None]
        return Signature(rows, operation.tau[:, rows][:, :, None], ("excess",), ("1",), steps=steps)

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Bounds of ``1/ratio - 1`` for the smallest and the largest ratio."""
        return ((1.0 / _MOST - 1.0, 1.0 / _LEAST - 1.0),)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """No effect: a ratio of one, or a ratio at a bound, where the fit does not determine it."""
        ends = self.coefficient_bounds(robot, joint, shape)[0]
        return SpecialCase((), coefficients), *(SpecialCase((), coefficients - end) for end in ends)

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """``ratio = 1 / (1 + excess)``, within its range."""
        return np.clip(1.0 / np.maximum(1.0 + coefficients[:1], 1.0 / _MOST), _LEAST, _MOST)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: the ratio; to first order a ratio that is larger by one has the excess -1."""
        return "ratio", np.array([-1.0])

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Array
    ) -> tuple[float, ...] | None:
        """The ratio, from the excess ``1/ratio - 1``."""
        return (1.0 / (1.0 + size),) if size > -1 else None

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """One term: the transmitted torque."""
        return (FormulaTerm("gain", "tl", lambda tl: tl, "{torque}"),)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """True torque minus logged torque, if the true torque is the modelled one."""
        rows = list(rows_of(robot, joint))
        out = np.zeros_like(operation.tau)
        out[:, rows] = operation.tau[:, rows] * (1.0 - 1.0 / theta[0])
        return out

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A command law that multiplies the command by ``ratio``."""
        scale, rows = np.ones(robot.nv), rows_of(robot, joint)
        scale[list(rows)] = theta[0]
        laws = tuple(Law(scaled_law, row, (float(theta[0]),)) for row in rows)
        return Simulated(series=lambda t, tau: scale * tau, laws=laws)

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The ratio, which describes the effect completely."""
        return ModelNumbers(whole=True, gain=float(theta[0]))


@command_law
@inlined_jit
def scaled_law(tau: float, ratio: float) -> float:
    """Torque of the drive for the command ``tau``."""
    return ratio * tau
