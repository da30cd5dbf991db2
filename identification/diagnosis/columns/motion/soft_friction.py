"""MuJoCo's soft dry friction, and whether a recording shows it.

Models of MuJoCo are often compared with recordings from MuJoCo. Its dry friction is a soft constraint, which changes
sign about ten milliseconds before the velocity does. Compared with Coulomb's law, this looks like a delay. The friction
of a real robot is not soft. So the model gets soft friction only if every part of the recording shows it. The softness
then applies to the friction that the file states, and to the additional friction that the recording shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identification.data.log import Band
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import mass_matrix, rigid_body_regressor
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.rows import modelled_friction_of
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import BaseMotion, Motion

# Range of the fitted softness, as a share of that of MuJoCo's law, in each part of a recording. If a part is outside,
# the robot gets no soft friction.
_LEAST, _MOST = 0.5, 1.5
_PARTS = 5  # number of equal parts of a recording, each of which has to show softness
# Number of rounds in which friction torque and softness are estimated; after one, estimates agree to a per cent.
_ESTIMATES = 3

# A recording: its motion, the torque that the given model lacks, and the band.
Recorded = tuple[Operation, Float[Array, "N nv"], Band]


def dry_torque(robot: Robot, joint: str) -> float:
    """Coulomb torque of a joint with soft friction: the modelled one plus what recordings show beyond it."""
    soft = robot.soft_friction[robot.joint_names.index(joint)]
    return max(modelled_friction_of(robot, joint)[1] + (0.0 if soft is None else soft.beyond_model), 0.0)


def soft_joints(robot: Robot) -> tuple[str, ...]:
    """Joints with dry friction that the simulator of the robot's file softens."""
    joints = zip(robot.joint_names, robot.soft_friction, strict=False)
    return tuple(joint for joint, soft in joints if soft is not None and dry_torque(robot, joint) > 0)


def softness(robot: Robot, motion: Motion, joint: str) -> Float[Array, "N nv"]:
    """Soft friction minus Coulomb friction of a joint (`SoftFriction` is the law), zero for other joints.

    Args:
        robot: States the friction of its joints.
        motion: Motion at the full rate.
        joint: Name of the joint.
    """
    row = robot.joint_names.index(joint)
    soft, torque = robot.soft_friction[row], dry_torque(robot, joint)
    out = np.zeros_like(motion.v)
    if soft is not None:
        v, a = motion.v[:, row], motion.a[:, row]
        # The pseudo-inverse, because links without mass make the matrix singular.
        mobility = np.linalg.pinv(mass_matrix(robot, np.zeros((1, robot.nv)))[0], hermitian=True)[row, row]
        inertia = 1.0 / mobility if mobility > 0.0 else 0.0
        out[:, row] = np.clip(soft.gain * inertia * (a + v / soft.time), -torque, torque) - torque * np.sign(v)
    return out


def with_shown_friction(robot: Robot, recorded: Sequence[Recorded], known: Float[Array, " nv"]) -> Robot:
    """The robot with the dry friction that recordings show, if it is as soft as in the robot's own simulator.

    Args:
        robot: Robot from a MuJoCo file or another one.
        recorded: The recordings.
        known: Coulomb torque of each joint that earlier diagnoses have found beyond the modelled one.

    Returns:
        The robot in which each soft joint has its friction beyond the modelled one. It has no soft friction at all if
        a part of the recordings does not show the expected softness.
    """
    if not any(robot.soft_friction):
        return robot
    regressors = [_regressor_in_band(robot, one) for one in recorded]
    shown = np.array(known, dtype=float)
    for _ in range(_ESTIMATES):
        robot = _with_dry_friction(robot, shown)
        missing = [
            _missing(robot, row, recorded, regressors, shown[row] - known[row]) if soft is not None else 0.0
            for row, soft in enumerate(robot.soft_friction)
        ]
        shown = known + np.array(missing)
    robot = _with_dry_friction(robot, shown)
    return robot if _shows_softness(robot, recorded, regressors, shown - known) else replace(robot, soft_friction=())


