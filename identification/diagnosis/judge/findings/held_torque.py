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
from phantom_dyn.effects.effect import Effect
from phantom_dyn.model.robot import Robot

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
    robot, effect = session.robot, term.effect
    if not isinstance(effect, Effect) or len(effect.parameters(robot, term.joint)) != 1:
        return False
    half_row = 0.5 * _MARGIN * max((float(np.median(np.diff(one.t))) for one in session.recordings), default=0.0)
    if effect.simulated(robot, term.joint, coefficients).reference_delay is not None:
        unstated = robot.reference_hold is None and not any(one.references_held for one in session.recordings)
        return unstated and abs(float(coefficients[0])) <= half_row
    return is_viscous(robot, term) and abs(float(coefficients[0])) <= half_row * _gain(session, term.joint)


def is_viscous(robot: Robot, term: Term) -> bool:
    """True for an effect of one joint with one parameter, which is viscous friction."""
    effect, joint = term.effect, term.joint
    if not isinstance(effect, Effect) or joint not in robot.joint_names or len(effect.parameters(robot, joint)) != 1:
        return False
    return bool(effect.model_numbers(robot, joint, np.ones(1)).viscous)


def _gain(session: Session, joint: str | None) -> float:
    """Gain of a joint's position controller [N m/rad or N/m]; zero if none is stated, or the torque was not read."""
    row = session.robot.joint_names.index(joint)
    controller = session.robot.actuators[row].controller
    computed = any(one.reference_gain is not None and one.reference_gain[row] != 0.0 for one in session.recordings)
    return 0.0 if controller is None or computed else controller.kp
