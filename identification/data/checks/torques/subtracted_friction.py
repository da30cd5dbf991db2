"""Finds torques that lack the friction that the model states, because a controller had subtracted the friction.

Friction is fitted together with free inertial parameters, so that wrong inertias are not taken for friction. The ratio
of fitted to modelled friction is 1 if the torque contains the modelled friction, and 0 if the torque contains none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.data.checks.against_model import model_torque
from identification.data.checks.positions import still_joints
from identification.data.checks.smoothed_copy import SmoothedRecording
from identification.data.checks.torques.torque_lag import jackknife_error
from identification.data.recording import Recording
from phantom_dyn.array_types import Array, Float
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.model.robot import Robot

_ROWS = 400  # samples in the regression
_BLOCKS = 8  # blocks of the record, each left out once (jackknife) for the standard error
# Smallest number of independent samples (two per period of the cut-off) for each column.
_PER_COLUMN = 2.0
# Smallest ratio of modelled friction to the residual of the fit, both root mean squares.
_VISIBLE = 3.0
# Largest absolute ratio of fitted to modelled friction of a compensated torque. It is not 0, because controllers seldom
# subtract friction to within a tenth. Wear or a warm gear do not reduce friction to this share.
_LARGEST_SHARE = 0.3
# If a torque varies by less than this share of the torque that the links need, something else moves the joint. Inertias
# and torque constants that are half or twice the stated ones together make a factor of four at most.
_DRIVEN = 0.25
_SIGNIFICANT = 3.0  # standard errors


@dataclass(frozen=True)
class FrictionShare:
    """Ratio of fitted to modelled friction of one joint.

    Attributes:
        joint: Name of the joint.
        share: Fitted over modelled friction; 1 if the torque contains the modelled friction.
        std: Standard error of the share.
        visible: Modelled friction over the residual of the fit, both root mean squares.
    """

    joint: str
    share: float
    std: float
    visible: float


def friction_shares(robot: Robot, smooth: SmoothedRecording) -> tuple[FrictionShare, ...]:
    """Ratio of fitted to modelled friction of each joint whose motion determines it.

    Joints without modelled friction, and joints that something other than their drive moves, are left out.

    Args:
        robot: States the friction.
        smooth: The smoothed copy; its torque includes that of measured forces.
    """
    rows = smooth.rows(_ROWS)
    if smooth.tau is None or len(rows) < _ROWS // 4:
        return ()
    independent = 2 * smooth.cutoff_hz * smooth.step * int(smooth.inside.sum())
    bodies = rigid_body_regressor(robot, smooth.motion(rows))
    driven = smooth.tau[rows].std(axis=0) >= _DRIVEN * model_torque(robot, smooth.motion(rows)).std(axis=0)
    out = []
    for j, joint in enumerate(robot.joint_names):
        v, sign, tau = smooth.v[rows, j], smooth.sign[rows, j], smooth.tau[rows, j]
        modelled = robot.viscous_friction[j] * v + robot.coulomb_friction[j] * sign
        if not modelled.any() or not driven[j]:
            continue
        others = np.column_stack([bodies[:, j], smooth.a[rows, j], np.ones(len(rows))])
        friction = np.column_stack([v, sign])
        share, residual, rank = _friction_share(others, friction, tau, modelled)
        if independent < _PER_COLUMN * rank:
            continue
        without_block = np.empty(_BLOCKS)
        for k, block in enumerate(np.array_split(np.arange(len(rows)), _BLOCKS)):
            kept = np.setdiff1d(np.arange(len(rows)), block)
            without_block[k] = _friction_share(others[kept], friction[kept], tau[kept], modelled[kept])[0]
        visible = float(np.sqrt(np.mean(modelled**2)) / max(residual, 1e-300))
        out.append(FrictionShare(joint, share, jackknife_error(without_block), visible))
    return tuple(out)


def _friction_share(
    others: Float[Array, "n k"], friction: Float[Array, "n 2"], tau: Float[Array, " n"], modelled: Float[Array, " n"]
) -> tuple[float, float, int]:
    """Ratio of fitted to modelled friction, root mean square of the residual, and the number of independent columns.

    Args:
        others: Columns of bodies, rotor and offset.
        friction: Columns of viscous and Coulomb friction.
        tau: Measured torque.
        modelled: Friction that the model states.
    """
    columns = np.column_stack([others, friction])
    size = np.linalg.norm(columns, axis=0)
    size[size == 0] = 1.0
    solved, _, rank, _ = np.linalg.lstsq(columns / size, tau, rcond=1e-6)
    residual = tau - (columns / size) @ solved
    fitted = friction @ (solved / size)[-2:]
    share = float(fitted @ modelled) / max(float(modelled @ modelled), 1e-300)
    return share, float(np.sqrt(np.mean(residual**2))), int(rank)


def check_subtracted_friction(recording: Recording, robot: Robot, smooth: SmoothedRecording) -> tuple[str, ...]:
    """A warning on torques that lack the modelled friction, with the entry of a column map that adds it.

    Args:
        recording: Raw samples.
        robot: States the friction.
        smooth: The smoothed copy; its torque includes that of measured forces.
    """
    still = np.array(recording.joint_names)[still_joints(recording, robot.prismatic)]
    lacking = [
        one
        for one in friction_shares(robot, smooth)
        if one.joint not in (*recording.friction_subtracted, *still)
        and abs(one.share) + _SIGNIFICANT * one.std < _LARGEST_SHARE
        and one.visible > _VISIBLE
    ]
    if not lacking:
        return ()
    joints = [one.joint for one in lacking]
    most = max(lacking, key=lambda one: one.std)
    rubbing = int(np.count_nonzero(robot.viscous_friction + robot.coulomb_friction))
    entry = "compensated: friction"
    entries = f"tau: {{{entry}}}" if len(joints) == rubbing else ", ".join(f"tau.{j}: {{{entry}}}" for j in joints)
    which = "torque" if len(joints) == 1 else "torques"
    lack = "lacks" if len(joints) == 1 else "lack"
    return (
        f"{recording.file}: the {which} of {', '.join(joints)} {lack} the friction that the model states (of "
        f"{most.joint} {100 * most.share:.0f} +- {100 * most.std:.0f} % are there): if a controller had taken friction "
        f"out, write {entries} into a column map and give it with --columns; if the robot has so little, state it in "
        "the model.",
    )
