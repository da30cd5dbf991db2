"""The torque of a whole model at one point of all its numbers, shapes included, and its slope to each of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from identification.diagnosis.fitting import Fitted
from identification.diagnosis.gap import in_judged_band
from identification.diagnosis.moved_model import moved_operation, moved_robot
from identification.diagnosis.point_mass import point_mass_map
from identification.diagnosis.problem import Problem
from identification.diagnosis.terms import Term
from identification.log import Log
from phantom_dyn.effects.actuator_lag import ActuatorLag
from phantom_dyn.effects.backlash import Backlash
from phantom_dyn.effects.base_tilt import BaseTilt
from phantom_dyn.effects.cogging import Cogging
from phantom_dyn.effects.effect import Shape
from phantom_dyn.effects.encoder_eccentricity import EncoderEccentricity
from phantom_dyn.effects.encoder_offset import EncoderOffset
from phantom_dyn.effects.input_delay import InputDelay
from phantom_dyn.effects.load_dependent_friction import LoadDependentFriction
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.payload import Payload
from phantom_dyn.effects.torque_constant import TorqueConstant
from phantom_dyn.effects.transmission_compliance import TransmissionCompliance
from phantom_dyn.robot import Robot

Array = np.ndarray

# Step of a difference in a shape, in shares of it: what is made of samples (a bristle, a play) changes in jumps.
_STEP = 0.03


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
    """

    robot: Robot
    problem: Problem
    logs: tuple[Log, ...]
    operations: tuple[Operation, ...]
    cutoff_hz: float
    places: tuple[Place, ...]
    size: int

    @property
    def of_model(self) -> bool:
        """True if some column is made of the model's torque."""
        return any(_of_model(place.term) for place in self.places)

    def moved(self, moves: Float[Array, " n"]) -> Setting:
        """The same with moves within the tolerances made, in what columns are made of."""
        given = self.problem.columns.operations
        robot = moved_robot(given[0].robot, moves)
        return replace(self, robot=robot, operations=tuple(moved_operation(operation, robot) for operation in given))


@dataclass(frozen=True)
class Linearised:
    """A model about a point, for each log: torque beyond the given model's, and its slopes.

    Attributes:
        torque: ``(n, nv)`` each.
        slopes: ``(n, nv, p)`` each.
    """

    torque: tuple[Float[Array, "n nv"], ...]
    slopes: tuple[Float[Array, "n nv p"], ...]


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
    setting = Setting(robot, problem, logs, problem.columns.operations, cutoff_hz, tuple(places), start)
    return setting, np.concatenate(values)


def _of_model(term: Term) -> bool:
    """True if the columns of an effect are made of the model's torque; the regressor's own are linear in the model."""
    return isinstance(
        term.effect,
        ActuatorLag
        | Backlash
        | BaseTilt
        | EncoderEccentricity
        | EncoderOffset
        | InputDelay
        | LoadDependentFriction
        | TransmissionCompliance,
    )


def linearised(setting: Setting, x: Float[Array, " p"]) -> Linearised:
    """The model about a point."""
    return Linearised(*zip(*(_one_log(setting, x, log) for log in range(len(setting.logs))), strict=True))


def change_by_model(setting: Setting, moved: Setting, x: Float[Array, " p"]) -> tuple[Float[Array, "n nv"], ...]:
    """Torque of the terms more when their columns are made of another model, for each log ``(n, nv)``."""
    out = [np.zeros_like(residual) for residual in setting.problem.white.residual]
    for log, change in enumerate(out):
        for place in setting.places:
            if _of_model(place.term):
                own, shape = x[place.coefficients], x[place.shape]
                change += _law(moved, place, own, shape, log) - _law(setting, place, own, shape, log)
    return tuple(out)


def _one_log(setting: Setting, x: Float[Array, " p"], log: int) -> tuple[Float[Array, "n nv"], Float[Array, "n nv p"]]:
    problem = setting.problem
    moves = np.arange(problem.nuisances)
    n, nv = problem.white.residual[log].shape
    slopes = np.zeros((n, nv, setting.size))
    slopes[:, :, moves] = _columns(problem, tuple(moves.tolist()), log)
    torque = slopes[:, :, moves] @ x[moves]
    gains = [place for place in setting.places if isinstance(place.term.effect, TorqueConstant)]
    for place in setting.places:
        if place not in gains:
            at = [
                *range(place.coefficients.start, place.coefficients.stop),
                *range(place.shape.start, place.shape.stop),
            ]
            own, slopes[:, :, at] = _with_slopes(setting, place, x[place.coefficients], x[place.shape], log)
            torque += own
    for place in gains:
        # A torque constant scales the whole of its row, what is found beside it included.
        column = _columns(problem, place.term.columns, log)[:, :, 0]
        rows = np.any(column != 0, axis=0)
        gain = x[place.coefficients][0]
        slopes[:, rows] *= 1.0 + gain
        slopes[:, rows, place.coefficients.start] = column[:, rows] + torque[:, rows]
        torque[:, rows] += gain * (column[:, rows] + torque[:, rows])
    return torque, slopes


