"""Interface of an effect of the catalogue: a named cause of a gap between robot and model, such as Coulomb friction.

Every effect defines a name, a regime, words, `Effect.parameters`, its law `Effect.torque`, its columns
`Effect.signature` and its part in a simulation `Effect.simulated`. Everything else has a default, which is right for a
torque on one joint that is linear in its parameters; other effects override an attribute or a small method. Relations
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

Stated = Mapping[str, float | list[float]]
"""Values of parameters by name, as in a finding or a file: numbers, or lists if the effect takes lists."""


@dataclass(frozen=True)
class Parameter:
    """Name, unit and range of one parameter of an effect.

    Attributes:
        name: Name in files and in the catalogue.
        unit: SI; ``1`` if it has none.
        lower: Smallest value that the law allows.
        upper: Largest value that the law allows.
        default: Value if the description of a simulated device does not state the parameter; None if it must.
        above_zero: True if the value zero is impossible for a device, although a search may reach it.
        plausible: Smallest and largest value of a sound device; a finding outside has to be checked. None if unknown.
        plausible_because: Reason for this range.
        listed: True if the parameter is a list, as the orders of a cogging torque; then all parameters of the effect
            are lists.
        either_sign: True if the parameter can be negative even if the model has none of the effect. For an effect that
            was not detected, values of both signs are then drawn.
        tried: For a `LawEffect`: values to try of a parameter in which the torque is not linear; otherwise empty.
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
    """One named cause of a gap between robot and model.

    An argument ``theta`` holds the values of the parameters of `parameters`, in their order. If the torque is linear in
    the parameters, ``theta`` is equal to the coefficients of the columns of `signature`.

    Attributes:
        words: Words for reports.
        changes_with: Kind of known change between two recordings that may change the effect: of friction, of
            temperature (which changes friction too), or of the controller; None if there is none.
    """

    words: EffectWords
    changes_with: Literal["friction", "temperature", "controller"] | None = None

    @property
    def displaces(self) -> bool:
        """True if the effect has its own `true_motion`."""
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
        """Further parameters of the law, for simulated devices only; a device has all of them or none."""
        return ()

    def can_sit(self, robot: Robot, joint: str | None) -> bool:
        """True if a robot can have the effect on this joint; a search may try fewer joints (`places`)."""
        places = self.places(robot)
        if self.shared and joint is not None and "+" in joint:
            return all(name in places for name in joint.split("+"))
        return joint in places

    def from_coefficients(
        self, robot: Robot, joint: str | None, coefficients: Float[Array, " k"], shape: Shape
    ) -> Float[Array, " p"]:
        """Parameters of the effect, in the order of `parameters`, from linear coefficients."""
        return coefficients

    def stated_law(
        self, robot: Robot, joint: str | None, shape: Shape, std: Float[Array, " k"], coefficients: Float[Array, " k"]
    ) -> tuple[tuple[Parameter, ...], Callable[[Array], Array]]:
        """Parameters that a finding states, and the function that computes them from the coefficients of a fit.

        By default these are the effect's parameters. The argument of the function is an array of the coefficients,
        which an estimated shape may follow.

        Args:
            robot: The given model.
            joint: Joint of the effect.
            shape: Shape of the fit, used if no estimated shape follows the coefficients.
            std: Standard deviations of the coefficients.
            coefficients: Coefficients of the fit.
        """
        count = len(coefficients)

        def law(x: Array) -> Array:
            return self.from_coefficients(robot, joint, x[:count], tuple(x[count:].tolist()) or shape)

        return self.parameters(robot, joint), law

    def formula(self, middle: Callable[[str], float]) -> tuple[FormulaTerm, ...]:
        """Terms for the library of formulas: the columns, if they have no shape and depend on the current inputs only.

        Args:
            middle: Function that returns the middle of the recorded values of an input; some terms subtract it.
        """
        return ()

    def remark(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> str:
        """A sentence on the meaning of these parameter values for this robot; empty if there is none."""
        return ""

    def from_stated(self, robot: Robot, stated: Stated) -> Stated:
        """Parameters of the effect, from those of a finding or a file, which may have other or older names."""
        return stated

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Float[Array, " k"]]:
        """Name of the parameter that is the size of the effect, and the coefficients of an effect of size one.

        With these the limit of detection is computed. By default the size is the first parameter and only coefficient.
        """
        return self.parameters(robot, joint)[0].name, np.array([1.0])

    def probe_unit(self, robot: Robot, joint: str | None, name: str) -> str:
        """Unit of the parameter whose name `probe` returns."""
        return next(parameter.unit for parameter in self.parameters(robot, joint) if parameter.name == name)

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Float[Array, " nv"]
    ) -> tuple[float, ...] | None:
        """Parameters of the effect with a given size; None if the size alone does not determine them.

        Args:
            robot: The given model.
            joint: Joint of the effect.
            name: Name of the parameter, from `probe`.
            size: Value of this parameter.
            posture: Mean positions of the joints [rad or m].
        """
        known = self.parameters(robot, joint)
        return (size,) if [parameter.name for parameter in known] == [name] else None

    @abstractmethod
    def torque(
        self, robot: Robot, operation: Operation, joint: str | None, theta: Float[Array, " p"]
    ) -> Float[Array, "N nv"]:
        """Torque that the effect adds on the joints; friction, for example, opposes the motion.

        An effect of an encoder, a drive or a transmission returns minus the additional drive torque in the recording.
        """

    def looks_like(
        self, robot: Robot, operation: Operation, joint: str | None, other: str, theta: Float[Array, " p"]
    ) -> bool:
        """True if the recording cannot show the effect because it looks like another effect on the same joint.

        Args:
            robot: Model.
            operation: Motion and torque of the recording.
            joint: Joint of both effects.
            other: Name of the other effect.
            theta: Parameters of the other effect.
        """
        return False

    def link_ahead(
        self, operation: Operation, joint: str | None, theta: Float[Array, " p"]
    ) -> Float[Array, "N nv"] | None:
        """How far links are ahead of their motors [rad or m]; None for rigid transmissions."""
        return None

    def true_motion(
        self, robot: Robot, motion: Motion, joint: str | None, theta: Float[Array, " p"]
    ) -> tuple[Robot, Motion]:
        """The robot with its true gravity, and the true motion of its links; by default both as given."""
        return robot, motion

    def at_work(self, operation: Operation, joint: str | None, theta: Float[Array, " p"]) -> Float[Array, " p"]:
        """Parameters for a simulation of this operation; friction, for example, depends on its mean temperature."""
        return theta

    @abstractmethod
    def simulated(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> Simulated:
        """What the effect changes in a simulation."""

    def model_numbers(self, robot: Robot, joint: str | None, theta: Float[Array, " p"]) -> ModelNumbers:
        """Numbers for model files and control laws; by default the changed robot, if the effect has no other part."""
        made = self.simulated(robot, joint, theta)
        others = (
            made.command, made.torque, made.reading, made.transmission, made.inertia, made.reference_delay
        )  # fmt: skip
        return ModelNumbers(whole=True, robot=made.robot) if all(x is None for x in others) else ModelNumbers()
