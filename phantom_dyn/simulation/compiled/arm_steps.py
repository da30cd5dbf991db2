"""Compiled simulation steps of a tree of joints with one degree of freedom.

Some joints may have an elastic transmission between motor and link. The integrator is the midpoint rule of
`phantom_dyn.simulation.stepping`. A closed chain has ``nv`` active joints, which its passive joints follow. Laws of
effects are called by their numbers, see `phantom_dyn.effects.compiled_laws`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.dry_friction import FrictionPlaces, apply_dry_friction
from phantom_dyn._kernels.jit import inlined_jit, jit
from phantom_dyn._kernels.single_state import Chain, chained_mass_and_bias, invert, mass_and_bias, move_root
from phantom_dyn.array_types import Array
from phantom_dyn.simulation.compiled.arrays import AT_STEPS, GIVEN, Control, EffectLaws, Laws, Moving, Plan, Rows
from phantom_dyn.simulation.compiled.channels import effect_torque, given_by_drive, place_in, read, tracking


class Arm(NamedTuple):
    """A machine whose state has ``nv`` joints and then ``m`` motors on elastic transmissions, ``n = nv + m``.

    Attributes:
        joint_constants: Constants of each joint of the tree, from `joint_rows`.
        joint_indices: Parent, kind and velocity index of each joint, from `joint_rows`.
        root: Motion of the root from `at_root`; copied before it is changed to the motion in a plan.
        added_inertia: Inertia that is added to that of the links (rotors, couplings), ``(n, n)``.
        rotor: Inertias of the rotors, ``(nv,)``.
        viscous: Viscous coefficients, ``(nv,)``.
        coulomb: Coulomb torques, ``(nv,)``.
        drives: Index of each joint's motor in the state, ``(nv,)``.
        encoders: Index of the position that each joint's encoder measures, motor or link, ``(nv,)``.
        loose: Joints with an elastic transmission, ``(m,)``.
        stiffness: Stiffness of their transmissions, ``(m,)``.
        damping: Damping of their transmissions, ``(m,)``.
        gap: Backlash of their transmissions, ``(m,)``.
        chain: How the tree follows the active joints.
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
    """Record N samples and make the planned steps after each.

    Returns:
        The sample after which a speed exceeded ``plan.far`` or loops could not be closed; -1 if that did not happen.
    """
    row = arm.root.copy()
    drives, seen, mode = arm.drives, arm.encoders, control.mode
    x, v, a, transmitted, friction = moving.x, moving.v, moving.a, moving.transmitted, moving.friction
    asked, given = moving.asked, moving.given
    torques, commands, readings, lines = laws
    t_codes, t_rows, t_others, t_shares = torques.codes, torques.rows, torques.others, torques.shares
    t_numbers, t_state = torques.numbers, torques.state
    c_codes, c_rows, c_numbers, c_state = commands.codes, commands.rows, commands.numbers, commands.state
    rings, ends = lines.rings, lines.ends
    n, nv = len(x), len(drives)
    mobility, y, w, push, speed = np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    reading, bias = np.zeros(nv), np.zeros(nv)
    places = FrictionPlaces(drives, np.zeros((0, n)), np.zeros((0, n + 1)))
    for k in range(len(plan.t)):
        h = plan.steps[k]
        if mode != GIVEN:
            ask(control, readings, seen, x, v, plan.t[k], reading, asked)
        else:
            read_all(readings, seen, x, reading)
        record(rows, k, reading, asked, given, x, v, a)
        for step in range(plan.counts[k]):
            for i in range(n):
                y[i], w[i] = x[i] + 0.5 * h * v[i], v[i] + 0.5 * h * a[i]
                push[i] = 0.0
            if mode == AT_STEPS:
                ask(control, readings, seen, y, w, plan.t[k] + (step + 0.5) * h, reading, asked)
            move_root(row, plan.base, k, (step + 0.5) / plan.counts[k])
            inertia(arm, row, y, w, h, mobility, bias)
            for j in range(nv):
                given[j] = asked[j]
            for i in range(len(c_codes)):
                j = int(c_rows[i])
                given[j] = given_by_drive(c_codes, c_numbers, c_state, rings, ends, i, h, given[j])
            for i in range(len(t_codes)):
                j, at, other, share = int(t_rows[i]), int(drives[t_rows[i]]), int(drives[t_others[i]]), t_shares[i]
                rate = w[at] + share * w[other]
                torque = effect_torque(t_codes, t_numbers, t_state, i, y[at], rate, transmitted[j])
                push[at] += torque
                push[other] += share * torque
            effects_passed(drives, push, transmitted)
            for j in range(nv):
                push[j] -= bias[j]
                push[drives[j]] += given[j] - arm.viscous[j] * v[drives[j]]
            transmit(arm, y, w, push, transmitted)
            invert(mobility)
            accelerate(mobility, push, v, h, speed)
            apply_dry_friction(mobility, speed, places, friction, arm.coulomb, h)
            slow = advance(x, v, a, y, speed, h, plan.far)
            drives_passed(arm, given, v, a, friction, transmitted)
            if not slow:
                return k
            if step == 0:
                for i in range(n):
                    rows.after[k, i] = a[i]
    return -1


