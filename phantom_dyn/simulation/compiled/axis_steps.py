"""Compiled steps of a machine with one joint: a link with a motor that is tied to it, or apart from it by a spring.

The same rule as `phantom_dyn.simulation.stepping`, where with one joint nothing is left to solve.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn.effects.compiled_laws import DELAY, command_of, delay_law, torque_of
from phantom_dyn.simulation.compiled.arrays import AT_STEPS, GIVEN, Control, Laws, Lines, Moving, Rows
from phantom_dyn.simulation.compiled.channels import place_in, read, tracking

Array = np.ndarray


class Axis(NamedTuple):
    """One joint.

    Attributes:
        link: Inertia of the link, with the rotor where that is tied to it.
        rotor: Inertia of the rotor.
        loose: True if motor and link may move apart.
        viscous: Viscous coefficient, on the motor's side.
        coulomb: Coulomb torque, on the motor's side.
        stiffness: Of the transmission.
        damping: Of the transmission.
        gap: Full width of its play.
        at_zero: Torque of gravity on the drive at position zero.
        at_quarter: The same a quarter of a turn further; of a linear joint the same.
        turns: True unless the joint is linear, or gravity does not move it.
        motor_read: True if the encoder sits on a motor that is loose.
    """

    link: float
    rotor: float
    loose: bool
    viscous: float
    coulomb: float
    stiffness: float
    damping: float
    gap: float
    at_zero: float
    at_quarter: float
    turns: bool
    motor_read: bool


@jit
def spring_torque(apart: float, rate: float, stiffness: float, damping: float, gap: float) -> float:
    """Torque on a link behind its transmission: none inside the play, and contact never pulls."""
    if gap <= 0.0:
        return stiffness * apart + damping * rate
    if apart > 0.5 * gap:
        return max(stiffness * (apart - 0.5 * gap) + damping * rate, 0.0)
    if apart < -0.5 * gap:
        return min(stiffness * (apart + 0.5 * gap) + damping * rate, 0.0)
    return 0.0


@jit
def run_axis(
    axis: Axis, torques: Laws, commands: Laws, readings: Laws, lines: Lines, control: Control, moving: Moving,
    t: Array, steps: Array, counts: Array, far: float, rows: Rows,
) -> int:  # fmt: skip
    """Record N samples and make ``counts[k]`` steps of ``steps[k]`` seconds behind sample ``k``.

    Returns:
        The sample behind which the speed was beyond ``far``, -1 if it never was.
    """
    link, rotor, loose, viscous, coulomb = axis.link, axis.rotor, axis.loose, axis.viscous, axis.coulomb
    stiffness, damping, gap = axis.stiffness, axis.damping, axis.gap
    at_zero, at_quarter, turns, motor_read = axis.at_zero, axis.at_quarter, axis.turns, axis.motor_read
    mode = control.mode
    t_codes, t_numbers, t_state = torques.codes, torques.numbers, torques.state
    c_codes, c_numbers, c_state = commands.codes, commands.numbers, commands.state
    xl, vl, al = moving.x[0], moving.v[0], moving.a[0]
    xm, vm, am = (moving.x[1], moving.v[1], moving.a[1]) if loose else (xl, vl, al)
    transmitted, asked, given = moving.transmitted[0], moving.asked[0], moving.given[0]
    broke = -1
    for k in range(len(t)):
        reading = read(readings.codes, readings.rows, readings.numbers, 0, xm if motor_read else xl)
        if mode != GIVEN:
            share = place_in(control.t, control.cursor, t[k])
            speed = vm if motor_read else vl
            asked = tracking(control.tables, control.limits[0], control.cursor[0], share, 0, reading, speed)
        rows.q[k, 0], rows.asked[k, 0], rows.given[k, 0] = reading, asked, (asked if np.isnan(given) else given)
        rows.x[k, 0], rows.v[k, 0], rows.before[k, 0], rows.after[k, 0] = xl, vl, al, al
        if loose:
            rows.x[k, 1], rows.v[k, 1], rows.before[k, 1], rows.after[k, 1] = xm, vm, am, am
        if counts[k] == 0:
            continue
        h = steps[k]
        half = 0.5 * h
        ease_motor = 1.0 / ((rotor if loose else link) + half * viscous)
        ease_link, per_step, most = 1.0 / link, 1.0 / h, coulomb * h * ease_motor
        for i in range(counts[k]):
            x, v = xl + half * vl, vl + half * al
            y, w = (xm + half * vm, vm + half * am) if loose else (x, v)
            if mode == AT_STEPS:
                now = t[k] + (i + 0.5) * h
                share = place_in(control.t, control.cursor, now)
                reading = read(readings.codes, readings.rows, readings.numbers, 0, y if motor_read else x)
                speed = w if motor_read else v
                asked = tracking(control.tables, control.limits[0], control.cursor[0], share, 0, reading, speed)
            given = asked
            for n in range(len(c_codes)):
                if c_codes[n] == DELAY:
                    lines.ends[n, 0], lines.ends[n, 1], given = delay_law(
                        lines.rings[n], lines.ends[n, 0], lines.ends[n, 1], c_numbers[n, 0], h, given
                    )
                else:
                    c_state[n, 0], given = command_of(c_codes[n], c_numbers[n, 0], c_state[n, 0], h, given)
            drive = given
            for n in range(len(t_codes)):
                t_state[n, 0], t_state[n, 1], t_state[n, 2], added = torque_of(
                    t_codes[n], t_numbers[n, 0], t_numbers[n, 1], t_numbers[n, 2], t_numbers[n, 3],
                    t_state[n, 0], t_state[n, 1], t_state[n, 2], y, w, transmitted,
                )  # fmt: skip
                drive += added
            weight = at_zero * np.cos(x) + at_quarter * np.sin(x) if turns else at_zero
            if loose:
                spring = spring_torque(y - x, w - v, stiffness, damping, gap)
                new = vl + ease_link * h * (spring - weight)
                al = (new - vl) * per_step
                xl, vl = x + half * new, new
                new = vm + ease_motor * h * (drive - spring - viscous * vm)
                new = new - min(max(new, -most), most)
                am = (new - vm) * per_step
                xm, vm = y + half * new, new
                transmitted = spring
            else:
                new = vl + ease_motor * h * (drive - weight - viscous * vl)
                new = new - min(max(new, -most), most)
                al = (new - vl) * per_step
                xl, vl = x + half * new, new
                transmitted = given - rotor * al
            if not (abs(vl) < far and abs(vm) < far):
                broke = k
                break
            if i == 0:
                rows.after[k, 0] = al
                if loose:
                    rows.after[k, 1] = am
        if not loose:
            xm, vm, am = xl, vl, al
        if broke >= 0:
            break
    moving.x[0], moving.v[0], moving.a[0] = xl, vl, al
    if loose:
        moving.x[1], moving.v[1], moving.a[1] = xm, vm, am
    moving.transmitted[0], moving.asked[0], moving.given[0] = transmitted, asked, given
    return broke
