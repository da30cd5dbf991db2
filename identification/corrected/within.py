"""The given model with the moves within its tolerances that a diagnosis made: what it was judged with."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.moved_model import moved_robot
from identification.diagnosis.nuisances import moves_of
from identification.diagnosis.result import Diagnosis
from phantom_dyn.robot import Robot


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
