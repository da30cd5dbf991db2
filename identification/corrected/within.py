"""The given model with the moves within its tolerances that a diagnosis made: what it was judged with.

Moves are fitted one by one, and only their sum along the recorded motion is seen. Together they may make a body that
cannot be, as the axial moment of a thin link leaves its two others no room to differ: then possible bodies take its
place that need the same torques there.
"""

from __future__ import annotations

import numpy as np

from identification.diagnosis.moved_model import moved_robot
from identification.diagnosis.nuisances import moves_of
from identification.diagnosis.result import Diagnosis
from identification.estimators.consistent_bodies import reference_bodies
from identification.estimators.consistent_cone import solve_program
from identification.estimators.consistent_program import Program
from phantom_dyn.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.effects.changed_robot import with_parameters
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

_SAMPLES = 300
"""Samples of the recorded motion on which possible bodies need the same torques."""
_SEEN = 1e-4
"""Combinations of parameters whose torque is a smaller share of the largest one's are free."""


def within_tolerance(robot: Robot, diagnosis: Diagnosis) -> Robot:
    """The given robot with what the diagnosis lists as adjusted; the very same object where that is nothing.

    Findings are sizes beside these moves: a model that has the findings alone is not the one whose gap was measured,
    and may be further from the recordings than the given one.

    Args:
        robot: The given model.
        diagnosis: Of this model.

    Raises:
        RobotError: If a link would weigh nothing or less.
    """
    changes = {entry.quantity: entry.change for entry in diagnosis.adjusted}
    values = np.array([changes.get(m.nuisance.name, 0.0) if m.nuisance.relative else 0.0 for m in moves_of(robot)])
    return moved_robot(robot, values) if values.any() else robot


def possible_within_tolerance(robot: Robot, diagnosis: Diagnosis) -> Robot:
    """`within_tolerance` with bodies that can be, nearest to the given ones, of the same torque along the recording.

    Args:
        robot: The given model.
        diagnosis: Of this model; its evidence holds the motion.

    Raises:
        RobotError: If a link would weigh nothing or less.
        EstimationError: If no such bodies can be.
    """
    moved = within_tolerance(robot, diagnosis)
    evidence = diagnosis.evidence
    at = np.unique(np.linspace(0, len(evidence.t) - 1, min(_SAMPLES, len(evidence.t))).astype(int))
    if moved is robot or not len(evidence.t):
        return moved
    motion = Motion(evidence.t[at], evidence.q[at], evidence.v[at], evidence.a[at])
    wanted, given = standard_parameters(moved), standard_parameters(robot)
    bodies = reference_bodies(given)
    scale = np.concatenate([body.scale for body in bodies])
    _, sizes, rows = np.linalg.svd(rigid_body_regressor(robot, motion).reshape(-1, len(given)) * scale)
    seen = rows[: len(sizes)][sizes > _SEEN * sizes[0]] / scale
    none = np.zeros(0)
    found = solve_program(Program(seen, seen @ wanted, bodies, (None,) * len(bodies), none, none, exact=True))
    return with_parameters(moved, found.pi - wanted)
