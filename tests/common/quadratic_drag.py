"""A made-up effect, as its author would write it: drag that grows with the square of speed, ``torque = -c v |v|``."""

from collections.abc import Callable

import numpy as np

from phantom_dyn.effects.described import EffectWords, FormulaTerm
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape, Signature
from phantom_dyn.effects.simulated import Moment, Simulated
from phantom_dyn.effects.support.rows import on_one_joint, row_of, torque_on_joint
from phantom_dyn.model.robot import Robot

Array = np.ndarray
UNIT = "N m s^2/rad^2"


class QuadraticDrag(Effect):
    """See the module."""

    name = "quadratic_drag"
    regime = "high_speed"
    words = EffectWords(
        name="quadratic drag",
        meaning="drag that grows with the square of speed, as of a paddle in water",
        next_step="Look for what the joint moves through.",
        size="of {coefficient}",
        parameters={"coefficient": "torque per squared speed"},
        shown_over=("velocity",),
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``coefficient`` c."""
        why = "half the density of water times a paddle of a square metre at a metre is 500"
        return (Parameter("coefficient", UNIT, 0.0, plausible=(0.0, 500.0), plausible_because=why),)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Squared speed in the direction of motion."""
        v = operation.v[:, row_of(robot, joint)]
        return on_one_joint(robot, joint, coefficient=(v * np.abs(v), UNIT))

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """The same column."""
        return (FormulaTerm("drag", "v*|v|", lambda v: v * np.abs(v), "{speed}^2"),)

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """The law on the joint."""
        v = operation.v[:, row_of(robot, joint)]
        return torque_on_joint(robot, joint, -theta[0] * v * np.abs(v))

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The law at the speed of the moment."""
        row = row_of(robot, joint)

        def torque(state: Array, dt: float, moment: Moment) -> tuple[Array, Array]:
            v = moment.v[row : row + 1]
            return state, torque_on_joint(robot, joint, -theta[0] * v * np.abs(v))[0]

        return Simulated(torque=torque)
