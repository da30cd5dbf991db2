"""An effect of which its author gives the law alone; its columns are finite differences of the law.

The law is ``torque``, linear in all parameters but those whose author gives values to try (`Parameter.tried`). Where
it is linear a difference is exact up to rounding. Of a parameter that it is not linear in the search tries these
values, then nearer and nearer to the best of them: it is a shape, as the velocity of Stribeck friction is. Every
combination of them is tried at every joint, so that few are enough.

Limits: at least one parameter has to be linear (what says how much of the effect there is), a law of a joint acts on
that joint alone, and what a simulation steps through may depend on the position, the velocity and the transmitted
torque of the moment, not on accelerations or on what was before. An effect beyond that gives ``signature`` or
``simulated`` as well.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import modelled_friction
from phantom_dyn.effects.described import EffectWords
from phantom_dyn.effects.effect import Effect, Parameter
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape, Signature
from phantom_dyn.effects.simulated import Moment, Simulated
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.errors import EffectError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# A neighbour of a value that a search has tried: less and more by so much.
_LESS, _MORE = 0.85, 1.18


class LawEffect(Effect):
    """An effect whose author gives ``name``, ``parameters`` and ``torque``; all else follows, see the module."""

    regime = "everywhere"

    def __init_subclass__(cls) -> None:
        """Words from the name, where the author has none."""
        super().__init_subclass__()
        name = getattr(cls, "name", None)
        if isinstance(name, str) and not hasattr(cls, "words"):
            plain = name.replace("_", " ")
            cls.words = EffectWords(plain, plain, f"Look for what causes {plain}, and put its law into the model.")

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Every combination of the values to try."""
        return tuple(product(*(one.tried for one in self.parameters(robot, joint) if one.tried)))

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """Neighbours of a shape: one of its values a sixth smaller or larger."""
        less, more = (
            tuple(tuple(factor * x if k == at else x for k, x in enumerate(shape)) for at in range(len(shape)))
            for factor in (_LESS, _MORE)
        )
        return (*less, shape, *more)

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Drive torque per unit of each linear parameter: differences of the law.

        Raises:
            EffectError: If the law is not finite on this motion.
        """
        known = self.parameters(robot, joint)
        linear = [k for k, one in enumerate(known) if not one.tried]
        rows, columns = rows_of(robot, joint), []
        for k in linear:
            step = unit_of(known[k])
            theta = _theta(known, np.where(np.array(linear) == k, step, 0.0), shape)
            columns.append(-self.torque(robot, operation, joint, theta)[:, list(rows)] / step)
        made = np.stack(columns, axis=-1)
        if not np.isfinite(made).all():
            raise EffectError(
                f"The law of {self.name} is not finite on the motion of {joint or 'the robot'}: give a torque that is "
                "a number at every position and velocity."
            )
        return Signature(rows, made, tuple(known[k].name for k in linear), tuple(known[k].unit for k in linear))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Linear parameters are the coefficients, the others the shape."""
        return _theta(self.parameters(robot, joint), coefficients, shape)

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Bounds of each linear parameter."""
        return tuple((one.lower, one.upper) for one in self.parameters(robot, joint) if not one.tried)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """The first linear parameter."""
        names = [one.name for one in self.parameters(robot, joint) if not one.tried]
        return names[0], np.eye(len(names))[0]

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The law at the position, velocity and transmitted torque of the moment."""

        def torque(state: Array, dt: float, moment: Moment) -> tuple[Array, Array]:
            return state, self.torque(robot, at_moment(robot, moment), joint, theta)[0]

        return Simulated(torque=torque)


def at_moment(robot: Robot, moment: Moment) -> Operation:
    """One instant of a simulation as an operation of one sample, without acceleration."""
    still = np.zeros((1, robot.nv))
    motion = Motion(np.array([moment.t]), moment.q[None], moment.v[None], still)
    tau = moment.transmitted[None] + modelled_friction(robot, motion)
    return Operation(motion.t, motion.q, motion.v, still, robot, tau, tau, tau)


def rows_of(robot: Robot, joint: str | None) -> tuple[int, ...]:
    """The rows that a law may touch: of its joint, of two that are joined by ``+``, or all for the whole robot."""
    if joint is None:
        return tuple(range(robot.nv))
    if joint in robot.joint_names:
        return (row_of(robot, joint),)
    return tuple(row_of(robot, one) for one in joint.split("+"))


def unit_of(parameter: Parameter) -> float:
    """A size at which a law that is linear in a parameter may be evaluated: one, or the limit that is nearest to it."""
    near = float(np.clip(1.0, parameter.lower, parameter.upper))
    return near if near != 0.0 else max(float(parameter.lower), -1.0)


def _theta(known: tuple[Parameter, ...], coefficients: Array, shape: Shape) -> Float[Array, " p"]:
    """Parameters in their order from the linear ones and the others."""
    linear, tried = iter(coefficients), iter(shape)
    return np.array([next(tried if one.tried else linear) for one in known])
