"""What a whole model is made of, and where each of its numbers stands: moves, coefficients and shapes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identification.diagnosis.fitting import Fitted
from identification.diagnosis.moved_model import moved_operation, moved_robot
from identification.diagnosis.problem import Problem
from identification.diagnosis.terms import Term
from identification.known_changes.own_effect import OwnEffect
from identification.log import Log
from phantom_dyn.effects.actuator_lag import ActuatorLag
from phantom_dyn.effects.backlash import Backlash
from phantom_dyn.effects.base_tilt import BaseTilt
from phantom_dyn.effects.cogging import Cogging
from phantom_dyn.effects.encoder_eccentricity import EncoderEccentricity
from phantom_dyn.effects.encoder_offset import EncoderOffset
from phantom_dyn.effects.input_delay import InputDelay
from phantom_dyn.effects.load_dependent_friction import LoadDependentFriction
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.payload import Payload
from phantom_dyn.effects.transmission_compliance import TransmissionCompliance
from phantom_dyn.robot import Robot

Array = np.ndarray


@dataclass(frozen=True)
class Place:
    """Where the numbers of one term stand among all.

    Attributes:
        term: The effect with the shape that the search has found.
        coefficients: Of its columns; of a payload mass and first moments only.
        shape: Numbers of its shape that are moved; empty where there are none, or they follow the coefficients.
    """

    term: Term
    coefficients: slice
    shape: slice


@dataclass(frozen=True)
class Setting:
    """What a model is made of.

    Attributes:
        robot: The given model, or that with moves within its tolerances made.
        problem: Columns and fits in the judged band.
        logs: Recordings, ready for fitting.
        operations: Their motions with the torque of the robot.
        cutoff_hz: Edge of the judged band.
        places: Of all terms.
        size: How many numbers there are; the first are the moves within the tolerances.
        given: The given model.
    """

    robot: Robot
    problem: Problem
    logs: tuple[Log, ...]
    operations: tuple[Operation, ...]
    cutoff_hz: float
    places: tuple[Place, ...]
    size: int
    given: Robot

    @property
    def of_model(self) -> bool:
        """True if some column is made of the model's torque."""
        return any(of_model(place.term) for place in self.places)

    def moved(self, moves: Float[Array, " n"]) -> Setting:
        """The same with moves within the tolerances made, in what columns are made of."""
        robots = {id(self.given): moved_robot(self.given, moves)}
        operations = []
        for operation in self.problem.columns.operations:
            # A recording with a known load has a model of its own, with the same moves.
            loaded = operation.robot
            if id(loaded) not in robots:
                robots[id(loaded)] = moved_robot(loaded, moves, self.given)
            operations.append(moved_operation(operation, robots[id(loaded)]))
        return replace(self, robot=robots[id(self.given)], operations=tuple(operations))


def lay_out(
    robot: Robot, problem: Problem, logs: tuple[Log, ...], cutoff_hz: float, terms: tuple[Term, ...], found: Fitted
) -> tuple[Setting, Float[Array, " p"]]:
    """Where each number stands, and their values in a fit."""
    values, places = [found.theta[: problem.nuisances]], []
    start = problem.nuisances
    for term in terms:
        own = found.theta[list(term.columns)]
        own = own[:4] if isinstance(term.effect, Payload) else own
        held = term.effect.shape_is_estimate or isinstance(term.effect, Cogging)
        shape = np.array(() if held else term.shape, dtype=float)
        middle, stop = start + len(own), start + len(own) + len(shape)
        places.append(Place(term, slice(start, middle), slice(middle, stop)))
        values += [own, shape]
        start = stop
    setting = Setting(robot, problem, logs, problem.columns.operations, cutoff_hz, tuple(places), start, robot)
    return setting, np.concatenate(values)


def of_model(term: Term) -> bool:
    """True if the columns of an effect are made of the model's torque; the regressor's own are linear in the model."""
    effect = term.effect.inner if isinstance(term.effect, OwnEffect) else term.effect
    return isinstance(
        effect,
        ActuatorLag
        | Backlash
        | BaseTilt
        | EncoderEccentricity
        | EncoderOffset
        | InputDelay
        | LoadDependentFriction
        | TransmissionCompliance,
    )
