# pyright: reportAttributeAccessIssue=false
"""Replaces estimated bodies that cannot exist by possible ones.

Tolerance parameters are fitted independently, so that together they may make a body that cannot exist. For example, a
thin link with a small axial moment of inertia must have two nearly equal other moments. Such bodies are replaced by
possible bodies with the same torques along the recorded motion; if there are none, by the nearest possible bodies.

A body is possible if its pseudo-inertia, the four by four matrix of its moments of order zero to two, has no negative
eigenvalue [Wensing]_. For the nearest possible body the negative eigenvalues are raised, with lengths in units of the
body's radius of gyration, so that mass and moments have the same weight.

References:
    .. [Wensing] P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial
       parameter identification, IEEE Robotics and Automation Letters 3(1), 2018.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

from identification.estimators.consistent.consistent_bodies import pseudo_inertia, reference_bodies, standard_of
from identification.estimators.consistent.consistent_program import Program, solve_program
from identification.export.model_files.reload import some_motion
from identification.notes import Code, Note
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import EstimationError, ParameterError
from phantom_dyn.model.inertia import body_name, breaks_triangle, central_parameters, impossible_because
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

_LEAST_EIGENVALUE = 1e-6
"""Smallest eigenvalue as a share of the largest one. It is above zero because MuJoCo and other programs refuse bodies
that are barely possible."""
_SAMPLES = 300
"""Number of samples of the recorded motion at which possible bodies must have the same torques."""
_LEAST_TORQUE_SHARE = 1e-4
"""Combinations of parameters may change freely if their torque is below this share of the largest."""


def with_possible_bodies(robot: Robot, given: Robot, motion: Motion) -> tuple[Robot, tuple[Note, ...]]:
    """The robot with possible bodies, and notes on them; the same object if all of its bodies are possible.

    Args:
        robot: The robot with estimated bodies.
        given: The given model, whose bodies are possible or nearly so.
        motion: Motion along which the torques should not change.

    Raises:
        ParameterError: If the mass of a body is zero or negative.
    """
    nearest, notes = with_nearest_bodies(robot, given)
    if nearest is robot:
        return robot, ()
    try:
        return same_torque_bodies(robot, given, motion), (Note(Code.SAME_TORQUES, None, {}),)
    except EstimationError:
        return nearest, notes


def with_nearest_bodies(robot: Robot, given: Robot) -> tuple[Robot, tuple[Note, ...]]:
    """The robot with bodies that cannot exist replaced by the nearest possible ones, and a note on each.

    Bodies that are equal to those of the given model are never replaced.

    Args:
        robot: The robot with estimated bodies.
        given: The given model; its bodies define the units of length.

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
        standard: Ten standard parameters of a body, about its joint.
        length: Unit of length [m], in which mass and moments are compared.
    """
    scale = np.array([length, length, length, 1.0])
    matrix = pseudo_inertia(standard) / np.outer(scale, scale)
    values, vectors = np.linalg.eigh(matrix)
    raised = np.maximum(values, _LEAST_EIGENVALUE * values.max())
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


def same_torque_bodies(robot: Robot, given: Robot, motion: Motion) -> Robot:
    """The robot with possible bodies that need the same torques along a motion and are nearest to the given bodies.

    Args:
        robot: A robot some of whose bodies may be impossible.
        given: The given model, whose bodies are possible or nearly so.
        motion: Motion along which the torques are equal; at most 300 of its samples are used.

    Raises:
        EstimationError: If there are no such bodies.
        RobotError: If the mass of a link would be zero or negative.
    """
    if not len(motion.t):
        raise EstimationError("No motion was recorded along which other bodies need the same torques.")
    few_samples = some_motion(motion, _SAMPLES)
    wanted, stated = standard_parameters(robot), standard_parameters(given)
    bodies = reference_bodies(stated)
    scale = np.concatenate([body.scale for body in bodies])
    _, sizes, rows = np.linalg.svd(
        rigid_body_regressor(robot, few_samples).reshape(-1, len(stated)) * scale, full_matrices=False
    )
    observed_rows = rows[: len(sizes)][sizes > _LEAST_TORQUE_SHARE * sizes[0]] / scale
    none = np.zeros(0)
    found = solve_program(Program(observed_rows, observed_rows @ wanted, bodies, none, none, exact=True))
    return with_parameters(robot, found.pi - wanted)
