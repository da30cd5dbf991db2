"""A constant torque on one joint that the model lacks, positive in the positive direction of the joint.

The drive has to compensate the offset, so that the measured torque is lower by this amount. On a joint whose gravity
torque hardly changes, an offset looks like a base tilt or a payload. URDF has no place for it; MJCF: ``biasprm`` of
the actuator.
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
    on_one_joint,
    row_of,
    torque_law,
    torque_on_joint,
    torque_unit,
)
from phantom_dyn.effects.support.rows import stated_limit


class TorqueOffset(Effect):
    """Constant torque on one joint."""

    name = "torque_offset"
    regime = "everywhere"
    exact = True
    words = EffectWords(
        name="a torque offset",
        meaning="a constant torque that is there in every posture and at every speed",
        next_step="Check the zero of the torque sensor or amplifier, and the balance of the joint.",
        size="of {torque}",
        parameters={"torque": "constant torque along the joint's positive direction"},
        shown_over=("time",),
        separated_by="level",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``torque``, positive or negative."""
        limit = stated_limit(robot, joint)
        return (
            Parameter(
                "torque",
                torque_unit(robot, joint),
                plausible=(-limit, limit),
                plausible_because="a constant torque beyond the drive's limit would hold the joint at its stop",
                either_sign=True,
            ),
        )

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """One column: minus one, because the drive torque has to compensate the offset."""
        return on_one_joint(robot, joint, torque=(-np.ones(len(operation.t)), torque_unit(robot, joint)))

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """One term: a constant."""
        return (FormulaTerm("offset", "1", lambda: np.ones(1)),)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """The constant torque on the joint."""
        return torque_on_joint(robot, joint, np.full(len(operation.t), theta.item()))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The constant torque on the joint."""
        return Simulated(laws=(Law(constant_law, row_of(robot, joint), (theta.item(),)),))

    def model_numbers(self, robot: Robot, joint: str | None, theta: Array) -> ModelNumbers:
        """The offset, which describes the effect completely."""
        return ModelNumbers(whole=True, offset=theta.item())


@torque_law
@inlined_jit
def constant_law(torque: float) -> float:
    """Torque of the offset, which is its parameter."""
    return torque