def _with_slopes(
    setting: Setting, place: Place, own: Float[Array, " k"], shape: Float[Array, " m"], log: int
) -> tuple[Float[Array, "n nv"], Float[Array, "n nv p"]]:
    """Torque of one term, and its slopes to the coefficients and the shape."""
    effect = place.term.effect
    if isinstance(effect, Payload):
        columns = _columns(setting.problem, place.term.columns, log)
        jacobian, offset = point_mass_map(own)
        return columns @ (jacobian @ own + offset), columns @ jacobian

    def slope(k: int) -> Float[Array, "n nv"]:
        numbers = np.concatenate([own, shape])
        mine = own if k < len(own) else shape[k - len(own) :][:1]
        step = np.zeros(len(numbers))
        step[k] = _STEP * max(float(np.abs(mine).max()), 1e-9)
        above, below = (
            _law(setting, place, x[: len(own)], x[len(own) :], log) for x in (numbers + step, numbers - step)
        )
        return (above - below) / (2.0 * step[k])

    if effect.shape_is_estimate or isinstance(effect, EncoderEccentricity):
        return _law(setting, place, own, shape, log), np.stack([slope(k) for k in range(len(own))], axis=-1)
    columns = _at_shape(setting, place, tuple(shape.tolist()) or place.term.shape, log)
    more = [slope(len(own) + k)[:, :, None] for k in range(len(shape))]
    return columns @ own, np.concatenate([columns, *more], axis=2)


def _law(
    setting: Setting, place: Place, own: Float[Array, " k"], shape: Float[Array, " m"], log: int
) -> Float[Array, "n nv"]:
    """Torque of one term, in the judged band."""
    term = place.term
    if isinstance(term.effect, EncoderEccentricity):
        # The columns are to first order in the amplitude, the law is not.
        theta = term.effect.from_coefficients(setting.robot, term.joint, own, ())
        torque = -term.effect.torque(setting.robot, setting.operations[log], term.joint, theta)
        return _in_band(setting, log, torque, accelerations=True)
    at = tuple(shape.tolist()) or term.shape
    if term.effect.shape_is_estimate:
        # A law that takes its own parameter as shape is exact where they agree.
        near = term.effect.refined(own, term.shape)
        at = near[len(near) // 2]
    return _at_shape(setting, place, at, log) @ own


def _columns(problem: Problem, wanted: tuple[int, ...], log: int) -> Float[Array, "n nv k"]:
    """Columns of the problem in the judged band, zero on rows that they do not touch."""
    white = problem.white
    out = np.zeros((*white.residual[log].shape, len(wanted)))
    for j, index in enumerate(white.rows):
        there = {column: k for k, column in enumerate(index)}
        for k, column in enumerate(wanted):
            if column in there:
                out[:, j, k] = white.values[log][j][:, there[column]]
    return out


def _at_shape(setting: Setting, place: Place, shape: Shape, log: int) -> Float[Array, "n nv k"]:
    """Columns of an effect at a shape, in the judged band."""
    term = place.term
    if shape == term.shape and not _of_model(term):
        return _columns(setting.problem, term.columns, log)
    operation = setting.operations[log]
    signature = term.effect.signature(setting.robot, operation, term.joint, shape)
    if signature.steps is None:
        narrow = _in_band(setting, log, signature.columns, accelerations=term.effect.uses_acceleration)
    else:
        narrow = _in_band(
            setting, log, signature.columns - signature.steps, accelerations=term.effect.uses_acceleration
        )
        narrow = narrow + _in_band(setting, log, signature.steps, accelerations=False)
    out = np.zeros((len(narrow), setting.robot.nv, narrow.shape[2]))
    out[:, list(signature.rows)] = narrow
    return out


def _in_band(setting: Setting, log: int, x: Float[Array, "N ..."], *, accelerations: bool) -> Float[Array, "n ..."]:
    """Series in the judged band as the columns of the problem are: of accelerations it is filtered once more."""
    record = setting.logs[log]
    x = record.band(x)
    if accelerations:
        x = in_judged_band((x,), (record,), setting.cutoff_hz)[0]
    return in_judged_band((x,), (record,), setting.cutoff_hz)[0]
