"""Finds the viscous friction that a torque seems to have if it is read at a fixed time after each held reference.

A position controller holds each reference for a row of the log, while the joint moves on with velocity ``v``. Its
torque ``kp (q_ref - q) - kd v`` then changes by ``kp v h`` within the row of duration ``h``. A log that reads the
torque once per row, such as just before the next reference, differs from the mean by up to half of that. This is the
torque of a viscous friction of ``kp h / 2``, of either sign.
"""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.session import Session
from identification.diagnosis.columns.terms import Term
from phantom_dyn.array_types import Array, Float

# times: an apparent viscous friction may be larger than that of half a row by this factor, because simulators read the
# torque of their last step, and gains are nominal. Sound MuJoCo servos had up to 1.27 of it.
_MARGIN = 1.5


def apparent_viscous_friction(session: Session) -> Float[Array, " nv"]:
    """Viscous friction of each joint that held references may imitate [N m s/rad or N s/m]; zero if there is none.

    It is zero for joints without a stated position controller, and where the torque was computed from the references.
    """
    robot, out = session.robot, np.zeros(session.robot.nv)
    kp = np.array([0.0 if drive.controller is None else drive.controller.kp for drive in robot.actuators])
    for recording in session.recordings:
        measured = np.ones(robot.nv) if recording.reference_gain is None else recording.reference_gain == 0.0
        out = np.maximum(out, 0.5 * _MARGIN * float(np.median(np.diff(recording.t))) * kp * measured)
    return out


def held_references_imitate(session: Session, term: Term, coefficients: Float[Array, " k"]) -> bool:
    """True for a viscous friction that may be a torque read at a fixed time after each held reference.

    Args:
        session: Robot and recordings.
        term: An effect.
        coefficients: Its fitted coefficients.
    """
    if term.effect.name != "viscous_friction" or term.joint is None:
        return False
    limit = apparent_viscous_friction(session)[session.robot.joint_names.index(term.joint)]
    return bool(abs(coefficients[0]) <= limit)
