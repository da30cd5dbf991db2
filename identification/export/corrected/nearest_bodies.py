# pyright: reportAttributeAccessIssue=false
"""The nearest possible bodies to estimated ones that cannot exist.

A body is possible if its pseudo-inertia, the four by four matrix of its moments of order zero to two, has no negative
eigenvalue [Wensing]_. In the nearest one the negative eigenvalues are raised, with lengths in units of the body's own
radius of gyration, so that mass and moments have the same weight.

References:
    .. [Wensing] P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial
       parameter identification, IEEE Robotics and Automation Letters 3(1), 2018.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from identification.estimators.consistent.consistent_bodies import pseudo_inertia, standard_of
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.inertia import body_name, breaks_triangle, central_parameters, impossible_because
from phantom_dyn.model.robot import Robot

_LEAST = 1e-6
"""Smallest eigenvalue, as a share of the largest: MuJoCo and other readers refuse a body that is barely possible."""


def with_nearest_bodies(robot: Robot, given: Robot) -> tuple[Robot, tuple[Note, ...]]:
    """The robot with bodies that cannot exist replaced by possible ones, and a note on each.

    Bodies that are equal to those of the given model are kept in any case.

    Args:
        robot: The robot with estimated bodies.
        given: The given model; its bodies set the units of length.

    Raises:
        ParameterError: If the mass of a body is zero or negative.
    """
    model = robot.model.copy()
    notes = []
    for body in range(1, model.njoints):
        standard = model.inertias[body].toDynamicParameters()
        mass, _, inertia = central_parameters(standard)
        if model.inertias[body] == given.model.inertias[body]:
            continue
        if impossible_because(mass, inertia) is None and not breaks_triangle(inertia):
            continue
        name = body_name(robot, body)
        if mass <= 0:
            raise ParameterError(f"The link {name} would weigh {mass:.3g} kg: record more motion.")
        reference = pseudo_inertia(given.model.inertias[body].toDynamicParameters())
        found, distance = nearest_possible(standard, _length(reference, pseudo_inertia(standard)))
        model.inertias[body] = pin.Inertia.FromDynamicParameters(found)
        numbers = {"body": name, "distance": distance, "mass": float(found[0]), "found": float(mass)}
        notes.append(Note(Code.NEAREST_BODY, None, numbers))
    return (replace(robot, model=model), tuple(notes)) if notes else (robot, ())


def nearest_possible(standard: Float[Array, " 10"], length: float) -> tuple[Float[Array, " 10"], float]:
    """The nearest parameters that a body can have, and their relative distance.

    Args:
        standard: Ten standard parameters.
        length: Unit of length [m].
    """
    scale = np.array([length, length, length, 1.0])
    matrix = pseudo_inertia(standard) / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(matrix)
    raised = np.maximum(values, _LEAST * values.max())
    found = (vectors * raised) @ vectors.T
    distance = float(np.linalg.norm(found - matrix) / np.linalg.norm(matrix))
    return standard_of(found * np.outer(scale, scale)), distance


def _length(*bodies: Float[Array, "4 4"]) -> float:
    """Radius of gyration [m] of the first body that has one."""
    for body in bodies:
        trace = float(np.trace(body[:3, :3]))
        if body[3, 3] > 0 and trace > 0:
            return float(np.sqrt(trace / body[3, 3]))
    return 1.0
