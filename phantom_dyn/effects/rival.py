"""Interface of a candidate cause of a torque residual: a cause adds columns to the drive torque of inverse dynamics.

The search compares such causes. They are the effects of the catalogue, and structures without a name in the catalogue.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.relations import related
from phantom_dyn.model.robot import Robot

Shape = tuple[float, ...]
"""Values of the parameters in which the torque of a law is not linear, as a Stribeck velocity; () if there are none."""
Source = Literal["acceleration", "model", "load", "torque", "whole joint"]
"""What columns are computed from in addition to positions and velocities:

- acceleration: acceleration, which has the noise of a twice differentiated position.
- model: the model's torque or its derivatives, so that the columns change with the model's parameters. (Columns of the
  rigid-body regressor do not change with these parameters.)
- load: the torque that the transmission passes, with the torques of all other findings.
- torque: the torque of the drive, with the torques of all other findings.
- whole joint: the torque of the joint, with the torques of all other findings; the coefficient scales this torque."""
Fitted = Literal["plain", "shape held", "secant", "first order", "size in shape", "any size", "nothing"]
"""How a fit estimates the parameters of a law. The search first fits the coefficients for some shapes; then the final
fit estimates all parameters of all findings together.

- plain: the torque is linear in the coefficients; the final fit also estimates the shape.
- shape held: the final fit keeps the shape that the search has found.
- secant: the shape is the last estimate of the coefficients, and not a further parameter.
- first order: the columns are a first-order expansion, so that the final fit evaluates the law itself.
- size in shape: the shape is the size of the effect; the coefficient should be one.
- any size: as size in shape; in addition, no size is too small to be detected.
- nothing: the law has no column, because it only adds noise to the readings."""
OtherLaw = Callable[[Operation, str | None, Array, Array], Array]
"""Function of operation, joint, coefficients and shape that returns the additional drive torque, ``(N, nv)``."""


@dataclass(frozen=True)
class Signature:
    """Columns of an effect: additional drive torque per unit of each coefficient.

    Attributes:
        rows: Indices of the joints whose torque the effect changes.
        columns: Shape ``(N, len(rows), k)``; the measured torque is that of the model plus ``columns @ coefficients``.
        names: Names of the coefficients.
        units: Units of the coefficients.
        steps: The part of the columns that has no noise of accelerations above the judged band, because it is computed
            from signs of velocities or from a low-passed torque; None if there is no such part.
    """

    rows: tuple[int, ...]
    columns: Float[Array, "N m k"]
    names: tuple[str, ...]
    units: tuple[str, ...]
    steps: Float[Array, "N m k"] | None = None


@dataclass(frozen=True)
class SpecialCase:
    """A simpler law, or no effect at all, to which a law reduces if certain numbers are zero.

    For example, Stribeck friction reduces to Coulomb friction if its excess at rest is zero.

    Attributes:
        names: Names of the effects, on the same joint, whose sum is the simpler law; empty for no effect.
        numbers: Numbers computed from the fit that are all zero in this case.
    """

    names: tuple[str, ...]
    numbers: Float[Array, " k"]


class Rival(ABC):
    """A cause of a torque residual; ``joint`` is None for a cause that concerns the whole robot.

    For a given ``shape`` (a Stribeck velocity, for example) the measured torque is linear in the coefficients. If a law
    is not linear in its only parameter (a delay), the shape is the last estimate of the parameter and the column is a
    secant: the change of torque from zero to the shape, per unit of the parameter. The secant is exact if coefficient
    and shape are equal.

    Attributes:
        name: Name of the effect in the catalogue, or another name for a cause that the catalogue does not have.
        regime: Part of the motion in which the effect is largest.
        scope: Where the effect can be: on a joint, between two joints (names joined by ``+``), on the whole robot, or
            either on a joint or on the whole robot.
        made_of: What the columns are computed from in addition to positions and velocities, see `Source`.
        acts_as: ``load`` if the torque acts on the link, so that the transmission passes it; ``dry friction`` if it may
            hold a joint at rest; ``drive`` if a drive, its rotor or its transmission makes it, so that a joint without
            a drive cannot have it; None for all others, such as viscous friction.
        shows_with: What the torque depends on: ``velocity``; ``acceleration``, also for rate and peaks of the torque;
            ``slow motion`` if the effect acts only while a joint moves slowly or reverses. Noise in the motion, and a
            controller's response to noise, look like a dependence on acceleration.
        fitted: How a fit estimates the numbers of the law, see `Fitted`.
        inertial: How the effect uses columns of the rigid-body regressor, see `regressor_columns`: ``point mass`` if
            mass and first moments are free and the inertia follows from them; ``free`` if each column has its own
            coefficient, of which only base parameters can be identified. None for other effects.
        built_in: True for a permanent property of a robot, which an earlier diagnosis would have found.
        exact: True if the law is exact, so that any remaining residual has another cause.
        other_laws: Other laws with the same parameters that match the definition in the catalogue equally well. No
            recording distinguishes them, so the spread between the laws counts as uncertainty of the parameters.
    """

    name: str
    regime: str
    scope: Literal["joint", "pair", "robot", "either"] = "joint"
    made_of: tuple[Source, ...] = ()
    acts_as: Literal["load", "dry friction", "drive"] | None = None
    shows_with: Literal["velocity", "acceleration", "slow motion"] | None = None
    fitted: Fitted = "plain"
    inertial: Literal["point mass", "free"] | None = None
    exact: bool = False
    built_in: bool = False
    other_laws: tuple[OtherLaw, ...] = ()

    @property
    def contains(self) -> tuple[str, ...]:
        """Names of the effects that are special cases of this one; a law outside the catalogue overrides this."""
        return related(self.name, "contains")

    @property
    def tends_to(self) -> tuple[str, ...]:
        """Names of effects on the same joint to which this one can come arbitrarily close."""
        return related(self.name, "tends to")

    @property
    def on_each_joint(self) -> tuple[str, ...]:
        """For an effect between two joints: names of effects that, on each of both, may have nearly the same torque."""
        return related(self.name, "resembles on each joint")

    @property
    def same_as_sum(self) -> tuple[str, ...]:
        """Names of effects whose sum is a special case of this one, so that no data distinguish the explanations."""
        return related(self.name, "may be a sum with")

    @property
    def sum_parts(self) -> tuple[str, ...]:
        """Names of effects of which several together may have nearly the same torque as this one."""
        return related(self.name, "resembles a sum of")

    @property
    def near_twins(self) -> tuple[str, ...]:
        """Names of effects with nearly the same torque as this one while the joint follows its reference."""
        return related(self.name, "nearly same in closed loop")

    @property
    def same_shapes(self) -> tuple[str, ...]:
        """Names of effects on the same joint that are tried with the shape of this effect after it is found."""
        return related(self.name, "same shapes as")

    @property
    def uses_acceleration(self) -> bool:
        """True if its columns have the noise of a twice differentiated position."""
        return "acceleration" in self.made_of

    @property
    def follows_model(self) -> bool:
        """True if its columns change with the parameters of the model."""
        return "model" in self.made_of

    @property
    def follows_load(self) -> bool:
        """True if its columns are computed from the load of the transmission, with all other findings."""
        return "load" in self.made_of

    @property
    def follows_torque(self) -> bool:
        """True if its columns are computed from the torque of the drive, with all other findings."""
        return "torque" in self.made_of

    @property
    def scales_joint(self) -> bool:
        """True if its coefficient scales the whole torque of its joint, with all other findings."""
        return "whole joint" in self.made_of

    @property
    def shared(self) -> bool:
        """True if one cause may give several joints the same number, such as a wrong current scale of equal drives.

        Then ``joint`` may also be several names, joined by ``+``.
        """
        return self.scales_joint

    @property
    def on_link(self) -> bool:
        """True if its torque acts on the link, so that the transmission passes it."""
        return self.acts_as == "load"

    @property
    def rubs(self) -> bool:
        """True if it is friction that may hold a joint at rest."""
        return self.acts_as == "dry friction"

    @property
    def needs_drive(self) -> bool:
        """True if no joint without a drive has it: a part of the drive, or friction under what the drive passes."""
        return self.acts_as == "drive" or self.follows_load

    @property
    def goes_with_motion(self) -> Literal["velocity", "acceleration"] | None:
        """Whether its torque depends on velocity or on acceleration; None for neither, or if it acts in slow motion."""
        return None if self.shows_with == "slow motion" else self.shows_with

    @property
    def acts_when_slow(self) -> bool:
        """True if it acts only while a joint moves slowly or reverses."""
        return self.shows_with == "slow motion"

    @property
    def shape_is_estimate(self) -> bool:
        """True if the shape is the last estimate of a coefficient, and not a further parameter."""
        return self.fitted == "secant"

    @property
    def shape_held(self) -> bool:
        """True if the joint fit of all parameters keeps the shape that the search has found."""
        return self.fitted == "shape held"

    @property
    def first_order(self) -> bool:
        """True if its columns are a first-order expansion of the law, so that the joint fit evaluates the law."""
        return self.fitted == "first order"

    @property
    def seen_by(self) -> Literal["coefficient", "shape", "neither"]:
        """Whether its size is the coefficient or the shape; ``neither`` if no size is too small to be detected."""
        if self.fitted == "size in shape":
            return "shape"
        return "neither" if self.fitted == "any size" else "coefficient"

    @property
    def only_noise(self) -> bool:
        """True if it only adds noise to the readings, so that simulated motion does not include it."""
        return self.fitted == "nothing"

    @property
    def displaces(self) -> bool:
        """True if it changes the true positions of the links, or gravity; both change the torque of a mass error."""
        return False

    @property
    def stays(self) -> bool:
        """True if its columns for a given shape do not change with the result of a fit."""
        return not (self.follows_torque or self.follows_load)

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """Joints on which a search tries it; None is the whole robot."""
        if self.scope == "robot":
            return (None,)
        return (None, *robot.joint_names) if self.scope == "either" else robot.joint_names

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Shapes to try first; a single empty one if the torque is linear in every parameter."""
        return ((),)

    def refined(self, coefficients: Float[Array, " k"], shape: Shape) -> tuple[Shape, ...]:
        """Shapes to try after a fit: the same shape and similar ones, or the last estimate for a secant."""
        return (shape,)

    def at_estimate(self, coefficients: Float[Array, " k"], shape: Shape) -> Shape:
        """The shape that agrees with the coefficients; it differs from ``shape`` only if the column is a secant."""
        # `refined` returns the estimate alone, or a symmetric list with the same shape in the middle.
        near = self.refined(coefficients, shape)
        return near[len(near) // 2]

    def regressor_columns(self, robot: Robot, joint: str | None) -> tuple[int, ...]:
        """Indices of the columns of the rigid-body regressor that an ``inertial`` effect uses."""
        return ()

    @abstractmethod
    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Columns of the effect, see `Signature`."""

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower and upper bound of each coefficient from physics; empty if no coefficient is bounded."""
        return ()

    def bounds_in(
        self, robot: Robot, operation: Operation, joint: str | None, shape: Shape
    ) -> tuple[tuple[float, float], ...]:
        """Bounds of `coefficient_bounds`, which data of the recording other than torques may narrow."""
        return self.coefficient_bounds(robot, joint, shape)

    def lightest(self, robot: Robot) -> float:
        """Smallest allowed mass [kg] of an effect that is a point mass."""
        return 0.0

    def own_inertia(self, robot: Robot, mass: float) -> Float[Array, " 6"]:
        """Inertia per mass [m^2] about its own centre, of the part that a point mass represents; by default zero."""
        return np.zeros(6)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Float[Array, " k"], shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """Simpler laws to which it reduces if certain numbers are zero, the simplest first.

        By default only no effect at all: all coefficients are zero, or the shape if `seen_by` is ``neither``.
        """
        return (SpecialCase((), np.array(shape) if self.seen_by == "neither" else coefficients),)

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Reason in words why a recording like this one cannot show the effect; None if it can."""
        return None
