# pyright: reportAttributeAccessIssue=false
"""Reads properties of the drives from the actuators of a MJCF: gains of servos, largest torques, gears."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from phantom_dyn.model.robot_xml import Drive

if TYPE_CHECKING:
    import mujoco

# Kinds of transmissions, by MuJoCo's mjtTrn.
_JOINT, _IN_PARENT, _TENDON = 0, 1, 3
# Kinds of gains, biases and dynamics, by MuJoCo's mjtGain, mjtBias and mjtDyn.
_FIXED_GAIN, _NO_BIAS, _AFFINE_BIAS, _NO_DYNAMICS, _FILTERS = 0, 0, 1, 0, (2, 3)
# Relative difference up to which a gain and a bias count as the same number.
_SAME = 1e-9


def driven_joints(compiled: mujoco.MjModel) -> frozenset[str]:
    """Joints on which an actuator acts, directly or through a tendon of joints."""
    names: set[str] = set()
    for k in range(compiled.nu):
        kind, target = int(compiled.actuator_trntype[k]), int(compiled.actuator_trnid[k, 0])
        if kind in (_JOINT, _IN_PARENT):
            names.add(compiled.joint(target).name)
        elif kind == _TENDON:
            names.update(tendon_joints(compiled, target))
    return frozenset(names)


def tendon_joints(compiled: mujoco.MjModel, tendon: int) -> dict[str, float]:
    """Joints of a tendon that is a sum of joints, with their factors; empty for a tendon that runs over sites."""
    import mujoco

    first = int(compiled.tendon_adr[tendon])
    wraps = range(first, first + int(compiled.tendon_num[tendon]))
    if any(int(compiled.wrap_type[w]) != int(mujoco.mjtWrap.mjWRAP_JOINT) for w in wraps):
        return {}
    return {compiled.joint(int(compiled.wrap_objid[w])).name: float(compiled.wrap_prm[w]) for w in wraps}


def drives_of(compiled: mujoco.MjModel) -> dict[str, Drive]:
    """Drive of each joint with one actuator, or with one position servo and any number of velocity servos."""
    own: dict[str, list[Drive]] = {}
    for k in range(compiled.nu):
        if int(compiled.actuator_trntype[k]) in (_JOINT, _IN_PARENT):
            own.setdefault(compiled.joint(int(compiled.actuator_trnid[k, 0])).name, []).append(_drive(compiled, k))
    return {name: drive for name, drives in own.items() if (drive := _together(drives)) is not None}


def _together(drives: list[Drive]) -> Drive | None:
    """The drive of a joint from its actuators; of several, one must be a position servo and the others velocity servos.

    A position servo and a velocity servo with the reference zero are one controller with two gains. None for any other
    combination.
    """
    if len(drives) == 1:
        return drives[0]
    servos = [drive for drive in drives if drive.kp is not None]
    if len(servos) != 1 or any(drive.kd is None for drive in drives):
        return None
    limits = [drive.torque_limit for drive in drives if drive.torque_limit is not None]
    limit = sum(limits) if len(limits) == len(drives) else None
    return replace(servos[0], kd=sum(drive.kd or 0.0 for drive in drives), torque_limit=limit)


def _drive(compiled: mujoco.MjModel, k: int) -> Drive:
    """Drive of one actuator; a velocity servo has ``kd`` and no ``kp``."""
    gear, dynamics = float(compiled.actuator_gear[k, 0]), int(compiled.actuator_dyntype[k])
    plain = int(compiled.actuator_gaintype[k]) == _FIXED_GAIN and dynamics in (_NO_DYNAMICS, *_FILTERS)
    gain, bias = float(compiled.actuator_gainprm[k, 0]), np.array(compiled.actuator_biasprm[k, :3])
    limits = []
    if compiled.actuator_forcelimited[k]:
        limits.append(abs(gear) * float(np.abs(compiled.actuator_forcerange[k]).max()))
    joint = int(compiled.actuator_trnid[k, 0])
    if compiled.jnt_actfrclimited[joint]:
        limits.append(float(np.abs(compiled.jnt_actfrcrange[joint]).max()))
    kp = kd = None
    lag = 0.0
    if plain and int(compiled.actuator_biastype[k]) == _AFFINE_BIAS and gain > 0 and bias[0] == 0 and bias[2] <= 0:
        if abs(gain + bias[1]) <= _SAME * gain:
            kp, kd = gear**2 * gain, -(gear**2) * float(bias[2])
            # The filter delays the reference only: the bias acts on position and velocity at once.
            lag = float(compiled.actuator_dynprm[k, 0]) if dynamics in _FILTERS else 0.0
        elif bias[1] == 0 and abs(gain + bias[2]) <= _SAME * gain:
            kd = gear**2 * gain
    elif plain and int(compiled.actuator_biastype[k]) == _NO_BIAS and compiled.actuator_ctrllimited[k]:
        limits.append(abs(gear * gain) * float(np.abs(compiled.actuator_ctrlrange[k]).max()))
    limit = min((value for value in limits if value > 0), default=None)
    return Drive(kp, kd, limit, gear if gear not in (0.0, 1.0) else None, lag)
