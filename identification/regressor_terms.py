"""Effects that act on the joints, with their shapes held, so that the torque is linear in what is left."""

from __future__ import annotations

from dataclasses import dataclass

from phantom_dyn.effects.effect import Effect, Shape
from phantom_dyn.effects.operation import Operation
from phantom_dyn.errors import ParameterError
from phantom_dyn.robot import Robot

EffectOnJoint = tuple[Effect, str | None] | tuple[Effect, str | None, Shape | float]
"""An effect, its joint (None for the whole robot) and, where the torque is not linear in it, the shape to hold.

A shape of one number may be given as that number.
"""


@dataclass(frozen=True)
class Term:
    """An effect on a joint with its shape held (empty where it has none)."""

    effect: Effect
    joint: str | None
    shape: Shape

    @property
    def label(self) -> str:
        """Start of the names of its coefficients: ``joint.effect``, or the effect alone for the whole robot."""
        return self.effect.name if self.joint is None else f"{self.joint}.{self.effect.name}"


def term_of(robot: Robot, operation: Operation, given: EffectOnJoint) -> Term:
    """The term of an effect as a caller gives it.

    Args:
        robot: The model.
        operation: Motion and torque of a recording.
        given: The effect and where it acts.

    Raises:
        ParameterError: If the effect is nonlinear in a parameter and no shape is given for it.
    """
    effect, joint = given[0], given[1]
    if len(given) == 3:
        shape = given[2] if isinstance(given[2], tuple) else (float(given[2]),)
        return Term(effect, joint, shape)
    shapes = effect.shapes(robot, operation, joint)
    if len(shapes) != 1:
        like = f", for instance ({', '.join(f'{x:.3g}' for x in shapes[len(shapes) // 2])},)" if shapes else ""
        raise ParameterError(
            f"{effect.name} is not linear in one of its parameters: give its shape as the third entry, "
            f"(effect, joint, shape){like}."
        )
    return Term(effect, joint, shapes[0])
