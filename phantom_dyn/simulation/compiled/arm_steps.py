"""Compiled steps of a tree of one-degree joints, some with motors that may move apart from their links.

Passive joints of a closed chain follow the active ones linearly, and ``nv`` counts the active ones.

The same rule as `phantom_dyn.simulation.stepping`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.dry_friction import Rubbing, rub
from phantom_dyn._kernels.jit import jit
from phantom_dyn._kernels.single_state import Chain, chained_mass_and_bias, invert, mass_and_bias
from phantom_dyn.effects.compiled_laws import DELAY, command_of, delay_law, torque_of
from phantom_dyn.simulation.compiled.arrays import AT_STEPS, GIVEN, Control, Laws, Lines, Moving, Rows
from phantom_dyn.simulation.compiled.axis_steps import spring_torque
from phantom_dyn.simulation.compiled.channels import place_in, read, tracking

Array = np.ndarray


class Arm(NamedTuple):
    """A machine of ``nv`` joints and ``m`` loose motors behind them, ``n`` together.

    Attributes:
        numbers: As `joint_rows` gives them.
        places: The same.
        root: As `at_root` gives it; copied before it is used.
        added: Inertia besides that of the links (rotors, couplings), ``(n, n)``.
        rotor: Inertias of the rotors, ``(nv,)``.
        viscous: Viscous coefficients, ``(nv,)``.
        coulomb: Coulomb torques, ``(nv,)``.
        drives: Place of each joint's motor, ``(nv,)``.
        seen: Place of what each joint's encoder sits on, ``(nv,)``.
        loose: Joints with loose motors, ``(m,)``.
        stiffness: Of their transmissions, ``(m,)``.
        damping: The same, ``(m,)``.
        gap: The same, ``(m,)``.
        chain: How the tree follows the joints.
    """

    numbers: Array
    places: Array
    root: Array
    added: Array
    rotor: Array
    viscous: Array
    coulomb: Array
    drives: Array
    seen: Array
    loose: Array
    stiffness: Array
    damping: Array
    gap: Array
    chain: Chain


@jit
def ask(
    control: Control, readings: Laws, seen: Array, x: Array, v: Array, t: float, reading: Array, out: Array
) -> None:
    """Torque that the tracking law asks for at a state; ``reading`` receives the readings."""
    share = place_in(control.t, control.cursor, t)
    for j in range(len(seen)):
        at = int(seen[j])
        reading[j] = read(readings.codes, readings.rows, readings.numbers, j, x[at])
        out[j] = tracking(control.tables, control.limits[j], control.cursor[0], share, j, reading[j], v[at])


@jit
def run_arm(
    arm: Arm, torques: Laws, commands: Laws, readings: Laws, lines: Lines, control: Control, moving: Moving,
    t: Array, steps: Array, counts: Array, far: float, rows: Rows,
) -> int:  # fmt: skip
    """Record N samples and make ``counts[k]`` steps of ``steps[k]`` seconds behind sample ``k``.

    Returns:
        The sample behind which a speed was beyond ``far``, -1 if none ever was.
    """
    numbers, places, row = arm.numbers, arm.places, arm.root.copy()
    added, rotor, viscous, coulomb = arm.added, arm.rotor, arm.viscous, arm.coulomb
    drives, seen, loose = arm.drives, arm.seen, arm.loose
    x, v, a, transmitted, friction = moving.x, moving.v, moving.a, moving.transmitted, moving.friction
    asked, given, mode = moving.asked, moving.given, control.mode
    t_codes, t_rows, t_others, t_shares = torques.codes, torques.rows, torques.others, torques.shares
    t_numbers, t_state = torques.numbers, torques.state
    c_codes, c_rows, c_numbers, c_state = commands.codes, commands.rows, commands.numbers, commands.state
    n, nv, m = len(x), len(drives), len(loose)
    mobility, y, w, push, speed = np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    reading, bias = np.zeros(nv), np.zeros(nv)
    closed, who = len(arm.chain.slope) > 0, Rubbing(drives, np.zeros((0, n)), np.zeros((0, n + 1)))
    for k in range(len(t)):
        if mode != GIVEN:
            ask(control, readings, seen, x, v, t[k], reading, asked)
        else:
            for j in range(nv):
                reading[j] = read(readings.codes, readings.rows, readings.numbers, j, x[int(seen[j])])
        for j in range(nv):
            rows.q[k, j], rows.asked[k, j] = reading[j], asked[j]
            rows.given[k, j] = asked[j] if np.isnan(given[j]) else given[j]
        for i in range(n):
            rows.x[k, i], rows.v[k, i], rows.before[k, i], rows.after[k, i] = x[i], v[i], a[i], a[i]
        h = steps[k]
        for step in range(counts[k]):
            for i in range(n):
                y[i], w[i] = x[i] + 0.5 * h * v[i], v[i] + 0.5 * h * a[i]
            if mode == AT_STEPS:
                ask(control, readings, seen, y, w, t[k] + (step + 0.5) * h, reading, asked)
            for i in range(n):
                for j in range(n):
                    mobility[i, j] = 0.0
            if closed:
                chained_mass_and_bias(numbers, places, row, arm.chain, y, w, mobility, bias)
            else:
                mass_and_bias(numbers, places, row, y, w, mobility, bias)
            for i in range(n):
                push[i] = 0.0
                for j in range(n):
                    mobility[i, j] += added[i, j]
            for j in range(nv):
                given[j] = asked[j]
                mobility[drives[j], drives[j]] += 0.5 * h * viscous[j]
            for i in range(len(c_codes)):
                j = int(c_rows[i])
                if c_codes[i] == DELAY:
                    lines.ends[i, 0], lines.ends[i, 1], given[j] = delay_law(
                        lines.rings[i], lines.ends[i, 0], lines.ends[i, 1], c_numbers[i, 0], h, given[j]
                    )
                else:
                    c_state[i, 0], given[j] = command_of(c_codes[i], c_numbers[i, 0], c_state[i, 0], h, given[j])
            for i in range(len(t_codes)):
                j, at, other, share = int(t_rows[i]), int(drives[t_rows[i]]), int(drives[t_others[i]]), t_shares[i]
                t_state[i, 0], t_state[i, 1], t_state[i, 2], torque = torque_of(
                    t_codes[i], t_numbers[i, 0], t_numbers[i, 1], t_numbers[i, 2], t_numbers[i, 3],
                    t_state[i, 0], t_state[i, 1], t_state[i, 2],
                    y[at], w[at] + share * w[other], transmitted[j],
                )  # fmt: skip
                push[at] += torque
                push[other] += share * torque
            for j in range(nv):
                push[j] -= bias[j]
                push[drives[j]] += given[j] - viscous[j] * v[drives[j]]
            for i in range(m):
                j, at = loose[i], nv + i
                torque = spring_torque(y[at] - y[j], w[at] - w[j], arm.stiffness[i], arm.damping[i], arm.gap[i])
                push[j] += torque
                push[at] -= torque
                transmitted[j] = torque
            invert(mobility)
            for i in range(n):
                speed[i] = v[i]
                for j in range(n):
                    speed[i] += mobility[i, j] * h * push[j]
            rub(mobility, speed, who, friction, coulomb, h)
            fast = False
            for i in range(n):
                a[i] = (speed[i] - v[i]) / h
                v[i] = speed[i]
                x[i] = y[i] + 0.5 * h * v[i]
                # Not a number is fast too.
                fast = fast or not abs(v[i]) < far
            for j in range(nv):
                if drives[j] == j:
                    transmitted[j] = given[j] - rotor[j] * a[j]
            if fast:
                return k
            if step == 0:
                for i in range(n):
                    rows.after[k, i] = a[i]
    return -1
