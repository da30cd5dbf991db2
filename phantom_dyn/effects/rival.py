"""A cause that leaves columns in inverse dynamics: what the search for causes asks of it.

Effects of the catalogue are such causes, and so are structures that the catalogue has no name for.
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

# Numbers in which the torque is not linear (a Stribeck velocity, the orders of a cogging torque); () if there are none.
Shape = tuple[float, ...]
# What columns are computed from besides positions and velocities:
# - acceleration: carries the noise of a twice differentiated position;
# - model: the model's torque or its derivatives, so that the columns change with the model's parameters; those of the
#   rigid-body regressor do not, as torque is linear in those;
# - load: the torque that the transmission passes, all other findings included;
# - torque: the torque of the drive, all other findings included;
# - whole joint: the torque of the joint that the coefficient scales, other findings included.
Source = Literal["acceleration", "model", "load", "torque", "whole joint"]
# How a fit takes the numbers of a law:
# - plain: the torque is linear in the coefficients; each number of the shape is a parameter that is fitted with them;
# - shape held: the joint fit of all parameters keeps the shape that the search has found;
# - secant: the shape is the last estimate of the coefficients, and no parameter of its own;
# - first order: the columns are a first-order expansion, so that the joint fit evaluates the law itself;
# - size in shape: the coefficient is the share of the effect that is there and should be one; the shape is its size;
# - any size: the same, and any size can be seen;
# - nothing: it has no column, as it adds noise to the readings and nothing else.
Fitted = Literal["plain", "shape held", "secant", "first order", "size in shape", "any size", "nothing"]
# Additional drive torque, ``(N, nv)``, from operation, joint, coefficients and shape.
OtherLaw = Callable[[Operation, str | None, Array, Array], Array]


@dataclass(frozen=True)
class Signature:
    """Residual of an effect in inverse dynamics: drive torque per unit of each coefficient.

    Attributes:
        rows: Indices of the joints whose torque it touches.
        columns: Shape ``(N, len(rows), k)``; measured torque = model + ``columns @ coefficients``.
        names: One per coefficient.
        units: One per coefficient.
        steps: The part of the columns that has no noise of accelerations above the judged band, as it is computed from
            the signs of velocities or from a low-passed torque.
    """

    rows: tuple[int, ...]
    columns: Float[Array, "N m k"]
    names: tuple[str, ...]
    units: tuple[str, ...]
    steps: Float[Array, "N m k"] | None = None


@dataclass(frozen=True)
class SpecialCase:
    """A law with some of its numbers at zero: a sum of simpler laws, or no effect at all.

    Attributes:
        names: Names of the simpler effects, on the same joint; empty if nothing is left.
        numbers: Numbers of the fit, or sums of them, that are all zero in this case.
    """

    names: tuple[str, ...]
    numbers: Float[Array, " k"]


class Rival(ABC):
    """A cause that leaves columns in inverse dynamics; ``joint`` is None where it is one of the whole robot.

    The measured torque is linear in the coefficients once the ``shape`` (a Stribeck velocity) is fixed. A law that is
    not linear in its only parameter (a delay) takes its last estimate as shape. Its column is a secant: the change of
    torque from zero to the shape, per unit of the parameter. The law is exact if coefficient and shape are equal.

    Attributes:
        name: Name of the effect in the catalogue, or another one for a cause that the catalogue does not have.
        regime: Where the effect shows most.
        scope: Where it sits: on a joint, between a pair of joints (two names joined by ``+``), on the whole robot, or
            either on a joint or on the whole robot.
        made_of: What its columns are computed from besides positions and velocities, see `Source`.
        acts_as: A ``load`` if its torque is on the link, so that the transmission passes it; ``dry friction`` if it may
            hold a joint at standstill; None for all others: viscous friction, the drive and its rotor.
        shows_with: What its torque varies with: ``velocity``; ``acceleration``, or rate and peaks of the torque; or
            ``slow motion``, if it acts only while a joint creeps or reverses. Noise in the motion, and the answer of a
            controller to it, look like the second.
        fitted: How a fit takes its numbers, see `Fitted`.
        inertial: How it uses columns of the rigid-body regressor, see `regressor_columns`: as a point mass (mass and
            first moments are free, the inertia follows from them), or each column by itself; then only base parameters
            can be identified, and a finding lists no others. None for an effect with columns of its own.
        built_in: True if it is a permanent property of a robot, so that an earlier diagnosis would have found it.
        exact: True if rigid bodies obey its law exactly, so that a residual beside it has another cause.
        other_laws: Other laws of the same parameters that the catalogue's definition fits as well. No recording
            distinguishes them, so the spread between the laws counts as uncertainty of the parameters.
    """

    name: str
    regime: str
    scope: Literal["joint", "pair", "robot", "either"] = "joint"
    made_of: tuple[Source, ...] = ()
    acts_as: Literal["load", "dry friction"] | None = None
    shows_with: Literal["velocity", "acceleration", "slow motion"] | None = None
    fitted: Fitted = "plain"
    inertial: Literal["point mass", "free"] | None = None
    exact: bool = False
    built_in: bool = False
    other_laws: tuple[OtherLaw, ...] = ()

    # Attributes and relations under the names by which they are asked for.

    @property
    def contains(self) -> tuple[str, ...]:
        """Names of the effects that are special cases of it; a law that is not in the catalogue overrides this."""
        return related(self.name, "contains")

    @property
    def tends_to(self) -> tuple[str, ...]:
        """Names of effects on the same joint that it can approach as closely as one likes."""
        return related(self.name, "tends to")

    @property
    def on_each_joint(self) -> tuple[str, ...]:
        """For an effect between two joints: effects of single joints that, on both, leave nearly the same torque."""
        return related(self.name, "resembles on each joint")

    @property
    def same_as_sum(self) -> tuple[str, ...]:
        """Names of effects whose sum is a special case of it, so that no data distinguish the two."""
        return related(self.name, "may be a sum with")

    @property
    def sum_parts(self) -> tuple[str, ...]:
        """Names of the effects of which several together may leave much the same."""
        return related(self.name, "resembles a sum of")

    @property
    def near_twins(self) -> tuple[str, ...]:
        """Names of effects on the same joint that leave nearly the same while it follows its reference."""
        return related(self.name, "nearly same in closed loop")

    @property
    def same_shapes(self) -> tuple[str, ...]:
        """Names of effects on the same joint that are tried with its shape once it is found."""
        return related(self.name, "same shapes as")

    @property
    def uses_acceleration(self) -> bool:
        """True if its columns carry the noise of a twice differentiated position."""
        return "acceleration" in self.made_of

    @property
    def follows_model(self) -> bool:
        """True if its columns change with the parameters of the model."""
        return "model" in self.made_of

    @property
    def follows_load(self) -> bool:
        """True if its columns are computed from the load of the transmission, all other findings included."""
        return "load" in self.made_of

    @property
    def follows_torque(self) -> bool:
        """True if its columns are computed from the torque of the drive, all other findings included."""
        return "torque" in self.made_of

    @property
    def scales_joint(self) -> bool:
        """True if its coefficient scales the whole torque of its joint, other findings included."""
        return "whole joint" in self.made_of

    @property
    def shared(self) -> bool:
        """True if one cause may give several joints the same number, such as a wrong current scale of equal drives.

        It then also sits on several joints, their names joined by ``+``.
        """
        return self.scales_joint

    @property
    def on_link(self) -> bool:
        """True if its torque is on the link, so that the transmission passes it."""
        return self.acts_as == "load"

    @property
    def rubs(self) -> bool:
        """True if it is friction that may hold a joint at standstill."""
        return self.acts_as == "dry friction"

    @property
    def goes_with_motion(self) -> Literal["velocity", "acceleration"] | None:
        """Whether its torque varies with velocity or acceleration, at any speed."""
        return None if self.shows_with == "slow motion" else self.shows_with

    @property
    def acts_when_slow(self) -> bool:
        """True if it acts only while a joint creeps or reverses."""
        return self.shows_with == "slow motion"

    @property
    def shape_is_estimate(self) -> bool:
        """True if the shape is the last estimate of a coefficient, and no parameter of its own."""
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
        """Whether its size is the coefficient or the shape; neither, if any size can be seen."""
        return "shape" if self.fitted == "size in shape" else "neither" if self.fitted == "any size" else "coefficient"

    @property
    def only_noise(self) -> bool:
        """True if it adds noise to the readings and nothing else, so that simulated motion does not include it."""
        return self.fitted == "nothing"

    @property
    def displaces(self) -> bool:
        """True if with it the links are not where the readings say, or feel another gravity.

        The torque of a wrong mass then differs too.
        """
        return False

    @property
    def stays(self) -> bool:
        """True if its columns of one shape do not change with the result of a fit."""
        return not (self.follows_torque or self.follows_load)

    def places(self, robot: Robot) -> tuple[str | None, ...]:
        """Joints where a search tries it; None is the whole robot."""
        if self.scope == "robot":
            return (None,)
        return (None, *robot.joint_names) if self.scope == "either" else robot.joint_names

    def shapes(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[Shape, ...]:
        """Shapes to try first; a single empty one if the torque is linear in every parameter."""
        return ((),)

    def refined(self, coefficients: Float[Array, " k"], shape: Shape) -> tuple[Shape, ...]:
        """Shapes to try after a fit: the same and its neighbours, or the last estimate of a secant."""
        return (shape,)

    def at_estimate(self, coefficients: Float[Array, " k"], shape: Shape) -> Shape:
        """The shape at which a law that takes its own parameter as shape agrees with its coefficients."""
        near = self.refined(coefficients, shape)
        return near[len(near) // 2]

    def regressor_columns(self, robot: Robot, joint: str | None) -> tuple[int, ...]:
        """Indices of the columns of the rigid-body regressor that an ``inertial`` effect uses."""
        return ()

    @abstractmethod
    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """Columns of the effect, see `Signature`."""

    def coefficient_bounds(self, robot: Robot, joint: str | None, shape: Shape) -> tuple[tuple[float, float], ...]:
        """Lower and upper bound of each coefficient where physics has any; empty if it has none at all."""
        return ()

    def bounds_in(
        self, robot: Robot, operation: Operation, joint: str | None, shape: Shape
    ) -> tuple[tuple[float, float], ...]:
        """The bounds, narrowed by what the recordings tell besides their torques; by default not narrowed."""
        return self.coefficient_bounds(robot, joint, shape)

    def lightest(self, robot: Robot) -> float:
        """Least mass [kg] of an effect that is ``inertial`` as a point mass."""
        return 0.0

    def own_inertia(self, robot: Robot, mass: float) -> Float[Array, " 6"]:
        """Inertia about its own centre, per mass [m^2], of the part that a point mass stands for; a point has none."""
        return np.zeros(6)

    def special_cases(
        self, robot: Robot, joint: str | None, coefficients: Float[Array, " k"], shape: Shape
    ) -> tuple[SpecialCase, ...]:
        """Simpler laws that it becomes if some of its numbers are zero, the simplest first.

        By default: no effect at all, if the coefficients are zero, or if the shape is zero and any size can be seen.
        """
        return (SpecialCase((), np.array(shape) if self.seen_by == "neither" else coefficients),)

    def untestable(self, robot: Robot, operation: Operation, joint: str | None) -> str | None:
        """Why no recording like this one can show the effect, in words; None if it may."""
        return None
