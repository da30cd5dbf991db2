"""Interface of an effect of the catalogue.

An author gives a name, a regime, words, `Effect.parameters`, the law `Effect.torque`, its columns `Effect.signature`
and how it enters a simulation `Effect.simulated`. All the rest has a default that is right for a torque on one joint
that is linear in its parameters. An effect that differs says so by an attribute or a small method here. Relations
between effects are in `phantom_dyn.effects.relations`, so that no other code has to know effects by name.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.described import EffectWords, FormulaTerm, ModelNumbers
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Rival, Shape
from phantom_dyn.effects.simulated import Simulated
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# Parameters as a finding or a file states them, by name: numbers, or lists of an effect that takes lists.
Stated = Mapping[str, float | list[float]]


@dataclass(frozen=True)
class Parameter:
    """Name, unit and range of one parameter of an effect.

    Attributes:
        name: Name in files and in the catalogue.
        unit: SI; ``1`` if it has none.
        lower: Smallest value that the law allows; at zero the effect is absent.
        upper: Largest one.
        default: Value for a device if none is given; None if it must be given.
        above_zero: True if zero is impossible in a device, although a search may reach it.
        plausible: Smallest and largest value of a sound device; a size outside it has to be checked. None if unknown.
        plausible_because: Reason for that range.
        listed: True if it is a list (the orders of a cogging torque); then all parameters of the effect are lists.
        either_sign: True if it can be negative even if the model has none of it; an undetected one is then drawn with
            either sign.
        tried: For a `LawEffect`: values to try of a parameter in which the torque is not linear; empty for others.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    default: float | None = None
    above_zero: bool = False
    plausible: tuple[float, float] | None = None
    plausible_because: str = ""
    listed: bool = False
    either_sign: bool = False
    tried: tuple[float, ...] = ()


class Effect(Rival):
    """One cause of a gap between robot and model that the catalogue has a name for.

    The parameters are those of `parameters`. If the torque is linear in them, they are the coefficients.

    Attributes:
        words: How reports describe it.
        changes_with: Kind of change between two recordings that may change it: of friction, of temperature (which
            changes friction too), or of the controller; None if no known change does.
    """

    words: EffectWords
    changes_with: Literal["friction", "temperature", "controller"] | None = None

    @property
    def displaces(self) -> bool:
        """True if it has a `true_motion` of its own."""
        return type(self).true_motion is not Effect.true_motion

    def reads_one_place(self, theta: Float[Array, " p"]) -> bool:
        """True if each reading belongs to exactly one position of the joint, as it does for most encoders."""
        return True

    @abstractmethod
    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Parameters of the effect, with units and bounds."""

    def takes_lists(self, robot: Robot, joint: str | None) -> bool:
        """True if each parameter is a list, all of the same length; ``theta`` is one list after the other."""
        return any(one.listed for one in self.parameters(robot, joint))

    def optional_parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """Further parameters of the law that a device may have, all or none; no fit estimates them."""
        return ()

    def can_sit(self, robot: Robot, joint: str | None) -> bool:
        """True if a device can have it there, also where no search tries it."""
        places = self.places(robot)
        if self.shared and joint is not None and "+" in joint:
            return all(one in places for one in joint.split("+"))
        return joint in places

    def from_coefficients(
        self, robot: Robot, joint: str | None, coefficients: Float[Array, " k"], shape: Shape
    ) -> Float[Array, " p"]:
        """Parameters of the effect, in the order of `parameters`, from linear coefficients."""
        return coefficients

    def stated_law(
        self, robot: Robot, joint: str | None, shape: Shape, std: Float[Array, " k"], coefficients: Float[Array, " k"]
    ) -> tuple[tuple[Parameter, ...], Callable[[Array], Array]]:
        """Parameters that a finding states, and the function that gives them from coefficients and shape of a fit.

        By default the effect's parameters.

        Args:
            robot: The given model.
            joint: Where it sits.
            shape: Shape of the fit, if it is fixed.
            std: Deviations of the coefficients.
            coefficients: Coefficients of the fit.
        """
        count = len(coefficients)

        def law(x: Array) -> Array:
            return self.from_coefficients(robot, joint, x[:count], tuple(x[count:].tolist()) or shape)

        return self.parameters(robot, joint), law

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """Its columns as terms of a formula, if they have no shape and depend on inputs of the same moment alone.

        Args:
            middle: Function that gives the middle of the recorded values of an input; some terms are written about it.
        """
        return ()

    def remark(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> str:
        """A sentence on what such a size means for this robot; empty if there is none."""
        return ""

    def from_stated(self, robot: Robot, stated: Stated) -> Stated:
        """Parameters of the effect from those of a finding or file, which may be others or older ones."""
        return stated

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Float[Array, " k"]]:
        """The parameter that is the size of the effect, and the coefficients of one unit of it.

        By default the first parameter, which is the only coefficient.
        """
        return self.parameters(robot, joint)[0].name, np.array([1.0])

    def probe_unit(self, robot: Robot, joint: str | None, name: str) -> str:
        """Unit of what `probe` names."""
        return next(parameter.unit for parameter in self.parameters(robot, joint) if parameter.name == name)

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Float[Array, " nv"]
    ) -> tuple[float, ...] | None:
        """Parameters of the effect with a given size; None if the size alone does not determine them.

        Args:
            robot: The given model.
            joint: Where it sits.
            name: Parameter that `probe` names.
            size: Its value.
            posture: Mean positions [rad or m], about which the other parameters are those of `probe`.
        """
        known = self.parameters(robot, joint)
        return (size,) if [parameter.name for parameter in known] == [name] else None

    @abstractmethod
    def torque(
        self, robot: Robot, operation: Operation, joint: str | None, theta: Float[Array, " p"]
    ) -> Float[Array, "N nv"]:
        """Torque that the effect adds on the joints (friction opposes motion), from the effect's parameters.

        For an effect of a reading, the drive or the transmission: minus the additional drive torque that it leaves in
        the recording.
        """

    def link_ahead(
        self, operation: Operation, joint: str | None, theta: Float[Array, " p"]
    ) -> Float[Array, "N nv"] | None:
        """How far links are ahead of their motors [rad or m]; None where they are rigidly tied."""
        return None

    def true_motion(
        self, robot: Robot, motion: Motion, joint: str | None, theta: Float[Array, " p"]
    ) -> tuple[Robot, Motion]:
        """The robot in the gravity that it truly feels, and the motion of its links; as given by default."""
        return robot, motion

    def at_work(self, operation: Operation, joint: str | None, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """The parameters for a simulation of that operation, if something in it (a temperature) changes them slowly."""
        return theta

    @abstractmethod
    def simulated(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> Simulated:
        """Its channels in a simulation, from the effect's parameters."""

    def model_numbers(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> ModelNumbers:
        """Its numbers in model files and control laws; by default the changed links or gravity, if that is all."""
        part = self.simulated(robot, joint, theta)
        others = (
            part.command, part.torque, part.reading, part.transmission, part.inertia, part.reference_delay
        )  # fmt: skip
        return ModelNumbers(whole=True, robot=part.robot) if all(x is None for x in others) else ModelNumbers()