def _with_dry_friction(robot: Robot, beyond_model: Float[Array, " nv"]) -> Robot:
    """The robot whose joints with soft friction have the Coulomb torque ``beyond_model`` beyond the modelled one."""
    soft = zip(robot.soft_friction, beyond_model.tolist(), strict=True)
    return replace(robot, soft_friction=tuple(s and replace(s, beyond_model=torque) for s, torque in soft))


def _shows_softness(robot: Robot, recorded: Sequence[Recorded], regressors: list[Array], missing: Array) -> bool:
    """True if every part of the recordings shows the soft friction in its expected size; False without soft joints."""
    joints = soft_joints(robot)
    if not joints:
        return False
    rows = [robot.joint_names.index(joint) for joint in joints]
    for one, regressor in zip(recorded, regressors, strict=True):
        both, squares = np.sum([_products_by_part(robot, row, one, regressor, missing[row]) for row in rows], axis=0)
        shown = both / np.maximum(squares, 1e-300)
        if not np.all((shown > _LEAST) & (shown < _MOST)):
            return False
    return True


def _regressor_in_band(robot: Robot, one: Recorded) -> Float[Array, "n nv p"]:
    """Rigid-body regressor of one recording at the samples of the band."""
    operation, _, band = one
    state, base = (operation.t, operation.q, operation.v, operation.a), operation.base
    slow = None if base is None else BaseMotion(band(base.w), band(base.dw), band(base.f))
    return rigid_body_regressor(robot, Motion(*(band(x) for x in state), base=slow))


def _columns(robot: Robot, row: int, one: Recorded, regressor: Array, missing: float) -> tuple[Array, Array, Array]:
    """Columns of other errors that a joint may have, of its Coulomb friction, and of soft minus Coulomb friction."""
    operation, _, band = one
    v, a = operation.v[:, row], operation.a[:, row]
    # A delay applies to the friction torque as well.
    late = np.gradient(operation.tau[:, row] + missing * np.sign(v))
    others = band(np.column_stack([np.ones(len(v)), v, a, late]))
    soft = softness(robot, operation, robot.joint_names[row])[:, row]
    return np.hstack([others, regressor[:, row]]), band(np.sign(v)), band(soft)


def _missing(robot: Robot, row: int, recorded: Sequence[Recorded], regressors: list[Array], missing: float) -> float:
    """Coulomb torque that the recordings show on a joint and the given model lacks."""
    parts = [_columns(robot, row, one, regressor, missing) for one, regressor in zip(recorded, regressors, strict=True)]
    others, dry, soft = (np.concatenate([part[k] for part in parts]) for k in range(3))
    lacking = np.concatenate([band(lacking[:, row]) for _, lacking, band in recorded])
    projected = _without(np.column_stack([dry, soft, lacking]), others)
    return float(np.linalg.lstsq(projected[:, :2], projected[:, 2], rcond=None)[0][0])


def _products_by_part(
    robot: Robot, row: int, one: Recorded, regressor: Array, missing: float
) -> Float[Array, "2 parts"]:
    """For each part of the recording: product of a joint's softness and missing torque, and square of the softness.

    Components that friction, inertias, a rotor or a shift in time could explain are first projected out of both.
    """
    others, dry, soft = _columns(robot, row, one, regressor, missing)
    _, lacking, band = one
    projected = _without(np.column_stack([soft, band(lacking[:, row])]), np.column_stack([others, dry]))
    pieces = np.array_split(projected, _PARTS)
    return np.array([[float(x[:, 0] @ x[:, k]) for x in pieces] for k in (1, 0)])


def _without(columns: Float[Array, "n k"], basis: Float[Array, "n m"]) -> Float[Array, "n k"]:
    """Columns minus their projection onto the columns of a basis."""
    size = np.linalg.norm(basis, axis=0)
    scaled = basis / np.where(size > 0, size, 1.0)
    return columns - scaled @ np.linalg.lstsq(scaled, columns, rcond=None)[0]
