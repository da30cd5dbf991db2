"""The given and the corrected model with all their effects, ready for simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identification.diagnosis.columns.operations import adjusted_robot
from identification.diagnosis.columns.own_effects import OwnEffect
from identification.diagnosis.columns.terms import KnownEffect, Term
from identification.diagnosis.columns.tolerance_parameters import ARRIVAL, BASE, SOFTNESS, tolerance_parameters
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.simulated import Simulated, Transmission
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation.simulate import Cause
from phantom_dyn.simulation.stepping import longest_step, machine_of

_LARGEST = 1e12  # largest parameter: a larger one comes from a division by rounding errors
# Times [s] for which a model follows a recording until its hidden states no longer depend on their first values: in
# general, and where springs alone have such states.
LEAD, _SPRING_LEAD = 0.15, 0.03


@dataclass(frozen=True, eq=False)
class Model:
    """A robot with the effects that act in addition to its rigid-body model.

    Attributes:
        robot: The robot, including all effects that only change its parameters (friction, inertias, gravity).
        commands: Effects between the command of a controller and the torque of its drive.
        causes: All other effects.
        late: Delay of the recorded torque against the log [samples].
        late_references: Delay of the references of each joint's controller [s], ``(nv,)``; None without any.
        soft: Joints whose modelled dry friction changes sign gradually, each with its share of the full softness.
        arrivals: For joints whose references arrive at an unknown time in the controller's frame: how much later they
            arrive than half a frame before a reading, as a share of the frame.
        base: Name and size of each error of the sensors on a floating base.
    """

    robot: Robot
    commands: tuple[Cause, ...] = ()
    causes: tuple[Cause, ...] = ()
    late: float = 0.0
    late_references: Float[Array, " nv"] | None = None
    soft: tuple[tuple[str, float], ...] = ()
    arrivals: tuple[tuple[str, float], ...] = ()
    base: tuple[tuple[str, float], ...] = ()

    @cached_property
    def parts(self) -> tuple[Simulated, ...]:
        """The causes, in the form in which a simulation of this robot uses them."""
        return tuple(self._part(cause) for cause in self.causes)

    @cached_property
    def drives(self) -> tuple[Simulated, ...]:
        """The commands, in the form in which a simulation of this robot uses them."""
        return tuple(self._part(cause) for cause in self.commands)

    @cached_property
    def transmissions(self) -> tuple[Transmission, ...]:
        """Transmissions between motors and links that are not rigid."""
        return tuple(part.transmission for part in self.parts if part.transmission is not None)

    def longest_step(self, q: Float[Array, " nv"]) -> float:
        """Longest integration step [s] that resolves the transmissions; infinite if all are rigid.

        Raises:
            ParameterError: If a motor without inertia would have to move by itself.
        """
        return longest_step(machine_of(self.robot, self.transmissions), q)

    def _part(self, cause: Cause) -> Simulated:
        return cause.effect.simulated(self.robot, cause.joint, cause.theta)

    @cached_property
    def moving(self) -> Robot:
        """The robot for simulations under a given torque.

        It is made once, because simulations cache what they compute from a robot by the object.
        """
        return replace(self.robot, torque_hold="instant", torque_source="command")

    @property
    def settles(self) -> float:
        """Time [s] along a recording after which hidden states no longer depend on their first values.

        It is short for springs: their deflection follows from their load, and longer feedback would only make them
        oscillate.
        """
        if any(part.gap > 0 for part in self.transmissions) or any(part.start.size for part in self.parts):
            return LEAD
        return _SPRING_LEAD if self.transmissions else 0.0


def model_of(robot: Robot, causes: tuple[Cause, ...], *, late: float = 0.0) -> Model:
    """The model with effects, except those that only add noise to readings: they do not change the motion.

    Args:
        robot: The robot without the effects.
        causes: The effects; those of drives in their order from the controller to the joint.
        late: Delay of the recorded torque against the log [samples].

    Raises:
        RobotError: If a link would weigh nothing or less.
    """
    changed, commands, others = robot, [], []
    late_references: Array | None = None
    for cause in causes:
        if cause.effect.only_noise:
            continue
        part = cause.effect.simulated(robot, cause.joint, cause.theta)
        if part.reference_delay is not None:
            late_references = part.reference_delay + (0.0 if late_references is None else late_references)
        elif part.command is not None:
            commands.append(cause)
        elif any(x is not None for x in (part.torque, part.reading, part.transmission, part.inertia)):
            others.append(cause)
        elif part.robot is not None:
            changed = part.robot(changed)
    return Model(changed, tuple(commands), tuple(others), late, late_references)


def known_causes(robot: Robot, known: tuple[KnownEffect, ...]) -> tuple[Cause, ...]:
    """Effects that belong to the given model, with their parameters."""
    return tuple(Cause(effect_named(one.effect, robot), one.joint, np.array(one.theta)) for one in known)


def found_causes(robot: Robot, terms: tuple[Term, ...], theta: Float[Array, " K"], recording: int) -> tuple[Cause, ...]:
    """Effects with the coefficients of one fit, except structures that no effect names and loads (see `loaded`).

    Args:
        robot: The given model.
        terms: Effects in the fit.
        theta: Coefficients of all columns.
        recording: Index of the recording; effects that act only in others are left out.

    Raises:
        ParameterError: If a parameter is not finite.
    """
    out = []
    for term in terms:
        effect = term.effect
        elsewhere = isinstance(effect, OwnEffect) and effect.recording != recording
        if not isinstance(effect, Effect) or effect.inertial == "point mass" or elsewhere:
            continue
        values = np.array(effect.from_coefficients(robot, term.joint, theta[list(term.columns)], term.shape))
        if not np.abs(values).max() < _LARGEST:
            raise ParameterError(f"The size of {effect.name} is not a number that a simulation can use.")
        out.append(Cause(effect, term.joint, values))
    return tuple(out)


def loaded(robot: Robot, terms: tuple[Term, ...], theta: Float[Array, " K"], recording: int) -> Robot:
    """``robot`` with the load of one fit in a recording, by the ten inertial parameters that the fit used.

    The fit of a point mass is linearised: where the motion shows the inertia and not the mass, the fitted mass need not
    match the fitted inertia.

    Raises:
        RobotError: If a link would weigh nothing or less.
    """
    for term in terms:
        elsewhere = isinstance(term.effect, OwnEffect) and term.effect.recording != recording
        if term.effect.inertial == "point mass" and not elsewhere:
            added = np.zeros_like(standard_parameters(robot))
            added[list(term.effect.regressor_columns(robot, term.joint))] = theta[list(term.columns)]
            robot = with_parameters(robot, added)
    return robot


def corrected_model(
    given: Robot,
    known: tuple[KnownEffect, ...],
    terms: tuple[Term, ...],
    theta: Float[Array, " K"],
    operation: Operation,
) -> Model:
    """The model of one recording, changed within its tolerances and with the effects of one fit.

    Args:
        given: The given model.
        known: Effects that belong to the given model.
        terms: Effects in the fit.
        theta: Coefficients of all columns, those of the tolerance parameters first.
        operation: Motion of the recording; its robot may carry a known load.

    Raises:
        RobotError: If a link would weigh nothing or less.
        ParameterError: If a parameter is not finite.
    """
    parameters = tolerance_parameters(given)
    values = theta[: len(parameters)]
    late = sum(float(x) for x, parameter in zip(values, parameters, strict=True) if parameter.owner is None)
    causes = (*known_causes(given, known), *found_causes(given, terms, theta, operation.recording))
    robot = loaded(adjusted_robot(operation.robot, values, given), terms, theta, operation.recording)
    soft, arrivals, base = (
        tuple((str(p.owner), float(x)) for x, p in zip(values, parameters, strict=True) if p.kind == kind and x)
        for kind in (SOFTNESS, ARRIVAL, BASE)
    )
    return replace(model_of(robot, at_work(causes, operation), late=late), soft=soft, arrivals=arrivals, base=base)


def at_work(causes: tuple[Cause, ...], operation: Operation) -> tuple[Cause, ...]:
    """The causes at one operation: parameters that change slowly, as with temperature, have their mean over it."""
    return tuple(replace(one, theta=one.effect.at_work(operation, one.joint, one.theta)) for one in causes)
