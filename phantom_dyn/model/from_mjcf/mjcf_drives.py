# pyright: reportAttributeAccessIssue=false
"""Properties of the drives from the actuators of a MJCF: gains of servos, largest torques, gears."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phantom_dyn.model.robot_xml import Drive

if TYPE_CHECKING:
    import mujoco

# Kinds of transmissions, by MuJoCo's mjtTrn.
_JOINT, _IN_PARENT, _TENDON = 0, 1, 3
# Kinds of gains, biases and dynamics, by MuJoCo's mjtGain, mjtBias and mjtDyn.
_FIXED_GAIN, _NO_BIAS, _AFFINE_BIAS, _NO_DYNAMICS = 0, 0, 1, 0
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
    """Properties of drives by joint, for joints with exactly one actuator."""
    own: dict[str, list[int]] = {}
    for k in range(compiled.nu):
        if int(compiled.actuator_trntype[k]) in (_JOINT, _IN_PARENT):
            own.setdefault(compiled.joint(int(compiled.actuator_trnid[k, 0])).name, []).append(k)
    return {name: _drive(compiled, ks[0]) for name, ks in own.items() if len(ks) == 1}


def _drive(compiled: mujoco.MjModel, k: int) -> Drive:
    gear = float(compiled.actuator_gear[k, 0])
    plain = int(compiled.actuator_gaintype[k]) == _FIXED_GAIN and int(compiled.actuator_dyntype[k]) == _NO_DYNAMICS
    gain, bias = float(compiled.actuator_gainprm[k, 0]), np.array(compiled.actuator_biasprm[k, :3])
    limits = []
    if compiled.actuator_forcelimited[k]:
        limits.append(abs(gear) * float(np.abs(compiled.actuator_forcerange[k]).max()))
    joint = int(compiled.actuator_trnid[k, 0])
    if compiled.jnt_actfrclimited[joint]:
        limits.append(float(np.abs(compiled.jnt_actfrcrange[joint]).max()))
    kp = kd = None
    if plain and int(compiled.actuator_biastype[k]) == _AFFINE_BIAS:
        if gain > 0 and bias[0] == 0 and abs(gain + bias[1]) <= _SAME * gain and bias[2] <= 0:
            kp, kd = gear**2 * gain, -(gear**2) * float(bias[2])
    elif plain and int(compiled.actuator_biastype[k]) == _NO_BIAS and compiled.actuator_ctrllimited[k]:
        limits.append(abs(gear * gain) * float(np.abs(compiled.actuator_ctrlrange[k]).max()))
    limit = min((value for value in limits if value > 0), default=None)
    return Drive(kp, kd, limit, gear if gear not in (0.0, 1.0) else None)
