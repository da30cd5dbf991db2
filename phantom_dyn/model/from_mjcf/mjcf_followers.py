# pyright: reportAttributeAccessIssue=false
"""Finds joints of a MJCF that an equality couples to another joint, and joints that model play."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from phantom_dyn.errors import RobotError
from phantom_dyn.model.from_mjcf.mjcf_drives import tendon_joints
from phantom_dyn.model.robot_xml import Follower

if TYPE_CHECKING:
    import mujoco

# Kinds of equalities, by MuJoCo's mjtEq.
_OF_JOINTS, _OF_TENDONS = 2, 3
# Largest range of a joint that models play, by MuJoCo's mjtJoint: 2 is a slide [m], 3 a hinge [rad].
_NARROW = {2: 0.02, 3: 0.25}
# Largest sine of the angle between two axes that count as parallel.
_PARALLEL = 1e-3


def followers_of(compiled: mujoco.MjModel, driven: frozenset[str], path: Path) -> dict[str, Follower]:
    """Joints that follow another joint by an equality of joints or tendons.

    Of the two joints of an equality, the one without a drive follows the other.

    Args:
        compiled: MuJoCo's model.
        driven: Joints with an actuator.
        path: Path of the file for messages.

    Raises:
        RobotError: If a joint follows another one by a curve.
    """
    out: dict[str, Follower] = {}
    active = np.array(compiled.eq_active0).astype(bool)
    for k in np.flatnonzero(active & np.isin(compiled.eq_type, (_OF_JOINTS, _OF_TENDONS))):
        kind = int(compiled.eq_type[k])
        sides = [_joint_factors(compiled, kind, int(row[k])) for row in (compiled.eq_obj1id, compiled.eq_obj2id)]
        curve = compiled.eq_data[k, :5].tolist()
        equality = _linear_equality(compiled, sides, curve)
        if equality is None:
            continue
        factors, constant = equality
        names = list(factors)
        word = "<equality><joint>" if kind == _OF_JOINTS else "<equality><tendon>"
        if any(curve[2:]) and len(names) > 1:
            raise RobotError(
                f"{path}: {names[0]} follows {names[1]} by a curve ({word} whose polycoef has more than two numbers), "
                f"and only straight lines are taken: make it one, or take it out and write lock: [{names[0]}] into "
                "robot.yaml."
            )
        if len(names) > 2:
            continue
        name = next((n for n in names if n not in driven and n not in out), names[0])
        others = [n for n in names if n != name]
        own = factors[name]
        factor = -factors[others[0]] / own if others else 0.0
        out[name] = Follower(others[0] if others else None, factor, constant / own)
    return out


def _joint_factors(compiled: mujoco.MjModel, kind: int, which: int) -> dict[str, float] | None:
    """Factor of each joint in one side of an equality; None for a tendon that runs over sites."""
    if which < 0:
        return {}
    if kind == _OF_JOINTS:
        return {compiled.joint(which).name: 1.0}
    return tendon_joints(compiled, which) or None


def _linear_equality(
    compiled: mujoco.MjModel, sides: list[dict[str, float] | None], curve: list[float]
) -> tuple[dict[str, float], float] | None:
    """Factor of each joint and constant of ``sum(factors q) = constant``; None if a side is no sum of joints."""
    first, second = sides
    if first is None or second is None:
        return None
    factors = dict(first)
    for name, factor in second.items():
        factors[name] = factors.get(name, 0.0) - curve[1] * factor
    factors = {name: factor for name, factor in factors.items() if factor}
    reference = {name: float(compiled.qpos0[int(compiled.joint(name).qposadr[0])]) for name in factors}
    constant = curve[0] + sum(factor * reference[name] for name, factor in factors.items())
    return factors, constant


def play_of(compiled: mujoco.MjModel, driven: frozenset[str]) -> dict[str, tuple[str, float]]:
    """Joints that model play: they have a narrow range and no drive, and share body and axis with another joint.

    Args:
        compiled: MuJoCo's model.
        driven: Joints with an actuator.

    Returns:
        For the name of each such joint, the joint whose play it models, and the width of the play [rad or m].
    """
    out: dict[str, tuple[str, float]] = {}
    for k in range(1, compiled.njnt):
        kinds = {int(compiled.jnt_type[j]) for j in (k - 1, k)}
        if compiled.jnt_bodyid[k] != compiled.jnt_bodyid[k - 1] or len(kinds) > 1 or kinds.isdisjoint(_NARROW):
            continue
        if float(np.linalg.norm(np.cross(compiled.jnt_axis[k], compiled.jnt_axis[k - 1]))) > _PARALLEL:
            continue
        # The drive may act on either side of the play.
        for one, other in ((k, k - 1), (k - 1, k)):
            name, joint = compiled.joint(one).name, compiled.joint(other).name
            width = float(np.diff(compiled.jnt_range[one])[0])
            narrow = bool(compiled.jnt_limited[one]) and width <= _NARROW[int(compiled.jnt_type[one])]
            if narrow and name not in driven and out.keys().isdisjoint((name, joint)):
                out[name] = (joint, width)
    return out
