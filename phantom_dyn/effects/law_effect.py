"""Base class of effects whose author writes only the law, from which the columns are computed.

The law is the method ``torque``. It is linear in all parameters except those for which the author gives values to try
(`Parameter.tried`). Each column is the law with one linear parameter set and the others zero. As the law is linear in
this parameter, the column is exact up to rounding. A parameter with values to try is a shape, like the velocity of
Stribeck friction: the search tries these values, then values closer to the best one. The search tries every combination
on every joint, so give few values.

Limits: at least one parameter must be linear (the size of the effect). The law of a joint, or of a pair of joints, acts
on these joints only. In a simulation the law may depend on position, velocity and transmitted torque at the same
instant, but not on accelerations or on the past. An effect beyond these limits must define ``signature`` or
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
from phantom_dyn.effects.support.rows import rows_of
from phantom_dyn.errors import EffectError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# Factors from a tried value to its neighbours.
_LESS, _MORE = 0.85, 1.18


class LawEffect(Effect):
    """Base class of an effect that defines ``name``, ``parameters`` and ``torque`` only."""

    regime = "everywhere"

    def __init_subclass__(cls) -> None:
        """Set ``words`` from the name if the author gives none."""
        super().__init_subclass__()
        name = getattr(cls, "name", None)
        if isinstance(name, str) and not hasattr(cls, "words"):
            plain = name.replace("_", " ")
            cls.words = EffectWords(plain, plain, f"Look for what causes {plain}, and put its law into the model.")

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Every combination of the values to try."""
        return tuple(product(*(one.tried for one in self.parameters(robot, joint) if one.tried)))

    def refined(self, coefficients: Array, shape: Shape) -> tuple[Shape, ...]:
        """The shape and its neighbours, in which one value is a sixth smaller or larger."""

        def neighbours(factor: float) -> tuple[Shape, ...]:
            return tuple((*shape[:k], factor * shape[k], *shape[k + 1 :]) for k in range(len(shape)))

        return (*neighbours(_LESS), shape, *neighbours(_MORE))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Drive torque per unit of each linear parameter: the law with the other linear parameters zero.

        Raises:
            EffectError: If the law is not finite on this motion.
        """
        known = self.parameters(robot, joint)
        linear = [k for k, one in enumerate(known) if not one.tried]
        rows, columns = rows_of_law(robot, joint), []
        for k in linear:
            size = unit_of(known[k])
            theta = _theta(known, np.where(np.array(linear) == k, size, 0.0), shape)
            columns.append(-self.torque(robot, operation, joint, theta)[:, list(rows)] / size)
        made = np.stack(columns, axis=-1)
        if not np.isfinite(made).all():
            raise EffectError(
                f"The law of {self.name} is not finite on the motion of {joint or 'the robot'}: give a torque that is "
                "a number at every position and velocity."
            )
        return Signature(rows, made, tuple(known[k].name for k in linear), tuple(known[k].unit for k in linear))

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Parameters in their order: linear ones from the coefficients, the others from the shape."""
        return _theta(self.parameters(robot, joint), coefficients, shape)

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower and upper bound of each linear parameter."""
        return tuple((one.lower, one.upper) for one in self.parameters(robot, joint) if not one.tried)

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: the first linear parameter."""
        names = [one.name for one in self.parameters(robot, joint) if not one.tried]
        return names[0], np.eye(len(names))[0]

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The law at position, velocity and transmitted torque of each step."""

        def torque(state: Array, dt: float, moment: Moment) -> tuple[Array, Array]:
            return state, self.torque(robot, at_moment(robot, moment), joint, theta)[0]

        return Simulated(torque=torque)


def at_moment(robot: Robot, moment: Moment) -> Operation:
    """One instant of a simulation as an operation of one sample, without acceleration."""
    still = np.zeros((1, robot.nv))
    motion = Motion(np.array([moment.t]), moment.q[None], moment.v[None], still)
    tau = moment.transmitted[None] + modelled_friction(robot, motion)
    return Operation(motion.t, motion.q, motion.v, still, robot, tau, tau, tau)


def rows_of_law(robot: Robot, joint: str | None) -> tuple[int, ...]:
    """Rows on which a law may act: the row of its joint, of two joints joined by ``+``, or all for the whole robot."""
    return tuple(range(robot.nv)) if joint is None else rows_of(robot, joint)


def unit_of(parameter: Parameter) -> float:
    """Value of a parameter at which the law is evaluated to get its column.

    It is the value nearest to one within the parameter's bounds; if this is zero, the value nearest to minus one.
    """
    near = float(np.clip(1.0, parameter.lower, parameter.upper))
    return near if near != 0.0 else max(float(parameter.lower), -1.0)


def _theta(known: tuple[Parameter, ...], coefficients: Array, shape: Shape) -> Float[Array, " p"]:
    """All parameters in the order of ``known``, from values of the linear ones and the shape."""
    linear, tried = iter(coefficients), iter(shape)
    return np.array([next(tried if one.tried else linear) for one in known])