@jit
def ask(
    control: Control, readings: Laws, seen: Array, x: Array, v: Array, t: float, reading: Array, out: Array
) -> None:
    """Write the torque that the tracking law commands at a state, and write the encoder readings to ``reading``."""
    share = place_in(control.t, control.cursor, t)
    for j in range(len(seen)):
        at = int(seen[j])
        reading[j] = read(readings.codes, readings.rows, readings.numbers, j, x[at])
        out[j] = tracking(control.tables, control.limits[j], control.cursor[0], share, j, reading[j], v[at])


@inlined_jit
def read_all(readings: Laws, seen: Array, x: Array, reading: Array) -> None:
    """Write the readings of the encoders at positions ``x``."""
    for j in range(len(seen)):
        reading[j] = read(readings.codes, readings.rows, readings.numbers, j, x[int(seen[j])])


@inlined_jit
def record(rows: Rows, k: int, reading: Array, asked: Array, given: Array, x: Array, v: Array, a: Array) -> None:
    """Write sample ``k``; before the first step, the torque that the drives gave is the commanded torque."""
    for j in range(len(reading)):
        rows.q[k, j], rows.asked[k, j] = reading[j], asked[j]
        rows.given[k, j] = asked[j] if np.isnan(given[j]) else given[j]
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
        mass: Receives the matrix, ``(n, n)``.
        bias: Receives the link torque, ``(nv,)``.
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
def transmit(arm: Arm, y: Array, w: Array, push: Array, transmitted: Array) -> None:
    """Write the torques of elastic transmissions, and add them to the push on motors and links."""
    for i in range(len(arm.loose)):
        j, at = arm.loose[i], len(arm.drives) + i
        torque = spring_torque(y[at] - y[j], w[at] - w[j], arm.stiffness[i], arm.damping[i], arm.gap[i])
        push[j] += torque
        push[at] -= torque
        transmitted[j] = torque


@jit
def spring_torque(apart: float, rate: float, stiffness: float, damping: float, gap: float) -> float:
    """Torque of a transmission on its link: zero inside the backlash, and contact only pushes."""
    if gap <= 0.0:
        return stiffness * apart + damping * rate
    if apart > 0.5 * gap:
        return max(stiffness * (apart - 0.5 * gap) + damping * rate, 0.0)
    if apart < -0.5 * gap:
        return min(stiffness * (apart + 0.5 * gap) + damping * rate, 0.0)
    return 0.0


@inlined_jit
def effects_passed(drives: Array, push: Array, transmitted: Array) -> None:
    """Write the effects' torque as the first part of the torque that rigid transmissions pass on."""
    for j in range(len(drives)):
        if drives[j] == j:
            transmitted[j] = push[j]


@inlined_jit
def drives_passed(arm: Arm, given: Array, v: Array, a: Array, friction: Array, transmitted: Array) -> None:
    """Add, for rigid transmissions, the drive torque minus that of rotor and modelled friction."""
    for j in range(len(given)):
        if arm.drives[j] == j:
            transmitted[j] += given[j] - arm.rotor[j] * a[j] - arm.viscous[j] * v[j] + friction[j]


@inlined_jit
def accelerate(mobility: Array, push: Array, v: Array, h: float, speed: Array) -> None:
    """Write the speeds after ``h`` seconds of a push, without dry friction."""
    for i in range(len(v)):
        speed[i] = v[i]
        for j in range(len(v)):
            speed[i] += mobility[i, j] * h * push[j]


@inlined_jit
def advance(x: Array, v: Array, a: Array, y: Array, speed: Array, h: float, far: float) -> bool:
    """Write the state after a step from half-way positions ``y`` and new speeds; False if a speed exceeds ``far``."""
    slow = True
    for i in range(len(x)):
        a[i] = (speed[i] - v[i]) / h
        v[i] = speed[i]
        x[i] = y[i] + 0.5 * h * v[i]
        # The comparison is False for NaN too.
        slow = slow and abs(v[i]) < far
    return slow
