"""A spring on one joint that the model lacks (cable, hose, seal): ``torque = -k (q - q0)``.

The residual of the joint is linear in its position. Over a small range the gravity torque of a wrong mass looks the
same; motions of the other joints over wide ranges separate the two.
URDF has no place for it; MJCF: joint ``stiffness`` and ``springref``.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phantom_dyn._kernels.jit import jit
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
    on_one_joint,
    row_of,
    stiffness_unit,
    torque_law,
    torque_on_joint,
    torque_unit,
)
from phantom_dyn.effects.described import less

# Largest rest position [rad or m], whose square does not overflow.
_FARTHEST = 1e150


class ParasiticSpring(Effect):
    """Spring on one joint that the model lacks."""

    name = "parasitic_spring"
    regime = "posture"
    acts_as = "load"
    words = EffectWords(
        name="a parasitic spring",
        meaning="a torque that pulls the joint towards one position, as a cable or hose does",
        next_step="Look for cables and hoses at this joint; reroute them or model the spring.",
        size="of {stiffness}, at rest at {rest_position}",
        parameters={
            "stiffness": "torque per displacement",
            "rest_position": "position at which it pulls to neither side",
        },
        shown_over=("position",),
        separated_by="level",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``stiffness`` k and ``rest_position`` q0."""
        return (
            Parameter(
                "stiffness",
                stiffness_unit(robot, joint),
                0.0,
                plausible=(0.0, np.inf),
                plausible_because="a spring pulls back, from a thin hose to a balancing spring",
            ),
            Parameter(
                "rest_position",
                robot.position_units[row_of(robot, joint)],
                plausible=(-np.inf, np.inf),
                plausible_because="a cable may pull towards a place out of reach",
            ),
        )

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Two columns: the position, and a constant with the coefficient ``-k q0``."""
        q = operation.q[:, row_of(robot, joint)]
        return on_one_joint(
            robot,
            joint,
            stiffness=(q, stiffness_unit(robot, joint)),
            preload=(np.ones(len(q)), torque_unit(robot, joint)),
        )

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """``k`` and ``q0 = -preload / k``; ``q0`` is limited, because it is infinite for ``k = 0``."""
        least = max(abs(coefficients[1]) / _FARTHEST, np.finfo(float).tiny)
        stiffness = coefficients[0] if abs(coefficients[0]) >= least else np.copysign(least, coefficients[0])
        return np.array([coefficients[0], -coefficients[1] / stiffness])

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower bound of zero for the stiffness; the preload has no bounds."""
        return ((0.0, np.inf), (-np.inf, np.inf))

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """No spring, and a constant torque, which is a spring without stiffness."""
        return (SpecialCase((), coefficients), SpecialCase(("torque_offset",), coefficients[:1]))

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: stiffness of a spring whose rest position is the mean position."""
        return "stiffness", np.array([1.0, -float(np.mean(operation.q[:, row_of(robot, joint)]))])

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Array
    ) -> tuple[float, ...] | None:
        """A spring of this stiffness with its rest position at the given posture."""
        return (size, float(posture[row_of(robot, joint)]))

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """One term: displacement from the middle of the recorded positions."""
        center = middle("q")
        return (FormulaTerm("spring", less("q", center), lambda q: q - center, "{angle}"),)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """``-k (q - q0)`` on the joint."""
        return torque_on_joint(robot, joint, -theta[0] * (operation.q[:, row_of(robot, joint)] - theta[1]))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A torque law of the spring."""
        return Simulated(laws=(Law(spring_law, row_of(robot, joint), (float(theta[0]), float(theta[1]))),))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """Stiffness and rest position, which describe the effect completely."""
        return ModelNumbers(whole=True, spring=(float(theta[0]), float(theta[1])))


@torque_law
@jit
def spring_law(q: float, stiffness: float, rest_position: float) -> float:
    """Torque of the spring."""
    return -stiffness * (q - rest_position)
