"""The given and the corrected model with all their effects, ready for simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from identification.diagnosis.columns.nuisances import ARRIVAL, BASE, SOFTNESS, moves_of
from identification.diagnosis.columns.operations import moved_robot
from identification.diagnosis.columns.own_effects import OwnEffect
from identification.diagnosis.columns.terms import KnownEffect, Term
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

_LARGEST = 1e12  # of a parameter: beyond, it was divided by what is nothing but rounding
LEAD, _SPRING_LEAD = 0.15, 0.03  # [s]


@dataclass(frozen=True, eq=False)
class Model:
    """A robot with the effects that act besides its rigid-body model.

    Attributes:
        robot: With all that only makes it another robot (friction, inertias, gravity).
        commands: Effects of the drives, from the controller on.
        causes: All other effects.
        late: Samples by which the recorded torque acts later than it stands in the log.
        late_references: Time [s] by which the references of each joint's controller arrive late, ``(nv,)``; None: none.
        soft: Joints whose modelled friction turns over softly, each with how much of the softness.
        arrivals: Joints whose references arrive later than half a frame before a reading, each by a part of a frame.
        base: Errors of the sensors on a base that is not bolted down, by name with their sizes.
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
        """How the causes enter a simulation of this robot."""
        return tuple(self._part(cause) for cause in self.causes)

    @cached_property
    def drives(self) -> tuple[Simulated, ...]:
        """Effects on the commands of the drives."""
        return tuple(self._part(cause) for cause in self.commands)

    @cached_property
    def transmissions(self) -> tuple[Transmission, ...]:
        """Motors that are not rigidly tied to their links."""
        return tuple(part.transmission for part in self.parts if part.transmission is not None)

    def longest_step(self, q: Float[Array, " nv"]) -> float:
        """Longest step [s] that follows the transmissions; infinite where all are rigid.

        Raises:
            ParameterError: If a motor without inertia would have to move by itself.
        """
        return longest_step(machine_of(self.robot, self.transmissions), q)

    def _part(self, cause: Cause) -> Simulated:
        return cause.effect.simulated(self.robot, cause.joint, cause.theta)

    @cached_property
    def moving(self) -> Robot:
        """The robot as simulations under a given torque take it: one, which keeps what they make of it."""
        return replace(self.robot, torque_hold="instant", torque_source="command")

    @property
    def settles(self) -> float:
        """Seconds along a recording after which states that no encoder reads are what the recording makes them.

        A spring's length is known from its load, and pulled for long it would only ring.
        """
        if any(part.gap > 0 for part in self.transmissions) or any(part.start.size for part in self.parts):
            return LEAD
        return _SPRING_LEAD if self.transmissions else 0.0


def model_of(robot: Robot, causes: tuple[Cause, ...], *, late: float = 0.0) -> Model:
    """The model with effects in it, without those that leave noise alone: a rounded reading moves nothing.

    Args:
        robot: Without them.
        causes: The effects, those of the drives from the controller on.
        late: Samples by which the recorded torque acts later than it stands in the log.

    Raises:
        RobotError: If a link would weigh nothing or less.
    """
    moved, commands, others = robot, [], []
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
            moved = part.robot(moved)
    return Model(moved, tuple(commands), tuple(others), late, late_references)


def known_causes(robot: Robot, known: tuple[KnownEffect, ...]) -> tuple[Cause, ...]:
    """Effects that belong to the given model."""
    return tuple(Cause(effect_named(one.effect, robot), one.joint, np.array(one.theta)) for one in known)


def found_causes(robot: Robot, terms: tuple[Term, ...], theta: Float[Array, " K"], recording: int) -> tuple[Cause, ...]:
    """Effects with the coefficients of one fit; structures that have no name and a load (see `loaded`) are left out.

    Args:
        robot: The given model.
        terms: In the fit.
        theta: Coefficients of all columns.
        recording: Effects that act in other recordings only are left out.

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
    """``robot`` with the load of one fit in a recording, as the inertial parameters that the fit has seen.

    The fit of a point mass is linearised: its mass alone need not be the one that its inertia is of, where the motion
    tells the inertia and not the mass.

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
    """The model of one recording with its moves within tolerance made and with the effects of one fit.

    Args:
        given: The given model.
        known: What belongs to it besides.
        terms: Effects in the fit.
        theta: Coefficients of all columns, moves within tolerance first.
        operation: Of the recording; its robot may carry a load that is known.

    Raises:
        RobotError: If a link would weigh nothing or less.
        ParameterError: If a parameter is not finite.
    """
    moves = moves_of(given)
    values = theta[: len(moves)]
    late = sum(float(x) for x, move in zip(values, moves, strict=True) if move.place is None)
    causes = (*known_causes(given, known), *found_causes(given, terms, theta, operation.recording))
    robot = loaded(moved_robot(operation.robot, values, given), terms, theta, operation.recording)
    soft, arrivals, base = (
        tuple((str(m.place), float(x)) for x, m in zip(values, moves, strict=True) if m.kind == kind and x)
        for kind in (SOFTNESS, ARRIVAL, BASE)
    )
    return replace(model_of(robot, at_work(causes, operation), late=late), soft=soft, arrivals=arrivals, base=base)


def at_work(causes: tuple[Cause, ...], operation: Operation) -> tuple[Cause, ...]:
    """The causes with their parameters as they are on average in an operation, where it moves them slowly."""
    return tuple(replace(one, theta=one.effect.at_work(operation, one.joint, one.theta)) for one in causes)
