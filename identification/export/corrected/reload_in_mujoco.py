# pyright: reportAttributeAccessIssue=false
"""Checks a corrected MJCF in MuJoCo: torques along a motion, and errors of simulated motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from identification.export.corrected.corrected_mjcf import (
    COUPLING,
    SPRING,
    compliances_in_mjcf,
    rotor_of,
    zeros_in_file,
)
from identification.export.corrected.corrected_model import CorrectedModel, added_torque, with_zeros_moved
from identification.export.model_files.reload import (
    load_mujoco,
    mujoco_joints,
    mujoco_problem,
    relative_difference,
    torque_of_mujoco,
)
from identification.export.model_files.tree import tree_torque
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.dynamics.tree_motion import TreeMotion, tree_motion
from phantom_dyn.effects.support.changed_robot import with_rotor_inertia
from phantom_dyn.effects.support.rows import row_of
from phantom_dyn.errors import RobotError
from phantom_dyn.model.from_mjcf.mjcf_compiler import silenced_warnings
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from phantom_dyn.signals.splines import interpolated

_STEP = 1e-3  # integration step of a rollout [s]
_LEAD = 300  # number of steps before a rollout in which joints with encoders follow the recorded motion


def needed_torque(corrected: CorrectedModel, motion: Motion) -> Float[Array, "N nt"]:
    """True torque that the corrected model needs on every joint of the tree, with the effects in the MJCF [N m or N].

    Args:
        corrected: The corrected model.
        motion: N samples of the active joints; positions are encoder readings.
    """
    robot = _with_rotors(corrected)
    out = tree_torque(with_zeros_moved(robot, zeros_in_file(corrected)), tree_motion(robot, motion))
    out[:, list(robot.tree_rows)] += added_torque(corrected, motion)
    return out


def torque_difference(text: str, corrected: CorrectedModel, motion: Motion) -> float:
    """Largest difference between the torques of an MJCF in MuJoCo and of the model, divided by the largest torque.

    The result is NaN if MuJoCo is not installed.

    Args:
        text: Text of the MJCF.
        corrected: The model in the file.
        motion: N samples of the active joints.

    Raises:
        RobotError: If MuJoCo refuses the text.
    """
    if mujoco_problem(text) is not None:
        return float("nan")
    tree = tree_motion(corrected.robot, motion)
    found = torque_of_mujoco(load_mujoco(text), corrected.robot, tree, {}) + _tendon_friction(corrected, tree)
    return relative_difference(found, needed_torque(corrected, motion))


def edited_difference(text: str, corrected: CorrectedModel, motion: Motion, fixed_q: Mapping[str, float]) -> float:
    """Largest relative difference of torques, computed like `torque_difference`, for an edited copy of the user's file.

    Parts of the file that are not in the model are switched off first: springs (except those of findings), gravity
    compensation, servos and the medium.

    Args:
        text: Text of the MJCF, with paths at which MuJoCo finds its meshes.
        corrected: The model in the file.
        motion: N samples of the active joints.
        fixed_q: Positions, if not zero, of joints of the file that the robot does not have.

    Raises:
        RobotError: If MuJoCo refuses the text.
    """
    import mujoco

    model = load_mujoco(text)
    tree = tree_motion(corrected.robot, motion)
    servos = model.actuator_biastype == mujoco.mjtBias.mjBIAS_AFFINE
    model.actuator_biasprm[servos, 1:] = 0.0
    model.body_gravcomp[:] = 0.0
    model.opt.density, model.opt.viscosity = 0.0, 0.0
    model.tendon_stiffness[:] = 0.0
    named = {mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, k): k for k in range(model.njnt)}
    found_springs = {*corrected.springs, *(SPRING.format(name) for name in corrected.compliances)}
    for name, k in named.items():
        if name not in found_springs:
            model.jnt_stiffness[k] = 0.0
    coupled = {COUPLING.format(c.first, c.second) for c in corrected.couplings}
    for k in range(model.ntendon):
        if mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_TENDON, k) not in coupled:
            model.tendon_damping[k] = 0.0
    found = torque_of_mujoco(model, corrected.robot, tree, fixed_q) + _tendon_friction(corrected, tree)
    return relative_difference(found, needed_torque(corrected, motion))


@silenced_warnings()
def rollout_errors(
    text: str, robot: Robot, motion: Motion, tau: Float[Array, "N nv"], *, horizon: float = 0.2, starts: int = 40
) -> Float[Array, " nv"]:
    """Root mean square distance of MuJoCo's motion from the recorded one at the end of rollouts under recorded torque.

    States that are not recorded (of links within backlash, of drives with a lag) come from a simulation before each
    rollout, in which the joints with encoders follow the recorded motion.

    Args:
        text: An MJCF with one actuator per driven joint, in the robot's order, before all other actuators.
        robot: The robot with its joints and loops.
        motion: N samples of the active joints, from which the rollouts start.
        tau: Logged torque at the same times [N m or N].
        horizon: Duration of each rollout [s].
        starts: Largest number of rollouts; their starts are evenly spaced.

    Raises:
        RobotError: If MuJoCo refuses the text, or the motion is shorter than the horizon.
    """
    import mujoco

    model = load_mujoco(text)
    model.opt.timestep = _STEP
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    data = mujoco.MjData(model)
    tree = tree_motion(robot, motion)
    _, order = mujoco_joints(model, robot)
    active = list(robot.tree_rows)
    driven = [j for j, actuator in enumerate(robot.actuators) if actuator.actuated]
    has_hidden_states = model.nq > len(order) or model.na > 0 or bool(_stored_commands(model).any())
    lead, count = _LEAD if has_hidden_states else 0, round(horizon / _STEP)
    chosen = _starts(motion.t, lead * _STEP, count * _STEP, starts)
    errors = np.empty((len(chosen), robot.nv))
    for row, k in enumerate(chosen):
        t = motion.t[k] + np.arange(-lead, count) * _STEP
        commands = interpolated(t + 0.5 * _STEP, motion.t, tau)[:, driven]
        mujoco.mj_resetData(model, data)
        _set_drives(model, data, float(t[0]), commands[0])
        # Hidden states reach their values while the joints with encoders follow the recording.
        for q, v, torque in zip(
            interpolated(t[:lead], motion.t, tree.q), interpolated(t[:lead], motion.t, tree.v), commands, strict=False
        ):
            data.qpos[order], data.qvel[order], data.ctrl[: len(driven)] = q, v, torque
            mujoco.mj_step(model, data)
        # From here on, only the recorded torque acts.
        data.qpos[order], data.qvel[order] = tree.q[k], tree.v[k]
        for torque in commands[lead:]:
            data.ctrl[: len(driven)] = torque
            mujoco.mj_step(model, data)
        errors[row] = data.qpos[order][active] - interpolated(t[-1:] + _STEP, motion.t, motion.q)[0]
    return np.sqrt(np.mean(errors**2, axis=0))


def _starts(t: Float[Array, " N"], before: float, after: float, most: int) -> Int[Array, " k"]:
    """Indices of at most ``most`` samples with enough motion before and after them [s], without a gap in time."""
    # Gaps in time divide the motion into parts.
    first = np.r_[0, np.flatnonzero(np.diff(t) > 3 * np.median(np.diff(t))) + 1]
    part = np.searchsorted(first, np.arange(len(t)), side="right") - 1
    part_start, part_end = t[first], t[np.r_[first[1:] - 1, len(t) - 1]]
    possible = np.flatnonzero((t - before >= part_start[part]) & (t + after <= part_end[part]))
    if len(possible) == 0:
        raise RobotError(f"The motion is shorter than {before + after:g} s: give more of it for a rollout.")
    return possible[np.unique(np.linspace(0, len(possible) - 1, most).astype(int))]


def _set_drives(model: Any, data: Any, start: float, commands: Float[Array, " nu"]) -> None:
    """Set the states of the drives as if the commands had been constant for a long time."""
    import mujoco

    data.time = start
    for j, torque in enumerate(commands):
        if model.actuator_actnum[j]:
            data.act[model.actuator_actadr[j]] = torque
        count = int(_stored_commands(model)[j])
        if count:
            times = start - _STEP * np.arange(count, 0, -1)
            mujoco.mj_initCtrlHistory(model, data, j, times, np.full((count, 1), torque))


def _stored_commands(model: Any) -> Int[Array, " nu"]:
    """Number of past commands that each actuator stores for its delay; zero in older versions of MuJoCo."""
    return np.array(model.actuator_history[:, 0]) if hasattr(model, "actuator_history") else np.zeros(model.nu, int)


def _with_rotors(corrected: CorrectedModel) -> Robot:
    """The robot with the rotor inertias that the MJCF has at joints with backlash or a spring."""
    robot = corrected.robot
    for joint in (*corrected.plays, *compliances_in_mjcf(corrected)):
        known = float(corrected.robot.rotor_inertia[row_of(robot, joint)])
        robot = with_rotor_inertia(robot, joint, rotor_of(corrected, joint) - known)
    return robot


def _tendon_friction(corrected: CorrectedModel, tree: TreeMotion) -> Float[Array, "N nt"]:
    """Dry friction of the couplings, which MuJoCo's inverse dynamics does not include."""
    out = np.zeros_like(tree.v)
    at = dict(zip(corrected.robot.joint_names, corrected.robot.tree_rows, strict=True))
    for c in corrected.couplings:
        sign = np.sign(tree.v[:, at[c.first]] + c.ratio * tree.v[:, at[c.second]])
        out[:, at[c.first]] += c.coulomb_torque * sign
        out[:, at[c.second]] += c.ratio * c.coulomb_torque * sign
    return out
