"""What an effect of the catalogue provides.

An author gives a name, a regime, words, `Effect.parameters`, the law `Effect.torque`, its columns `Effect.signature`
and how it enters a simulation `Effect.simulated`. All the rest has a default that is right for a torque on one joint
that is linear in its parameters; what differs from that is said by an attribute or a small method here, and what an
effect is to another one in `phantom_dyn.effects.relations`, so that nobody else has to know effects by name.
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
        name: The contract's.
        unit: SI; ``1`` if it has none.
        lower: Smallest value that the law allows; at zero the effect is absent.
        upper: Largest one.
        default: Value of a device for which none is given; None if one has to be given.
        above_zero: True if no device has zero, though a search may come to it.
        plausible: Smallest and largest value that a sound device may have; outside it a size asks for a second look.
            None if nothing can be said.
        plausible_because: Where that range is from.
        listed: True if it is a list, as all parameters of that effect are then (the orders of a cogging torque).
        either_sign: True if it can be negative with nothing modelled, so that an undetected one is drawn with either
            sign.
        tried: Of a law alone, see `phantom_dyn.effects.user.law_effect`: values to try of a parameter that the torque
            is not linear in; empty where it is linear.
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

    The parameters are the contract's; where they are what the torque is linear in, they are the coefficients.

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
        """True if each reading belongs to one position of the joint, as any reading does without an encoder's error."""
        return True

    @abstractmethod
    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """The contract's parameters with units and bounds."""

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
        """The contract's parameters, in the order of `parameters`, from linear coefficients."""
        return coefficients

    def stated_law(
        self, robot: Robot, joint: str | None, shape: Shape, std: Float[Array, " k"], coefficients: Float[Array, " k"]
    ) -> tuple[tuple[Parameter, ...], Callable[[Array], Array]]:
        """What a finding states, and how it follows from the numbers of a fit: coefficients, then the shape's.

        By default the contract's parameters.

        Args:
            robot: The given model.
            joint: Where it sits.
            shape: Of the fit, where it is held.
            std: Deviations of the coefficients.
            coefficients: Of the fit.
        """
        count = len(coefficients)

        def law(x: Array) -> Array:
            return self.from_coefficients(robot, joint, x[:count], tuple(x[count:].tolist()) or shape)

        return self.parameters(robot, joint), law

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """Its columns as terms of a formula, where they have no shape and are of the inputs at that moment.

        Args:
            middle: Middle of what the recordings hold of an input, for a term that is written about it.
        """
        return ()

    def remark(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> str:
        """A sentence on what such a size says of this robot; empty if there is nothing to say."""
        return ""

    def from_stated(self, robot: Robot, stated: Stated) -> Stated:
        """The contract's parameters from what a finding or a file states: other numbers of the same, or older ones."""
        return stated

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Float[Array, " k"]]:
        """The parameter that says how large the effect is, and the coefficients of one unit of it.

        By default the first parameter, which is the only coefficient.
        """
        return self.parameters(robot, joint)[0].name, np.array([1.0])

    def probe_unit(self, robot: Robot, joint: str | None, name: str) -> str:
        """Unit of what `probe` names."""
        return next(parameter.unit for parameter in self.parameters(robot, joint) if parameter.name == name)

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Float[Array, " nv"]
    ) -> tuple[float, ...] | None:
        """The contract's parameters of an effect of a given size; None if the size alone does not determine them.

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
        """Torque that the effect adds on the joints (friction opposes motion), from the contract's parameters.

        For an effect of a reading, of the drive or of the transmission: minus the drive torque beyond the model's
        that the recording shows because of it.
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
        """The parameters as a simulation of that operation takes them, where something in it moves them slowly."""
        return theta

    @abstractmethod
    def simulated(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> Simulated:
        """How it enters a simulation, with the contract's parameters."""

    def model_numbers(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> ModelNumbers:
        """Its numbers in model files and control laws; by default the changed links or gravity, if that is all."""
        part = self.simulated(robot, joint, theta)
        others = (
            part.command, part.torque, part.reading, part.transmission, part.inertia, part.reference_delay
        )  # fmt: skip
        return ModelNumbers(whole=True, robot=part.robot) if all(x is None for x in others) else ModelNumbers()
