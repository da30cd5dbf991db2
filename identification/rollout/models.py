"""The given and the corrected model as simulations take them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from identification.diagnosis.moved_model import moved_robot
from identification.diagnosis.nuisances import moves_of
from identification.diagnosis.terms import KnownEffect, Term
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Effect, Simulated
from phantom_dyn.effects.encoder_quantization import EncoderQuantization
from phantom_dyn.errors import ParameterError
from phantom_dyn.robot import Robot
from phantom_dyn.simulation import Cause

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Model:
    """A robot with what it has besides its model.

    Attributes:
        robot: With all that only makes it another robot (friction, inertias, gravity).
        commands: Effects of the drives, from the controller on.
        causes: All other effects.
        late: Samples by which the recorded torque acts later than it stands in the log.
    """

    robot: Robot
    commands: tuple[Cause, ...] = ()
    causes: tuple[Cause, ...] = ()
    late: float = 0.0

    def part(self, cause: Cause) -> Simulated:
        """How an effect enters a simulation of this robot."""
        return cause.effect.simulated(self.robot, cause.joint, cause.theta)

    @property
    def remembers(self) -> bool:
        """True if an effect besides those of the drives has a state that no encoder reads."""
        parts = [self.part(cause) for cause in self.causes]
        return any(part.start.size or part.transmission is not None for part in parts)


def model_of(robot: Robot, causes: tuple[Cause, ...], *, late: float = 0.0) -> Model:
    """The model with effects in it; a rounded reading is left out, as it moves nothing.

    Args:
        robot: Without them.
        causes: The effects, those of the drives from the controller on.
        late: See `Model`.

    Raises:
        RobotError: If a link would weigh nothing or less.
    """
    moved, commands, others = robot, [], []
    for cause in causes:
        if isinstance(cause.effect, EncoderQuantization):
            continue
        part = cause.effect.simulated(robot, cause.joint, cause.theta)
        moved = moved if part.robot is None else part.robot(moved)
        if part.command is not None:
            commands.append(cause)
        elif any(x is not None for x in (part.torque, part.reading, part.transmission, part.inertia)):
            others.append(cause)
    return Model(moved, tuple(commands), tuple(others), late)


def known_causes(known: tuple[KnownEffect, ...]) -> tuple[Cause, ...]:
    """Effects that belong to the given model."""
    return tuple(Cause(effect_named(one.effect), one.joint, np.array(one.theta)) for one in known)


def found_causes(robot: Robot, terms: tuple[Term, ...], theta: Float[Array, " K"]) -> tuple[Cause, ...]:
    """Effects with the coefficients of one fit; structures that have no name are left out.

    Args:
        robot: The given model.
        terms: In the fit.
        theta: Coefficients of all columns.

    Raises:
        ParameterError: If a parameter is not finite.
    """
    out = []
    for term in terms:
        if not isinstance(term.effect, Effect):
            continue
        values = np.array(term.effect.from_coefficients(robot, term.joint, theta[list(term.columns)], term.shape))
        if not np.isfinite(values).all():
            raise ParameterError(f"The size of {term.effect.name} is not finite.")
        out.append(Cause(term.effect, term.joint, values))
    return tuple(out)


def corrected_model(
    robot: Robot, known: tuple[KnownEffect, ...], terms: tuple[Term, ...], theta: Float[Array, " K"]
) -> Model:
    """The model with its moves within tolerance made and with the effects of one fit.

    Args:
        robot: The given model.
        known: What belongs to it besides.
        terms: Effects in the fit.
        theta: Coefficients of all columns, moves within tolerance first.

    Raises:
        RobotError: If a link would weigh nothing or less.
        ParameterError: If a parameter is not finite.
    """
    moves = moves_of(robot)
    values = theta[: len(moves)]
    late = sum(float(x) for x, move in zip(values, moves, strict=True) if move.place is None)
    causes = (*known_causes(known), *found_causes(robot, terms, theta))
    return model_of(moved_robot(robot, values), causes, late=late)
