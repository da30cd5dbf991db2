"""Compiled steps of a machine with one joint: a link with a motor that is tied to it, or apart from it by a spring.

The same rule as `phantom_dyn.simulation.stepping`, where with one joint nothing is left to solve. Laws of effects
are called by their numbers, see `phantom_dyn.effects.compiled_laws`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import jit, within
from phantom_dyn.simulation.compiled.arrays import AT_STEPS, GIVEN, Control, EffectLaws, Moving, Plan, Rows
from phantom_dyn.simulation.compiled.channels import effect_torque, given_by_drive, place_in, read, tracking


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
def run_axis(axis: Axis, laws: EffectLaws, control: Control, moving: Moving, plan: Plan, rows: Rows) -> int:
    """Record N samples and make the planned steps behind each.

    Returns:
        The sample behind which the speed was beyond ``plan.far``, -1 if it never was.
    """
    link, rotor, loose, viscous, coulomb = axis.link, axis.rotor, axis.loose, axis.viscous, axis.coulomb
    stiffness, damping, gap = axis.stiffness, axis.damping, axis.gap
    motor_read = axis.motor_read
    mode, t, steps, counts, far = control.mode, plan.t, plan.steps, plan.counts, plan.far
    torques, commands, readings, lines = laws
    rings, ends = lines.rings, lines.ends
    t_codes, t_numbers, t_state = torques.codes, torques.numbers, torques.state
    c_codes, c_numbers, c_state = commands.codes, commands.numbers, commands.state
    xl, vl, al = moving.x[0], moving.v[0], moving.a[0]
    xm, vm, am = (moving.x[1], moving.v[1], moving.a[1]) if loose else (xl, vl, al)
    transmitted, asked, given = moving.transmitted[0], moving.asked[0], moving.given[0]
    broke = -1
    for k in range(len(t)):
        reading = read(readings.codes, readings.rows, readings.numbers, 0, xm if motor_read else xl)
        if mode != GIVEN:
            asked = tracked(control, t[k], reading, vm if motor_read else vl)
        rows.q[k, 0], rows.asked[k, 0], rows.given[k, 0] = reading, asked, (asked if np.isnan(given) else given)
        for i in range(2 if loose else 1):
            rows.x[k, i], rows.v[k, i] = (xl, vl) if i == 0 else (xm, vm)
            rows.before[k, i] = rows.after[k, i] = al if i == 0 else am
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
                reading = read(readings.codes, readings.rows, readings.numbers, 0, y if motor_read else x)
                asked = tracked(control, t[k] + (i + 0.5) * h, reading, w if motor_read else v)
            given = asked
            for n in range(len(c_codes)):
                given = given_by_drive(c_codes, c_numbers, c_state, rings, ends, n, h, given)
            drive = given
            for n in range(len(t_codes)):
                drive += effect_torque(t_codes, t_numbers, t_state, n, y, w, transmitted)
            weight = axis.at_zero * np.cos(x) + axis.at_quarter * np.sin(x) if axis.turns else axis.at_zero
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
        xm, vm, am = (xm, vm, am) if loose else (xl, vl, al)
        if broke >= 0:
            break
    moving.x[0], moving.v[0], moving.a[0] = xl, vl, al
    if loose:
        moving.x[1], moving.v[1], moving.a[1] = xm, vm, am
    moving.transmitted[0], moving.asked[0], moving.given[0] = transmitted, asked, given
    return broke


@within
def tracked(control: Control, t: float, q: float, v: float) -> float:
    """Torque that the tracking law asks for at time ``t`` with a reading and a velocity."""
    share = place_in(control.t, control.cursor, t)
    return tracking(control.tables, control.limits[0], control.cursor[0], share, 0, q, v)


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
