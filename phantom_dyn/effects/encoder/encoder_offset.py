"""A wrong zero of an encoder: ``reading = q + offset``.

The model then computes gravity and inertia torques at a wrong position. If no torque depends on this position, as on a
first joint with a vertical axis, the offset cannot be detected. On a joint with a horizontal axis a base tilt about
this axis looks the same, and over a small range a spring looks nearly the same; postures far apart separate them. The
effect is the same for an encoder on the motor and on the link. URDF: joint ``origin``; MJCF: joint ``ref``.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import inlined_jit
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
    reading_law,
    row_of,
)
from phantom_dyn.effects.support.displaced import change_by_reading, displaced, exact_change_by_reading
from phantom_dyn.effects.support.rows import branch_rows, secant
from phantom_dyn.motion import Motion

# Offset [rad or m] below which the tangent replaces the secant, which then has large rounding errors. At this offset
# both agree to three digits.
_LEAST = 1e-4
# Change of torque per unit of position, as a share of the largest torque. A smaller change is due to rounded numbers in
# the robot file.
_ROUNDING = 1e-6


class EncoderOffset(Effect):
    """Wrong zero of the encoder of one joint."""

    name = "encoder_offset"
    regime = "posture"
    made_of = ("acceleration", "model")
    acts_as = "load"
    fitted = "secant"
    words = EffectWords(
        name="an encoder offset",
        meaning="the position is read with a constant error",
        next_step="Calibrate the joint's zero again, and correct the offset.",
        size="of {offset}",
        parameters={"offset": "reading less true position"},
        shown_over=("position",),
        separated_by="link encoder",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``offset``, which is reading minus true position."""
        row = row_of(robot, joint)
        far = np.inf if robot.prismatic[row] else np.pi
        large = 0.1 if robot.prismatic[row] else 0.5
        return (
            Parameter(
                "offset",
                robot.position_units[row],
                -far,
                far,
                plausible=(-large, large),
                plausible_because="a zero that is off by more than half a radian or ten centimetres is seen by eye",
                either_sign=True,
            ),
        )

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """One start: an offset of zero, whose column is the tangent."""
        return ((0.0,),)

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The next offset of the secant: the last estimate."""
        return secant(float(coefficients[0]), _LEAST)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Additional drive torque per unit of offset, as a secant from zero to ``shape``."""
        row, step = row_of(robot, joint), shape[0] if shape else 0.0
        zero = np.zeros(len(operation.t))
        if abs(step) < _LEAST:
            change = change_by_reading(operation, row, zero - 1.0, zero, zero)
        else:
            change = exact_change_by_reading(robot, operation, row, zero - step, zero, zero) / step
        rows = branch_rows(robot, joint)
        return Signature(rows, change[:, list(rows), None], ("offset",), (robot.position_units[row],))

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Half a turn in both directions for a revolute joint: a larger offset equals a smaller one."""
        return () if robot.prismatic[row_of(robot, joint)] else ((-np.pi, np.pi),)

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if no torque depends on the position, so that the offset changes nothing."""
        if operation.steepest[row_of(robot, joint)] <= _ROUNDING * np.abs(operation.tau).max():
            return "no torque depends on the position of this joint: its zero leaves no trace"
        return None

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Drive torque of the motion as read, minus that of the true motion."""
        zero = np.zeros(len(operation.t))
        return -exact_change_by_reading(robot, operation, row_of(robot, joint), zero - theta.item(), zero, zero)

    def true_motion(self, robot: Robot, motion: Motion, joint: str | None, theta: Array) -> tuple[Robot, Motion]:
        """The motion with the offset subtracted from the readings."""
        zero = np.zeros(len(motion.t))
        return robot, displaced(motion, row_of(robot, joint), zero - theta.item(), zero, zero)

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A reading law that adds the offset."""
        return Simulated(laws=(Law(shifted_law, row_of(robot, joint), (theta.item(),)),))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The offset as the zero of the encoder, which describes the effect completely."""
        return ModelNumbers(whole=True, zero=theta.item())


@reading_law
@inlined_jit
def shifted_law(q: float, offset: float) -> float:
    """Reading of an encoder with a wrong zero at position ``q``."""
    return q + offset
