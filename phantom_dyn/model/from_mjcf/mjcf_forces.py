# pyright: reportAttributeAccessIssue=false
"""Gravity of an MJCF file, and the forces that MuJoCo simulates and the model leaves out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import listed

if TYPE_CHECKING:
    import mujoco

_NO_GRAVITY = "mjDSBL_GRAVITY"
_JOINT_OF_TENDON = 1  # MuJoCo's mjWRAP_JOINT: a fixed tendon is a sum of joint positions


def switched_off(compiled: mujoco.MjModel, flag: str) -> bool:
    """True if the file disables a feature of MuJoCo."""
    import mujoco

    return bool(compiled.opt.disableflags & int(getattr(mujoco.mjtDisableBit, flag)))


def modelled_gravity(compiled: mujoco.MjModel) -> Float[Array, " 3"]:
    """Gravity [m/s^2], reduced by the gravity compensation (gravcomp) if that is the same for every body."""
    gravity = np.array(compiled.opt.gravity) * (not switched_off(compiled, _NO_GRAVITY))
    return gravity * (1.0 - _compensation_of_all(compiled))


def omitted_forces(compiled: mujoco.MjModel) -> dict[str, frozenset[str]]:
    """Forces that the file states and the model leaves out, each with the joints on which it may act."""
    every = frozenset(compiled.joint(k).name for k in range(compiled.njnt))
    # Joints by number; those of a degree of freedom are the joints that it belongs to.
    of_joints, of_freedoms = list(range(compiled.njnt)), list(compiled.dof_jntid)
    found = {
        "stiffness of <joint>": _joints_with(compiled, ("jnt_stiffness", "jnt_stiffnesspoly"), of_joints),
        "damping of <joint> that grows with speed": _joints_with(compiled, ("dof_dampingpoly",), of_freedoms),
        "gravcomp of <body>": _unevenly_compensated(compiled),
    }
    for what in ("stiffness", "damping", "frictionloss", "armature"):
        name = f"{what} of <fixed>, <spatial>"
        arrays = [getattr(compiled, f"tendon_{what}{end}", np.zeros(0)) for end in ("", "poly")]
        tendons = {int(k) for array in arrays for k in np.nonzero(array)[0]}
        found[name] = frozenset[str]().union(*(_joints_of_tendon(compiled, k, every) for k in tendons))
    option = compiled.opt
    for what, value in (("density", option.density), ("viscosity", option.viscosity), ("wind", option.wind)):
        found[f"{what} of <option>"] = every if np.any(value) else frozenset()
    return {what: joints for what, joints in found.items() if joints}


def joints_of(omitted: dict[str, frozenset[str]]) -> frozenset[str]:
    """All joints on which some of the forces may act."""
    return frozenset[str]().union(*omitted.values())


def gravity_and_force_warnings(
    compiled: mujoco.MjModel, omitted: dict[str, frozenset[str]], path: Path
) -> tuple[str, ...]:
    """Sentences on compensated gravity, and on forces that the model leaves out.

    Args:
        compiled: MuJoCo's model of the file.
        omitted: Result of `omitted_forces`.
        path: Path of the file for messages.
    """
    share, sentences = _compensation_of_all(compiled), list[str]()
    if share:
        sentences.append(f"{path} states gravcomp {share:g} for every body: gravity is taken {1 - share:g} times.")
    if omitted:
        joints = [one.name for one in map(compiled.joint, range(compiled.njnt)) if one.name in joints_of(omitted)]
        sentences.append(
            f"{path} states {', '.join(omitted)}, which the model leaves out: "
            f"a gap on {listed(joints)} may come from it."
        )
    return tuple(sentences)


def _compensated_bodies(compiled: mujoco.MjModel) -> Float[Array, " n"]:
    """Gravity compensation of each body that moves and has a mass; empty if there is no gravity.

    Compensation by the drives is a part of their torque, so that gravity acts in full: then nothing is compensated.
    """
    moving = (compiled.body_weldid > 0) & (compiled.body_mass > 0)
    by_drives = np.array(compiled.jnt_actgravcomp).astype(bool)
    acts = not by_drives.all() and np.any(compiled.opt.gravity) and not switched_off(compiled, _NO_GRAVITY)
    return np.where(moving, compiled.body_gravcomp, np.nan) if acts else np.full(compiled.nbody, np.nan)


def _compensation_of_all(compiled: mujoco.MjModel) -> float:
    """The gravity compensation that every body has; zero if bodies differ, or drives compensate some of them."""
    stated = _compensated_bodies(compiled)
    stated = stated[~np.isnan(stated)]
    uneven = not len(stated) or np.ptp(stated) > 0 or np.array(compiled.jnt_actgravcomp).any()
    return 0.0 if uneven else float(stated[0])


def _unevenly_compensated(compiled: mujoco.MjModel) -> frozenset[str]:
    """Joints that carry a body whose gravity is compensated, where gravity as a whole does not stand for it."""
    if _compensation_of_all(compiled):
        return frozenset()
    joints = set[str]()
    for body in np.flatnonzero(np.nan_to_num(_compensated_bodies(compiled))):
        while body:
            first = int(compiled.body_jntadr[body])
            joints |= {compiled.joint(first + k).name for k in range(int(compiled.body_jntnum[body]))}
            body = int(compiled.body_parentid[body])
    return frozenset(joints)


def _joints_with(compiled: mujoco.MjModel, arrays: tuple[str, ...], joints: list[int]) -> frozenset[str]:
    """Joints for which one of some arrays has a number that is not zero.

    Args:
        compiled: MuJoCo's model of the file.
        arrays: Names of arrays of MuJoCo's model; older versions lack some of them.
        joints: Joint of each row of the arrays.
    """
    rows = {int(row) for one in arrays if hasattr(compiled, one) for row in np.nonzero(getattr(compiled, one))[0]}
    return frozenset(compiled.joint(int(joints[row])).name for row in rows)


def _joints_of_tendon(compiled: mujoco.MjModel, tendon: int, every: frozenset[str]) -> frozenset[str]:
    """Joints of a fixed tendon; a spatial tendon may pull at all of them."""
    first = int(compiled.tendon_adr[tendon])
    parts = slice(first, first + int(compiled.tendon_num[tendon]))
    if np.any(compiled.wrap_type[parts] != _JOINT_OF_TENDON):
        return every
    return frozenset(compiled.joint(int(k)).name for k in compiled.wrap_objid[parts])
