"""Limits that a proposed motion keeps: what the robot states, and not much more than it was recorded to do."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from identification.excitation.limits import Limits
from identification.excitation.stated import require_excitable, stated_limits
from identification.log import Log
from phantom_dyn.robot import Robot

Array = np.ndarray

# A joint goes at most this share of its recorded range beyond either end of it.
_BEYOND = 0.5
# Times the largest recorded speed, acceleration and torque.
_FASTER, _SHARPER, _STRONGER = 2.0, 3.0, 2.0
# A joint that was held may not move at all: this much [rad or m] is none.
_HELD = 1e-4


def safe_limits(robot: Robot, logs: tuple[Log, ...]) -> Limits:
    """Stated limits, narrowed to what the recordings have shown to be safe.

    Raises:
        RobotError: If the robot has a joint that no reference can drive.
        ParameterError: If the stated limits exclude what was recorded.
    """
    require_excitable(robot, ())
    stated, rows = stated_limits(robot), list(robot.tree_rows)
    q = np.concatenate([log.motion.q for log in logs])
    reach = np.maximum(np.ptp(q, axis=0), _HELD)
    lower, upper, velocity = np.array(stated.lower), np.array(stated.upper), np.array(stated.velocity)
    lower[rows] = np.maximum(lower[rows], q.min(axis=0) - _BEYOND * reach)
    upper[rows] = np.minimum(upper[rows], q.max(axis=0) + _BEYOND * reach)
    velocity[rows] = np.minimum(velocity[rows], _FASTER * _largest([log.motion.v for log in logs]))
    # Of a joint that was held, the recorded torque says nothing: it may at least overcome its friction.
    shown = np.maximum(
        _STRONGER * _largest([log.band(log.tau) for log in logs]), 2.0 * np.array(robot.coulomb_friction)
    )
    torque = np.minimum(stated.torque, shown)
    acceleration = _SHARPER * _largest([log.motion.a for log in logs])
    return Limits(lower, upper, velocity, acceleration, torque)


def _largest(series: list[Float[Array, "_ nv"]]) -> Float[Array, " nv"]:
    """Largest size of each column but for the few samples that are noise; above zero."""
    return np.maximum(np.percentile(np.abs(np.concatenate(series)), 99.5, axis=0), _HELD)
