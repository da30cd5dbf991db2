"""Compiled simulation steps of a tree of joints with one degree of freedom.

Some joints may have an elastic transmission between motor and link. The integrator is the midpoint rule of
`phantom_dyn.simulation.stepping`. A closed chain has ``nv`` active joints, from which the motion of its passive joints
follows. Laws of effects are called by their numbers, see `phantom_dyn.effects.compiled_laws`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.dry_friction import FrictionPlaces, apply_dry_friction
from phantom_dyn._kernels.jit import inlined_jit, jit
from phantom_dyn._kernels.single_state import Chain, chained_mass_and_bias, invert, mass_and_bias, move_root
from phantom_dyn.array_types import Array
from phantom_dyn.simulation.compiled.arrays import AT_STEPS, GIVEN, Control, EffectLaws, Laws, Moving, Plan, Rows
from phantom_dyn.simulation.compiled.channels import delivered_by_drive, effect_torque, place_in, read, tracking


class Arm(NamedTuple):
    """A machine whose state has ``nv`` joints and then ``m`` motors on elastic transmissions, ``n = nv + m``.

    Attributes:
        joint_constants: Constants of each joint of the tree, from `joint_rows`.
        joint_indices: Parent, kind and velocity index of each joint, from `joint_rows`.
        root: Motion of the root from `at_root`, of a fixed base; `run_arm` copies it and writes the motion of a moving
            base into the copy.
        added_inertia: Inertia that is added to that of the links (rotors, couplings), ``(n, n)``.
        rotor: Inertias of the rotors, ``(nv,)``.
        viscous: Viscous coefficients, ``(nv,)``.
        coulomb: Coulomb torques, ``(nv,)``.
        drives: Index of each joint's motor in the state, ``(nv,)``.
        encoders: Index of the position that each joint's encoder measures, motor or link, ``(nv,)``.
        loose: Joints with an elastic transmission, ``(m,)``.
        stiffness: Stiffness of their transmissions [N m/rad or N/m], ``(m,)``.
        damping: Damping of their transmissions [N m s/rad or N s/m], ``(m,)``.
        gap: Full width of their backlash [rad or m], ``(m,)``.
        chain: Positions of all joints of the tree as a function of the active joints.
    """

    joint_constants: Array
    joint_indices: Array
    root: Array
    added_inertia: Array
    rotor: Array
    viscous: Array
    coulomb: Array
    drives: Array
    encoders: Array
    loose: Array
    stiffness: Array
    damping: Array
    gap: Array
    chain: Chain


@jit
def run_arm(arm: Arm, laws: EffectLaws, control: Control, moving: Moving, plan: Plan, rows: Rows) -> int:
    """Simulate: record each of the N samples, and make the planned steps after it.

    Args:
        arm: The machine.
        laws: Laws of all effects; their states are updated.
        control: Source of the commanded torque.
        moving: State of the machine, which is updated.
        plan: Times of samples and steps.
        rows: Output: the recorded values.

    Returns:
        The sample after which a speed exceeded ``plan.far`` or loops could not be closed; -1 if neither happened.
    """
    row = arm.root.copy()
    drives, encoders, mode = arm.drives, arm.encoders, control.mode
    x, v, a, transmitted, friction = moving.x, moving.v, moving.a, moving.transmitted, moving.friction
    commanded, delivered = moving.commanded, moving.delivered
    torques, commands, readings, lines = laws
    t_codes, t_rows, t_others, t_shares = torques.codes, torques.rows, torques.others, torques.shares
    t_numbers, t_state = torques.numbers, torques.state
    c_codes, c_rows, c_numbers, c_state = commands.codes, commands.rows, commands.numbers, commands.state
    rings, ends = lines.rings, lines.ends
    n, nv = len(x), len(drives)
    mobility, y, w, applied, speed = np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    reading, bias = np.zeros(nv), np.zeros(nv)
    places = FrictionPlaces(drives, np.zeros((0, n)), np.zeros((0, n + 1)))
    for k in range(len(plan.t)):
        h = plan.steps[k]
        if mode != GIVEN:
            write_command(control, readings, encoders, x, v, plan.t[k], reading, commanded)
        else:
            read_all(readings, encoders, x, reading)
        record(rows, k, reading, commanded, delivered, x, v, a)
        for step in range(plan.counts[k]):
            # Positions and velocities half a step ahead, at which forces and inertia are evaluated.
            for i in range(n):
                y[i], w[i] = x[i] + 0.5 * h * v[i], v[i] + 0.5 * h * a[i]
                applied[i] = 0.0
            if mode == AT_STEPS:
                write_command(control, readings, encoders, y, w, plan.t[k] + (step + 0.5) * h, reading, commanded)
            move_root(row, plan.base, k, (step + 0.5) / plan.counts[k])
            # `inertia` writes the mass matrix into the array that `invert` later overwrites by its inverse.
            inertia(arm, row, y, w, h, mobility, bias)
            for j in range(nv):
                delivered[j] = commanded[j]
            for i in range(len(c_codes)):
                j = int(c_rows[i])
                delivered[j] = delivered_by_drive(c_codes, c_numbers, c_state, rings, ends, i, h, delivered[j])
            for i in range(len(t_codes)):
                j, at, other, share = int(t_rows[i]), int(drives[t_rows[i]]), int(drives[t_others[i]]), t_shares[i]
                rate = w[at] + share * w[other]
                torque = effect_torque(t_codes, t_numbers, t_state, i, y[at], rate, transmitted[j])
                applied[at] += torque
                applied[other] += share * torque
            effects_passed(drives, applied, transmitted)
            for j in range(nv):
                applied[j] -= bias[j]
                applied[drives[j]] += delivered[j] - arm.viscous[j] * v[drives[j]]
            transmit(arm, y, w, applied, transmitted)
            invert(mobility)
            accelerate(mobility, applied, v, h, speed)
            apply_dry_friction(mobility, speed, places, friction, arm.coulomb, h)
            slow = advance(x, v, a, y, speed, h, plan.far)
            drives_passed(arm, delivered, v, a, friction, transmitted)
            if not slow:
                return k
            if step == 0:
                for i in range(n):
                    rows.after[k, i] = a[i]
    return -1


@jit
def write_command(
    control: Control, readings: Laws, encoders: Array, x: Array, v: Array, t: float, reading: Array, out: Array
) -> None:
    """Write encoder readings to ``reading``, and the torque that the tracking law commands to ``out``."""
    share = place_in(control.t, control.cursor, t)
    for j in range(len(encoders)):
        at = int(encoders[j])
        reading[j] = read(readings.codes, readings.rows, readings.numbers, j, x[at])
        out[j] = tracking(control.tables, control.limits[j], control.cursor[0], share, j, reading[j], v[at])


@inlined_jit
def read_all(readings: Laws, encoders: Array, x: Array, reading: Array) -> None:
    """Write the readings of the encoders at positions ``x``."""
    for j in range(len(encoders)):
        reading[j] = read(readings.codes, readings.rows, readings.numbers, j, x[int(encoders[j])])


@inlined_jit
def record(
    rows: Rows, k: int, reading: Array, commanded: Array, delivered: Array, x: Array, v: Array, a: Array
) -> None:
    """Write sample ``k``; before the first step, the commanded torque is written as the delivered torque."""
    for j in range(len(reading)):
        rows.q[k, j], rows.commanded[k, j] = reading[j], commanded[j]
        rows.delivered[k, j] = commanded[j] if np.isnan(delivered[j]) else delivered[j]
    for i in range(len(x)):
        rows.x[k, i], rows.v[k, i], rows.before[k, i], rows.after[k, i] = x[i], v[i], a[i], a[i]


@inlined_jit
def inertia(arm: Arm, row: Array, y: Array, w: Array, h: float, mass: Array, bias: Array) -> None:
    """Write the mass matrix plus half a step of viscous friction, and the link torque at zero acceleration.

    If the loops of a chain cannot be closed, the torque is NaN, and so is the state after the step.

    Args:
        arm: The machine.
        row: A copy of its ``root``, which is changed.
        y: Positions, ``(n,)``.
        w: Velocities, ``(n,)``.
        h: Length of the step [s].
        mass: Output: the matrix, ``(n, n)``.
        bias: Output: the link torque, ``(nv,)``.
    """
    n = len(y)
    for i in range(n):
        for j in range(n):
            mass[i, j] = 0.0
    if len(arm.chain.slope) > 0:
        if not chained_mass_and_bias(arm.joint_constants, arm.joint_indices, row, arm.chain, y, w, mass, bias):
            bias[:] = np.nan
    else:
        mass_and_bias(arm.joint_constants, arm.joint_indices, row, y, w, mass, bias)
    for i in range(n):
        for j in range(n):
            mass[i, j] += arm.added_inertia[i, j]
    for j in range(len(arm.drives)):
        mass[arm.drives[j], arm.drives[j]] += 0.5 * h * arm.viscous[j]


@inlined_jit
def transmit(arm: Arm, y: Array, w: Array, applied: Array, transmitted: Array) -> None:
    """Write the torques of elastic transmissions, and add them to the torques ``applied`` on motors and links."""
    for i in range(len(arm.loose)):
        j, at = arm.loose[i], len(arm.drives) + i
        torque = spring_torque(y[at] - y[j], w[at] - w[j], arm.stiffness[i], arm.damping[i], arm.gap[i])
        applied[j] += torque
        applied[at] -= torque
        transmitted[j] = torque


@jit
def spring_torque(apart: float, rate: float, stiffness: float, damping: float, gap: float) -> float:
    """Torque of a transmission on its link; with backlash it is zero inside the gap, and the contact cannot pull."""
    if gap <= 0.0:
        return stiffness * apart + damping * rate
    if apart > 0.5 * gap:
        return max(stiffness * (apart - 0.5 * gap) + damping * rate, 0.0)
    if apart < -0.5 * gap:
        return min(stiffness * (apart + 0.5 * gap) + damping * rate, 0.0)
    return 0.0


@inlined_jit
def effects_passed(drives: Array, applied: Array, transmitted: Array) -> None:
    """Write the torque of the effects as the first part of the torque that rigid transmissions pass."""
    for j in range(len(drives)):
        if drives[j] == j:
            transmitted[j] = applied[j]


@inlined_jit
def drives_passed(arm: Arm, delivered: Array, v: Array, a: Array, friction: Array, transmitted: Array) -> None:
    """Add to the torque of rigid transmissions the drive torque minus the torque of rotor and modelled friction."""
    for j in range(len(delivered)):
        if arm.drives[j] == j:
            transmitted[j] += delivered[j] - arm.rotor[j] * a[j] - arm.viscous[j] * v[j] + friction[j]


@inlined_jit
def accelerate(mobility: Array, applied: Array, v: Array, h: float, speed: Array) -> None:
    """Write the speeds after ``h`` seconds of the torques ``applied``, without dry friction."""
    for i in range(len(v)):
        speed[i] = v[i]
        for j in range(len(v)):
            speed[i] += mobility[i, j] * h * applied[j]


@inlined_jit
def advance(x: Array, v: Array, a: Array, y: Array, speed: Array, h: float, far: float) -> bool:
    """Write the state after a step, from half-way positions ``y`` and new speeds.

    Returns:
        False if a speed exceeds ``far`` or is NaN.
    """
    slow = True
    for i in range(len(x)):
        a[i] = (speed[i] - v[i]) / h
        v[i] = speed[i]
        x[i] = y[i] + 0.5 * h * v[i]
        slow = slow and abs(v[i]) < far
    return slow
