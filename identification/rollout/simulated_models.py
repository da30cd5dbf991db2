"""Builds the given and the corrected model, with their effects in the form that simulations need."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identification.diagnosis.columns.one_recording_effects import OneRecordingEffect
from identification.diagnosis.columns.operations import adjusted_robot
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

_LARGEST = 1e12  # a larger parameter comes from a division by rounding errors
# Times [s] for which a model has to follow a recording until its hidden states do not depend on their initial values:
# in general, and if only springs have hidden states.
LEAD, _SPRING_SETTLING_S = 0.15, 0.03


@dataclass(frozen=True, eq=False)
class Model:
    """A robot with the effects that act in addition to its rigid-body model.

    Attributes:
        robot: The robot, including all effects that only change its parameters (friction, inertias, gravity).
        commands: Effects between the command of a controller and the torque of its drive.
        causes: All other effects.
        late: Delay of the recorded torque relative to the motion of the log [samples].
        late_references: Delay of the references of each joint's controller [s], ``(nv,)``; None if there is none.
        soft: Joints whose modelled dry friction changes sign gradually, each with its share of the full softness.
        arrivals: Joints whose references arrive at an unknown time within the controller's period, each with this time
            as a share of the period, counted from half a period before a reading.
        base: Name and size of each sensor error of a floating base.
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
    def simulated_causes(self) -> tuple[Simulated, ...]:
        """The causes in the form that a simulation of this robot uses."""
        return tuple(self._simulated(cause) for cause in self.causes)

    @cached_property
    def simulated_commands(self) -> tuple[Simulated, ...]:
        """The commands in the form that a simulation of this robot uses."""
        return tuple(self._simulated(cause) for cause in self.commands)

    @cached_property
    def transmissions(self) -> tuple[Transmission, ...]:
        """Transmissions between motors and links that are not rigid."""
        return tuple(part.transmission for part in self.simulated_causes if part.transmission is not None)

    def longest_step(self, q: Float[Array, " nv"]) -> float:
        """Longest integration step [s] that resolves the transmissions; infinite if all are rigid.

        Raises:
            ParameterError: If a motor behind an elastic transmission has no inertia.
        """
        return longest_step(machine_of(self.robot, self.transmissions), q)

    def _simulated(self, cause: Cause) -> Simulated:
        """A cause in the form that a simulation of this robot uses."""
        return cause.effect.simulated(self.robot, cause.joint, cause.theta)

    @cached_property
    def torque_driven(self) -> Robot:
        """The robot for simulations with a given drive torque.

        It is built once, because simulations cache results by this object.
        """
        return replace(self.robot, torque_hold="instant", torque_source="command")

    @property
    def settling_time(self) -> float:
        """Time [s] for which the model has to follow a recording until hidden states do not depend on initial values.

        The time is short if only springs have hidden states: their initial deflection follows from the load, and
        feedback to the recording makes them oscillate.
        """
        if any(part.gap > 0 for part in self.transmissions) or any(part.start.size for part in self.simulated_causes):
            return LEAD
        return _SPRING_SETTLING_S if self.transmissions else 0.0


def model_of(robot: Robot, causes: tuple[Cause, ...], *, late: float = 0.0) -> Model:
    """The model of a robot with effects. Effects that only add noise to readings are left out.

    Args:
        robot: The robot without the effects.
        causes: The effects. Effects of drives are applied in the given order, from the controller to the joint.
        late: Delay of the recorded torque relative to the motion of the log [samples].

    Raises:
        RobotError: If the mass of a link would not be positive.
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
    """Effects with the coefficients of one fit; left out are loads (see `with_load`), and terms outside the catalogue.

    Args:
        robot: The given model.
        terms: Effects in the fit.
        theta: Coefficients of all columns.
        recording: Index of the recording; effects that act only in other recordings are left out.

    Raises:
        ParameterError: If a parameter is not finite.
    """
    out = []
    for term in terms:
        effect = term.effect
        elsewhere = isinstance(effect, OneRecordingEffect) and effect.recording != recording
        if not isinstance(effect, Effect) or effect.inertial == "point mass" or elsewhere:
            continue
        values = np.array(effect.from_coefficients(robot, term.joint, theta[list(term.columns)], term.shape))
        if not np.abs(values).max() < _LARGEST:
            raise ParameterError(f"The size of {effect.name} is not a number that a simulation can use.")
        out.append(Cause(effect, term.joint, values))
    return tuple(out)


def with_load(robot: Robot, terms: tuple[Term, ...], theta: Float[Array, " K"], recording: int) -> Robot:
    """The robot with the load of one recording, given by its ten fitted inertial parameters.

    All ten parameters are used because the fit of a point mass is linearised: if the motion determines the inertia but
    not the mass, the fitted mass and inertia need not be those of one point mass.

    Raises:
        RobotError: If the mass of a link would not be positive.
    """
    for term in terms:
        elsewhere = isinstance(term.effect, OneRecordingEffect) and term.effect.recording != recording
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
    """The model for one recording: the given one, changed within its tolerances, with the effects of one fit.

    Args:
        given: The given model.
        known: Effects that belong to the given model.
        terms: Effects in the fit.
        theta: Coefficients of all columns, those of the tolerance parameters first.
        operation: Motion of the recording; its robot may carry a known load.

    Raises:
        RobotError: If the mass of a link would not be positive.
        ParameterError: If a parameter is not finite.
    """
    parameters = tolerance_parameters(given)
    values = theta[: len(parameters)]
    late = sum(float(x) for x, parameter in zip(values, parameters, strict=True) if parameter.owner is None)
    causes = (*known_causes(given, known), *found_causes(given, terms, theta, operation.recording))
    robot = with_load(adjusted_robot(operation.robot, values, given), terms, theta, operation.recording)
    soft, arrivals, base = (
        tuple((str(p.owner), float(x)) for x, p in zip(values, parameters, strict=True) if p.kind == kind and x)
        for kind in (SOFTNESS, ARRIVAL, BASE)
    )
    return replace(model_of(robot, at_work(causes, operation), late=late), soft=soft, arrivals=arrivals, base=base)


def at_work(causes: tuple[Cause, ...], operation: Operation) -> tuple[Cause, ...]:
    """The causes during one recording: parameters that change slowly, as with temperature, have their mean values."""
    return tuple(replace(one, theta=one.effect.at_work(operation, one.joint, one.theta)) for one in causes)
