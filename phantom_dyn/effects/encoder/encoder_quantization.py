"""An encoder coarser than stated: the reading is rounded to a ``step``.

In the torque, rounding causes noise, which no column can fit, so that the signature has no column. The step is found
from the readings, which are multiples of the step (`phantom_dyn.effects.support.encoder_lattice.step_of`). If no step
is stated, the step is compared with those of the other joints. Text files with few digits, and positions from a
fieldbus, have the same effect. URDF and MJCF have no place for it.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.jit import inlined_jit
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Law,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    reading_law,
    row_of,
)
from phantom_dyn.effects.support.encoder_lattice import stated_step


class EncoderQuantization(Effect):
    """Encoder of one joint that is coarser than stated, or than those of the other joints."""

    name = "encoder_quantization"
    regime = "low_speed"
    fitted = "nothing"
    words = EffectWords(
        name="coarse encoder steps",
        meaning="the position is rounded to a step coarser than stated, or far coarser than those of other joints",
        next_step="Check the encoder's resolution and the number format of the log, and state the true counts.",
        size="of {step}",
        parameters={"step": "distance between two readings"},
        shown_over=("position", "acceleration"),
        lost="coarse encoders",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """One parameter: ``step``, the distance between two readings."""
        return (
            Parameter(
                "step",
                robot.position_units[row_of(robot, joint)],
                0.0,
                above_zero=True,
                plausible=(0.0, 0.1),
                plausible_because="the coarsest potentiometers and magnets tell some dozens of places a turn",
            ),
        )

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """A signature without columns, because rounding only adds noise."""
        return Signature((row_of(robot, joint),), np.zeros((len(operation.t), 1, 0)), (), ())

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: the step. There are no coefficients."""
        return "step", np.zeros(0)

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason if no step is stated: the readings can then only be compared with those of other joints."""
        if stated_step(robot, row_of(robot, joint)) is None:
            return (
                f"no step is stated, and the readings have none that is far coarser than those of other joints: give "
                f"joints.{joint}.encoder_counts to have them compared with it"
            )
        return None

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Zero, because rounding only adds noise."""
        # Raises an error for an unknown joint.
        row_of(robot, joint)
        return np.zeros((len(operation.t), robot.nv))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """A reading law that rounds to the step."""
        return Simulated(laws=(Law(rounded_law, row_of(robot, joint), (theta.item(),)),))


@reading_law
@inlined_jit
def rounded_law(q: float, step: float) -> float:
    """Reading of a coarse encoder at position ``q``."""
    return np.rint(q / step) * step
