"""A machine and its effects as arrays for compiled steps, where each of its effects has a compiled law."""

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


def compiled(machine: Machine, parts: tuple[Simulated, ...], t: Array, counts: Array) -> tuple[Arm, EffectLaws] | None:
    """Machine and effects for ``counts[k]`` steps between ``t[k]`` and ``t[k + 1]``; None where Python has to step.

    That is so for effects that have Python laws only.
    """
    laws = [law for part in parts for law in part.laws]
    channels = [[law for law in laws if law.function in known] for known in (TORQUES, COMMANDS, READINGS)]
    if sum(map(len, channels)) < len(laws) or not all(part.laws or _is_silent(part) for part in parts):
        return None
    torques, commands, readings = map(packed, channels)
    return _arm(machine), EffectLaws(torques, commands, readings, lines_of(channels[1], t, counts))


def require_closed_loops(machine: Arm, t: float, robot: Robot) -> None:
    """Say which loop of a chain could not be closed where compiled steps ended; nothing if that is not why.

    Args:
        machine: What was stepped.
        t: Time of the last sample before [s].
        robot: Gives the loops.

    Raises:
        ChainError: If the loops cannot be closed or are singular at the state that was tried last.
    """
    loops = machine.chain.loops
    if loops is None or robot.chain is None or not np.isfinite(loops.wanted).all():
        return
    try:
        robot.solutions.at(np.stack([loops.q, loops.wanted[0]]))
    except ChainError as problem:
        raise ChainError(f"After {t:.4g} s of the simulation: {problem}") from problem


def control_of(controller: Callable, robot: Robot) -> Control:
    """A tracking law as arrays, empty ones for any other controller."""
    if not isinstance(controller, Tracking):
        return Control(GIVEN, np.zeros(2), np.zeros((2, robot.nv, 6)), np.zeros(robot.nv), np.zeros(1, np.int64))
    law = controller
    tables = np.stack([law.feedforward, law.q_ref, law.v_ref, law.kp, law.kd, law.extra], axis=-1)
    mode = AT_SAMPLES if robot.torque_hold == "zoh" else AT_STEPS
    return Control(mode, np.array(law.t), np.ascontiguousarray(tables), np.array(law.limits), np.zeros(1, np.int64))


def _is_silent(part: Simulated) -> bool:
    """True if an effect needs no law: it changes the robot or its transmissions only."""
    return part.command is None and part.torque is None and part.reading is None


def _arm(machine: Machine) -> Arm:
    robot, nv, loose = machine.robot, machine.nv, list(machine.loose)
    numbers, places = joint_rows(robot.arrays)
    drives = np.array(machine.drives, np.int64)
    n = nv + len(loose)
    added = np.zeros((n, n))
    added[drives, drives] = machine.rotor
    added[np.ix_(drives, drives)] += machine.coupled
    numbers_of_joints = (machine.rotor, robot.viscous_friction, robot.coulomb_friction)
    rotor, viscous, coulomb = (np.array(part, dtype=float) for part in numbers_of_joints)
    root = at_root(len(places), robot.model.gravity.linear)
    stiffness, damping, gap = (
        np.array(part, dtype=float) for part in (machine.stiffness, machine.damping, machine.gap)
    )
    return Arm(
        numbers, places, root, added, rotor, viscous, coulomb, drives,
        np.array(machine.encoders, np.int64), np.array(loose, np.int64), stiffness, damping, gap, _chain(robot),
    )  # fmt: skip


def _chain(robot: Robot) -> Chain:
    """How the tree follows the active joints."""
    given = robot.chain
    if given is None:
        none = np.zeros(0)
        return chain_of(np.zeros((0, robot.nv)), none, none, none, none)
    passive = list(given.passive)
    viscous, coulomb, rotor = np.zeros((3, robot.model.nv))
    viscous[passive], coulomb[passive] = given.viscous_friction, given.coulomb_friction
    rotor[passive] = robot.model.armature[passive]
    slope = given.linear_map[:, : robot.nv]
    return chain_of(slope, given.offset, viscous, coulomb, rotor, loop_closure_of(robot.model, given, robot.arrays))
