"""Converts a simulated machine and its effects to arrays for compiled steps, if each effect has a compiled law."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from phantom_dyn._kernels.single_state import Chain, at_root, chain_of, joint_rows
from phantom_dyn.array_types import Array
from phantom_dyn.effects.compiled_laws import COMMANDS, READINGS, TORQUES
from phantom_dyn.effects.simulated import Simulated
from phantom_dyn.errors import ChainError
from phantom_dyn.loops.solver import loop_closure_of
from phantom_dyn.model.robot import Robot
from phantom_dyn.simulation.compiled.arm_steps import Arm
from phantom_dyn.simulation.compiled.arrays import AT_SAMPLES, AT_STEPS, GIVEN, Control, EffectLaws, lines_of, packed
from phantom_dyn.simulation.control import Tracking
from phantom_dyn.simulation.stepping import Machine


def compiled(
    machine: Machine, effects: tuple[Simulated, ...], t: Array, counts: Array
) -> tuple[Arm, EffectLaws] | None:
    """Arrays of machine and effects for ``counts[k]`` steps between ``t[k]`` and ``t[k + 1]``.

    Returns:
        Machine and laws; None if an effect has a law in Python only, so that the steps cannot be compiled.
    """
    laws = [law for effect in effects for law in effect.laws]
    channels = [[law for law in laws if law.function in known] for known in (TORQUES, COMMANDS, READINGS)]
    # An effect that changes only the robot or its transmissions needs no law.
    in_python = [one for one in effects if not one.laws and (one.command or one.torque or one.reading)]
    if sum(map(len, channels)) < len(laws) or in_python:
        return None
    torques, commands, readings = map(packed, channels)
    return _arm(machine), EffectLaws(torques, commands, readings, lines_of(channels[1], t, counts))


def require_closed_loops(arm: Arm, t: float, robot: Robot) -> None:
    """Raise an error that names the loop, if compiled steps ended because a loop could not be closed.

    Args:
        arm: The simulated machine.
        t: Time of the last sample before the end [s].
        robot: Robot with the loops.

    Raises:
        ChainError: If the loops cannot be closed or are singular at the last state.
    """
    loops = arm.chain.loops
    if loops is None or robot.chain is None or not np.isfinite(loops.wanted).all():
        return
    try:
        robot.solutions.at(np.stack([loops.q, loops.wanted[0]]))
    except ChainError as problem:
        raise ChainError(f"After {t:.4g} s of the simulation: {problem}") from problem


def control_of(controller: Callable, robot: Robot) -> Control:
    """Arrays of a tracking controller; arrays of zeros for any other controller."""
    if not isinstance(controller, Tracking):
        return Control(GIVEN, np.zeros(2), np.zeros((2, robot.nv, 6)), np.zeros(robot.nv), np.zeros(1, np.int64))
    law = controller
    tables = np.stack([law.feedforward, law.q_ref, law.v_ref, law.kp, law.kd, law.extra], axis=-1)
    mode = AT_SAMPLES if robot.torque_hold == "zoh" else AT_STEPS
    return Control(mode, np.array(law.t), np.ascontiguousarray(tables), np.array(law.limits), np.zeros(1, np.int64))


def _arm(machine: Machine) -> Arm:
    """Arrays of the machine."""
    robot, nv, loose = machine.robot, machine.nv, list(machine.loose)
    joint_constants, joint_indices = joint_rows(robot.arrays)
    drives = np.array(machine.drives, np.int64)
    n = nv + len(loose)
    added_inertia = np.zeros((n, n))
    added_inertia[drives, drives] = machine.rotor
    added_inertia[np.ix_(drives, drives)] += machine.coupled
    joint_parameters = (machine.rotor, robot.viscous_friction, robot.coulomb_friction)
    rotor, viscous, coulomb = (np.array(part, dtype=float) for part in joint_parameters)
    root_motion = at_root(len(joint_indices), robot.model.gravity.linear)
    stiffness, damping, gap = (
        np.array(part, dtype=float) for part in (machine.stiffness, machine.damping, machine.gap)
    )
    return Arm(
        joint_constants, joint_indices, root_motion, added_inertia, rotor, viscous, coulomb, drives,
        np.array(machine.encoders, np.int64), np.array(loose, np.int64), stiffness, damping, gap, _chain(robot),
    )  # fmt: skip


def _chain(robot: Robot) -> Chain:
    """Positions of the tree as a function of the active joints, and friction and rotor inertias of passive joints."""
    chain = robot.chain
    if chain is None:
        empty = np.zeros(0)
        return chain_of(np.zeros((0, robot.nv)), empty, empty, empty, empty)
    passive = list(chain.passive)
    viscous, coulomb, rotor = np.zeros((3, robot.model.nv))
    viscous[passive], coulomb[passive] = chain.viscous_friction, chain.coulomb_friction
    rotor[passive] = robot.model.armature[passive]
    slope = chain.linear_map[:, : robot.nv]
    return chain_of(slope, chain.offset, viscous, coulomb, rotor, loop_closure_of(robot.model, chain, robot.arrays))
