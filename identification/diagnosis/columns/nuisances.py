"""Nuisance columns: moves (changes) of the model within its stated tolerances, whose torque is not part of the gap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from identification.data.floating.base_errors import SENSOR_ERRORS, torque_per_base_error
from identification.data.log import Log
from identification.diagnosis.columns.motion.soft_friction import soft_joints, softness
from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.rows import modelled_friction_of
from phantom_dyn.model.inertia import tolerance_directions
from phantom_dyn.model.robot import Robot

TIMING = "timing"
"""Kind of the move that shifts all torques in time."""
SOFTNESS = "softness"
"""Kind of the move to soft dry friction, which changes sign gradually as in MuJoCo."""
ARRIVAL = "arrival"
"""Kind of the move that shifts the arrival of a joint's references within a frame."""
BASE = "base"
"""Kind of the move of an error of the sensors on a base that is not bolted down."""
OF_THE_RECORDING = (TIMING, SOFTNESS, ARRIVAL, BASE)
"""Kinds of moves that change no number of the model."""


@dataclass(frozen=True)
class Nuisance:
    """Size of a move, a change of the model that its tolerance allows: sigma of the prior, and bound.

    Attributes:
        name: Name of the changed quantity in the report.
        sigma: Standard deviation of the change.
        bound: Largest change.
        relative: True if the change is relative to the modelled value. Else a shift of all torques or of references is
            in samples, softness of friction relative to that of the simulator of the robot's file, and errors of the
            base's sensors in SI units.
    """

    name: str
    sigma: float
    bound: float
    relative: bool = True


@dataclass(frozen=True)
class Move:
    """A nuisance and the parameter of the model that it moves.

    Attributes:
        nuisance: Name and size of the move.
        kind: Inertial parameters of a body, friction or rotor of a joint, softness of its friction, arrival of its
            references, an error of the base's sensors, or the timing of all torques.
        place: Index of the body, name of the joint or of the error; None for all.
        direction: Direction of the move in the ten inertial parameters of the body.
    """

    nuisance: Nuisance
    kind: str
    place: int | str | None
    direction: Float[Array, " 10"] | None = None


def bodies_on(robot: Robot, row: int) -> tuple[int, ...]:
    """Bodies that the drive of a joint moves, in Pinocchio's order: those behind it, or in closed chains all."""
    if robot.chain is not None:
        return tuple(range(1, robot.model.njoints))
    return tuple(sorted(robot.model.subtrees[robot.model.getJointId(robot.joint_names[row])]))


def touching(robot: Robot, moves: tuple[Move, ...]) -> tuple[tuple[int, ...], ...]:
    """Indices of the moves that may change the torque of each joint; those of a passive joint may change all.

    The bodies behind a joint are read from Pinocchio once a row and not once a move: that takes most of the time.
    """
    # Moves of one place: of a body, by its index, or of an active joint, by its name.
    placed = [isinstance(move.place, int) or move.place in robot.joint_names for move in moves]
    out = []
    for row, own in enumerate(robot.joint_names):
        here = {*bodies_on(robot, row), own}
        out.append(tuple(k for k, move in enumerate(moves) if move.place in here or not placed[k]))
    return tuple(out)


