"""Finds viscous friction and delays that a controller seems to have because it holds each reference for a row.

A position controller holds each reference for a row of the log, while the joint moves on with velocity ``v``. Its
torque ``kp (q_ref - q) - kd v`` then changes by ``kp v h`` within the row of duration ``h``. A log that reads the
torque once per row, such as just before the next reference, differs from the mean by up to half of that. This is the
torque of a viscous friction of ``kp h / 2``, of either sign. Where the torque is computed from the references, a held
reference is late by ``h / 2`` on average.
"""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import Term
from phantom_dyn.array_types import Array, Float

# times: an apparent viscous friction or delay may be larger than that of half a row by this factor, because simulators
# read the torque of their last step, and gains are nominal. Sound MuJoCo servos had up to 1.27 of it.
_MARGIN = 1.5


def held_references_imitate(session: Session, term: Term, coefficients: Float[Array, " k"]) -> bool:
    """True for a viscous friction or a late reference that may come from references that are held for a row of the log.

    Args:
        session: Robot and recordings.
        term: An effect.
        coefficients: Its fitted coefficients.
    """
    robot, size = session.robot, abs(float(coefficients[0]))
    half_row = 0.5 * _MARGIN * max((float(np.median(np.diff(one.t))) for one in session.recordings), default=0.0)
    if term.effect.name == "reference_delay":
        unstated = robot.reference_hold is None and not any(one.references_held for one in session.recordings)
        return unstated and size <= half_row
    if term.effect.name != "viscous_friction" or term.joint is None:
        return False
    row = robot.joint_names.index(term.joint)
    controller = robot.actuators[row].controller
    # A torque that was computed from the references was not read.
    computed = any(one.reference_gain is not None and one.reference_gain[row] != 0.0 for one in session.recordings)
    return controller is not None and not computed and size <= half_row * controller.kp
