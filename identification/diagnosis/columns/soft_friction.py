"""Dry friction as MuJoCo has it, and whether a recording shows it.

A model of MuJoCo is often tried on a recording of MuJoCo. Its dry friction is a soft constraint, which turns over about
ten milliseconds before the velocity does: against Coulomb's law that looks like a delay. A robot's friction does not,
so the model may rub softly only where the recording does, from its beginning to its end.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from identification.data.log import Band
from phantom_dyn.array_types import Float
from phantom_dyn.dynamics.dynamics import mass_matrix
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.rows import modelled_friction_of
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

Array = np.ndarray

# Of the law's own size: what a recording shows of it in each of its parts.
_LEAST, _MOST = 0.5, 1.5
_PARTS = 5


def softness(robot: Robot, motion: Motion, joint: str) -> Float[Array, "N nv"]:
    """What soft friction adds to a joint's modelled Coulomb friction, see `SoftFriction`.

    Args:
        robot: Gives both.
        motion: At the full rate.
        joint: The joint.
    """
    row = robot.joint_names.index(joint)
    soft, torque = robot.soft_friction[row], modelled_friction_of(robot, joint)[1]
    out = np.zeros_like(motion.v)
    if soft is not None:
        v, a = motion.v[:, row], motion.a[:, row]
        # The pseudo-inverse: links without mass leave the matrix singular.
        mobility = np.linalg.pinv(mass_matrix(robot, np.zeros((1, robot.nv)))[0], hermitian=True)[row, row]
        inertia = 1.0 / mobility if mobility > 0.0 else 0.0
        out[:, row] = np.clip(soft.gain * inertia * (a + v / soft.time), -torque, torque) - torque * np.sign(v)
    return out


def rubs_softly(robot: Robot, recorded: Sequence[tuple[Operation, Float[Array, "N nv"], Band]]) -> bool:
    """True if every part of the recordings shows the soft friction of the robot's own simulator, in its size.

    Args:
        robot: Of a MuJoCo file, or another one.
        recorded: Of each recording the motion, the torque that the given model lacks, and the band.
    """
    joints = [
        joint
        for joint, soft in zip(robot.joint_names, robot.soft_friction, strict=False)
        if soft is not None and modelled_friction_of(robot, joint)[1] > 0
    ]
    if not joints:
        return False
    for operation, lacking, band in recorded:
        both, squares = np.sum([_part(robot, operation, lacking, band, joint) for joint in joints], axis=0)
        shown = both / np.maximum(squares, 1e-300)
        if not np.all((shown > _LEAST) & (shown < _MOST)):
            return False
    return True


def _part(robot: Robot, operation: Operation, lacking: Array, band: Band, joint: str) -> Float[Array, "2 parts"]:
    """Of a joint, by part of the recording: product of softness and what the model lacks, and square of softness.

    Both without what friction, inertia or a shift in time would explain.
    """
    row = robot.joint_names.index(joint)
    v, a = operation.v[:, row], operation.a[:, row]
    others = [np.ones(len(v)), np.sign(v), v, a, np.gradient(operation.tau[:, row])]
    basis = band(np.column_stack(others))
    both = band(np.column_stack([softness(robot, operation, joint)[:, row], lacking[:, row]]))
    both = _without(both, basis)
    pieces = np.array_split(both, _PARTS)
    return np.array([[float(x[:, 0] @ x[:, k]) for x in pieces] for k in (1, 0)])


def _without(columns: Array, basis: Array) -> Array:
    size = np.linalg.norm(basis, axis=0)
    scaled = basis / np.where(size > 0, size, 1.0)
    return columns - scaled @ np.linalg.lstsq(scaled, columns, rcond=None)[0]