def moves_of(robot: Robot) -> tuple[Move, ...]:
    """All moves that the tolerances of a robot allow."""
    out: list[Move] = []
    tolerance = robot.tolerance
    if tolerance.inertia > 0:
        for body in range(1, robot.model.njoints):
            directions, names = tolerance_directions(robot, body)
            for k, name in enumerate(names):
                if np.any(directions[:, k]):
                    nuisance = Nuisance(name, tolerance.inertia, 2 * tolerance.inertia)
                    out.append(Move(nuisance, "body", body, directions[:, k]))
    for joint in (*robot.joint_names, *robot.passive_names):
        viscous, coulomb = modelled_friction_of(robot, joint)
        rotor = robot.rotor_inertia[robot.joint_names.index(joint)] if joint in robot.joint_names else 0.0
        modelled = (
            ("viscous", "viscous friction", viscous, tolerance.friction),
            ("coulomb", "Coulomb friction", coulomb, tolerance.friction),
            ("rotor", "rotor inertia", rotor, tolerance.rotor_inertia),
        )
        for kind, words, value, sigma in modelled:
            if value > 0 and sigma > 0:
                out.append(Move(Nuisance(f"{joint} {words}", sigma, 2 * sigma), kind, joint))
    for joint in soft_joints(robot):
        # A recording of the file's simulator has its soft friction; a robot may have less or none.
        out.append(Move(Nuisance(f"{joint} softness of friction", 1.0, 2.0, relative=False), SOFTNESS, joint))
    for joint in robot.unknown_arrivals:
        # The arrival is uniform over a frame: its deviation is 1 / sqrt(12) of the frame.
        out.append(Move(Nuisance(f"{joint} arrival of references", 0.29, 0.5, relative=False), ARRIVAL, joint))
    if robot.floating:
        for name, sigma in SENSOR_ERRORS.items():
            out.append(Move(Nuisance(name, sigma, 2 * sigma, relative=False), BASE, name))
    # The unknown part of the alignment of torque and motion: a fraction of a sample.
    out.append(Move(Nuisance("timing of the torque", 0.25, 0.5, relative=False), TIMING, None))
    return tuple(out)


def columns_of_moves(
    robot: Robot,
    operation: Operation,
    moves: tuple[Move, ...],
    body: Float[Array, "nv n p"],
    log: Log,
    narrow: Callable[[Array], Array],
) -> list[list[Float[Array, " n"]]]:
    """For each joint, the columns in the band of the moves that may change its torque, in the order of the moves.

    Args:
        robot: The given model.
        operation: One recording at the full rate.
        moves: The moves, as `moves_of` returns them.
        body: Columns of the rigid-body regressor in the band, by row.
        log: The recording, with the filter of all columns.
        narrow: Filter of columns made of accelerations.
    """
    band = log.band
    drift = narrow(band(np.gradient(operation.tau, axis=0)))
    rows: list[list[Array]] = [[] for _ in range(robot.nv)]
    touched = touching(robot, moves)
    of_base = torque_per_base_error(robot, log, operation) if log.base_sensors is not None else {}
    for index, move in enumerate(moves):
        if isinstance(move.place, int):
            change = body[:, :, 10 * (move.place - 1) : 10 * move.place] @ move.direction
        elif move.place is None:
            change = drift.T
        elif move.kind == BASE:
            change = narrow(band(of_base[str(move.place)])).T
        elif move.kind == SOFTNESS:
            change = band(softness(robot, operation, move.place)).T
        elif move.kind == ARRIVAL:
            change = np.zeros_like(drift.T)
            row = robot.joint_names.index(move.place)
            if log.arrival is not None:
                change[row] = -band(log.arrival[:, row])
        else:
            # The column of the effect of this quantity, times the modelled value.
            value, effect = _modelled(robot, move.kind, move.place)
            signature = effect.signature(robot, operation, move.place, ())
            change = np.zeros_like(drift.T)
            for k, row in enumerate(signature.rows):
                column = band(signature.columns[:, k, 0])
                change[row] = value * (narrow(column) if effect.uses_acceleration else column)
        for j in range(robot.nv):
            if index in touched[j]:
                rows[j].append(change[j])
    return rows


def _modelled(robot: Robot, kind: str, joint: str) -> tuple[float, Effect]:
    """Modelled value of one quantity of a joint, and the effect that adds to it."""
    if kind == "rotor":
        return float(robot.rotor_inertia[robot.joint_names.index(joint)]), effect_named("rotor_inertia")
    viscous, coulomb = modelled_friction_of(robot, joint)
    value = viscous if kind == "viscous" else coulomb
    return value, effect_named(f"{kind}_friction")
