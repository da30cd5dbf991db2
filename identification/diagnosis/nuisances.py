"""What the tolerances of the model allow, as columns: moves of the model that are no gap."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from identification.log import Band
from phantom_dyn.effects.operation import Operation
from phantom_dyn.inertia import tolerance_directions
from phantom_dyn.robot import Robot

Array = np.ndarray


@dataclass(frozen=True)
class Nuisance:
    """A move of the model that its tolerance allows: relative change with one sigma, bounded at two.

    Attributes:
        name: What moves, for the report.
        sigma: One sigma of the change.
        bound: Largest change.
        relative: True if the change is relative to the modelled value (a timing shift is in samples).
    """

    name: str
    sigma: float
    bound: float
    relative: bool = True


@dataclass(frozen=True)
class Move:
    """A nuisance and what its column is made of.

    Attributes:
        nuisance: Name and size.
        kind: Inertial parameters of a body, friction or rotor of a joint, or the timing of all.
        place: Index of the body or of the joint; -1 for all.
        direction: Of the move among the ten parameters of the body.
    """

    nuisance: Nuisance
    kind: Literal["body", "viscous", "coulomb", "rotor", "timing"]
    place: int
    direction: Float[Array, " 10"] | None = None

    def touches(self, row: int) -> bool:
        """True if the move changes the torque of that joint."""
        return self.kind in {"body", "timing"} or self.place == row


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
    for j, joint in enumerate(robot.joint_names):
        if tolerance.friction > 0:
            if robot.viscous_friction[j] > 0:
                nuisance = Nuisance(f"{joint} viscous friction", tolerance.friction, 2 * tolerance.friction)
                out.append(Move(nuisance, "viscous", j))
            if robot.coulomb_friction[j] > 0:
                nuisance = Nuisance(f"{joint} Coulomb friction", tolerance.friction, 2 * tolerance.friction)
                out.append(Move(nuisance, "coulomb", j))
        if tolerance.rotor_inertia > 0 and robot.rotor_inertia[j] > 0:
            nuisance = Nuisance(f"{joint} rotor inertia", tolerance.rotor_inertia, 2 * tolerance.rotor_inertia)
            out.append(Move(nuisance, "rotor", j))
    # What is left of the alignment of torque and motion after the known part: a fraction of a sample.
    out.append(Move(Nuisance("timing of the torque", 0.25, 0.5, relative=False), "timing", -1))
    return tuple(out)


def move_columns(
    robot: Robot,
    operation: Operation,
    moves: tuple[Move, ...],
    body: Float[Array, "nv n p"],
    band: Band,
    narrow: Callable[[Array], Array],
) -> list[list[Float[Array, " n"]]]:
    """In-band columns of the moves that touch each row, in order.

    Args:
        robot: The given model.
        operation: One recording at the full rate.
        moves: Of `moves_of`.
        body: Columns of the rigid-body regressor in the band, by row.
        band: Filter of all columns.
        narrow: Filter of columns made of accelerations.
    """
    drift = narrow(band(np.gradient(operation.tau, axis=0)))
    v, direction, a = band(operation.v), band(np.sign(operation.v)), narrow(band(operation.a))
    rows: list[list[Array]] = []
    for j in range(robot.nv):
        columns: list[Array] = []
        for move in moves:
            if move.kind == "body":
                columns.append(body[j][:, 10 * (move.place - 1) : 10 * move.place] @ move.direction)
            elif move.kind == "timing":
                columns.append(drift[:, j])
            elif move.place == j:
                unit = {
                    "viscous": robot.viscous_friction[j] * v[:, j],
                    "coulomb": robot.coulomb_friction[j] * direction[:, j],
                    "rotor": robot.rotor_inertia[j] * a[:, j],
                }
                columns.append(unit[move.kind])
        rows.append(columns)
    return rows
