"""Checks for torques that were computed from a model of the weight, and for joints that only lift or only lower.

The torque of a gravity compensation is computed from the controller's own model of the weight, so that a recording of
this torque says nothing about the robot. The friction of a gear grows with its load. If a joint only lifts its load,
this friction is proportional to the weight, and the two cannot be distinguished.
"""

from __future__ import annotations

import numpy as np

from identification.data.checks.smoothed_copy import SmoothedRecording
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.dynamics.dynamics import inverse_dynamics, rigid_body_regressor
from phantom_dyn.errors import listed
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

# A torque was computed from the position if the residual after a fit of any weight is small: below the first share of
# the torque, and below the second share of the torque that inertia and modelled friction need. Measured torques have
# 50 % or more of both, recorded compensations 1 % and 9 %.
_OF_TORQUE, _OF_MOTION = 0.05, 0.3
# A joint moves its weight in one direction only if `lifted_less_lowered` is above this number. Motions up and down
# through the same positions have 0.1 to 0.35.
_ONE_WAY = 0.7
# A joint moves if it is faster than the first share of its root-mean-square speed. Its weight matters if it is above
# the second share of the torque, both root mean squares.
_MOVES, _MATTERS = 0.1, 0.3
_ROWS, _FEWEST = 2000, 100  # largest and smallest number of samples
# A joint that travels less than this [rad or m] is held: its torque comes from the motion of the other joints.
_HELD = 1e-3


def computed_from_weight(robot: Robot, motion: Motion, tau: Float[Array, "N nv"]) -> Bool[Array, " nv"]:
    """True for joints whose torque depends on the positions like a weight, and contains no inertia or friction.

    Args:
        robot: The given model.
        motion: Samples of a recording.
        tau: Recorded torque [N m or N].
    """
    rows = np.linspace(0, len(motion.t) - 1, min(len(motion.t), _ROWS)).astype(int)
    moved = motion.at(rows)
    still = _at_rest(moved)
    needed = inverse_dynamics(robot, moved) - inverse_dynamics(robot, still)
    weights = rigid_body_regressor(robot, still)
    out = np.zeros(robot.nv, dtype=bool)
    for j in range(robot.nv):
        columns = np.column_stack([np.ones(len(rows)), weights[:, j]])
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        # The torque of the motion is fitted by the same weights, as these may explain a part of it by chance.
        targets = np.column_stack([tau[rows, j], needed[:, j]])
        residual = targets - columns @ (np.linalg.lstsq(columns / size, targets, rcond=1e-9)[0] / size[:, None])
        of_torque, of_motion = np.linalg.norm(residual, axis=0)
        spread = np.linalg.norm(targets[:, 0] - targets[:, 0].mean())
        moves = np.ptp(motion.q[:, j]) > _HELD
        out[j] = moves and of_torque < _OF_TORQUE * spread and of_torque < _OF_MOTION * of_motion
    return out


def lifted_less_lowered(robot: Robot, motion: Motion, tau: Float[Array, "N nv"]) -> Float[Array, " nv"]:
    """How much more each joint lifts its weight than lowers it, from -1 to 1, shape ``(nv,)``.

    It is the sum of the squared weight over samples in which the joint lifts, minus the sum over samples in which it
    lowers, divided by the sum over both. It is 1 for a joint that only lifts and -1 for one that only lowers. It is 0
    if the joint's weight hardly matters.

    Args:
        robot: The given model.
        motion: Samples of a recording.
        tau: Recorded torque [N m or N].
    """
    weight = inverse_dynamics(robot, _at_rest(motion))
    moves = np.abs(motion.v) > _MOVES * np.sqrt(np.mean(motion.v**2, axis=0))
    matters = np.sqrt(np.mean(weight**2, axis=0)) > _MATTERS * np.sqrt(np.mean(tau**2, axis=0))
    total = np.sum(weight**2 * moves, axis=0)
    difference = np.sum(weight**2 * np.sign(weight * motion.v) * moves, axis=0)
    known = matters & (total > 0) & (moves.sum(axis=0) > _FEWEST) & (np.ptp(motion.q, axis=0) > _HELD)
    return np.where(known, difference / np.where(total > 0, total, 1.0), 0.0)


def check_weights(file: str, robot: Robot, smooth: SmoothedRecording) -> tuple[str, ...]:
    """Warnings on torques that were computed from a weight, and on joints that only lift or only lower their weight."""
    if smooth.tau is None or smooth.inside.sum() < _FEWEST:
        return ()
    motion, tau = smooth.motion(smooth.inside), smooth.tau[smooth.inside]
    names, out = np.array(robot.joint_names), list[str]()
    computed = computed_from_weight(robot, motion, tau)
    if computed.any():
        out.append(
            f"{file}: the torque of {listed(tuple(names[computed]))} is a weight at each position, without what "
            "inertia and friction need: gravity compensation that was recorded as torque, while something else moved "
            "the robot. What is found of loads there is what the compensation's own model holds, and not what hangs on "
            "the robot: record a motion that the drives make."
        )
    one_way = lifted_less_lowered(robot, motion, tau)
    for j in np.flatnonzero(np.abs(one_way) > _ONE_WAY):
        lifts = one_way[j] > 0
        out.append(
            f"{file}: {names[j]} {'lifts' if lifts else 'lowers'} its weight for {50 * (1 + abs(one_way[j])):.0f} % of "
            "its motion under "
            "load: friction that grows with load is weight there, and a load may come out too "
            f"{'large' if lifts else 'small'}, with the gear of a servo by half. Record a motion that lifts and lowers "
            "through the same places, such as a sum of two sines."
        )
    return tuple(out)


def _at_rest(motion: Motion) -> Motion:
    """The same positions with zero velocities and accelerations."""
    zero = np.zeros_like(motion.v)
    return Motion(motion.t, motion.q, zero, zero)
