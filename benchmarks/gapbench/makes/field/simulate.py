"""Moves a true robot under its controller: semi-implicit steps of a quarter of a millisecond.

Springs, dampers and contacts are taken at the end of the step (so any stiffness is stable); dry friction is the
impulse that brings a joint to rest, or its level where that does not suffice, found by projected Gauss-Seidel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from .dynamics import Chain, mass_and_bias
from .plant import ORDERS, ROW, Plant, rows_of

Array = np.ndarray
STEP = 2.5e-4  # [s]
SWEEPS = 40  # most passes over the friction impulses; warm started, a few suffice
SLIPS = np.array([0.25, 0.75, 1.25, 1.75])  # displacements of the parallel slip elements, over their mean
SPRING_LOSS = 0.02  # damping of a transmission spring, of the critical one


@dataclass(frozen=True)
class Task:
    """What a run is asked to do, the same with and without an effect.

    Attributes:
        ref: Reference of the encoder's reading at every step, shape ``(K, n)``.
        speed: Its rate, shape ``(K, n)``.
        feed: Torque that the controller adds, shape ``(K, n)``.
        kp: Gains, shape ``(n,)``; ``kd`` of the speed.
        extra: Torques that no log shows, shape ``(K, n)``.
        held: True while the second chain (with a load) moves, shape ``(K,)``.
    """

    ref: Array
    speed: Array
    feed: Array
    kp: Array
    kd: Array
    extra: Array
    held: Array


@dataclass(frozen=True)
class Run:
    """What happened at every step, each of shape ``(K, n)``.

    Attributes:
        reading: Of the encoders, before any rounding [rad or m].
        speed: True rate on the encoder's side.
        command: Torque that the controller asked for [N m or N].
        rubbed: Dry friction of each joint, against the motion positive or negative as it acts [N m or N].
    """

    reading: Array
    speed: Array
    command: Array
    rubbed: Array


@njit(cache=True)
def _inverse(a: Array, out: Array) -> None:
    """Inverse of a small positive definite matrix by Gauss-Jordan, which needs no pivots there."""
    n = len(a)
    out[:] = 0.0
    for i in range(n):
        out[i, i] = 1.0
    for i in range(n):
        d = 1.0 / a[i, i]
        for j in range(n):
            a[i, j] *= d
            out[i, j] *= d
        for k in range(n):
            if k != i and a[k, i] != 0.0:
                f = a[k, i]
                for j in range(n):
                    a[k, j] -= f * a[i, j]
                    out[k, j] -= f * out[i, j]


@njit(cache=True)
def _tie(a: Array, rhs: Array, m: int, i: int, k: float, c: float, now: float, dt: float) -> None:
    """Adds a spring and damper between motor m and link i, taken at the end of the step."""
    e = dt * dt * k + dt * c
    a[m, m] += e
    a[i, i] += e
    a[m, i] -= e
    a[i, m] -= e
    rhs[m] -= dt * k * now
    rhs[i] += dt * k * now


@njit(cache=True)
def _read(plant, k, i, x, v, ref, speed, feed, kp, kd, reading, rate, command) -> float:
    """Writes what the encoder and the controller of one joint say at a step; returns the command's size."""
    turn = plant[ROW.wave_order, i] * x + plant[ROW.wave_phase, i]
    reading[k, i] = x + plant[ROW.shift, i] + plant[ROW.wave, i] * np.sin(turn)
    rate[k, i] = v
    read_rate = v * (1.0 + plant[ROW.wave, i] * plant[ROW.wave_order, i] * np.cos(turn))
    command[k, i] = feed[k, i] + kp[i] * (ref[k, i] - reading[k, i]) + kd[i] * (speed[k, i] - read_rate)
    return abs(command[k, i])


@njit(cache=True)
def _drive(plant, k, i, x, command, lagged, drop, dt) -> float:
    """Torque that a motor gives for what was asked."""
    late = plant[ROW.delay, i] / dt
    back = int(late)
    first, second = command[max(k - back, 0), i], command[max(k - back - 1, 0), i]
    tau = first + (late - back) * (second - first)
    tau = min(max(tau, -plant[ROW.limit, i]), plant[ROW.limit, i])
    if plant[ROW.lag, i] > 0.0:
        lagged[i] = tau if k == 0 else lagged[i] + (tau - lagged[i]) * (1.0 - np.exp(-dt / plant[ROW.lag, i]))
        tau = lagged[i]
    tau *= plant[ROW.ratio, i] * (1.0 - drop)
    tau *= 1.0 + plant[ROW.ripple, i] * np.sin(plant[ROW.ripple_order, i] * x)
    tau += plant[ROW.offset, i]
    for c in range(ORDERS):
        tau += plant[ROW.heights + c, i] * np.sin(plant[ROW.orders + c, i] * x + plant[ROW.phases + c, i])
    return tau


@njit(cache=True)
def _link_springs(plant, i, a, rhs, x, dt) -> None:
    """Adds what holds a link beside its drive: a parasitic spring, and an elastic stop."""
    rhs[i] -= dt * plant[ROW.spring, i] * (x[i] - plant[ROW.rest, i])
    a[i, i] += dt * dt * plant[ROW.spring, i]
    deep = plant[ROW.wall_side, i] * (x[i] - plant[ROW.wall_at, i])
    if plant[ROW.wall, i] > 0.0 and deep > 0.0:
        rhs[i] -= dt * plant[ROW.wall, i] * plant[ROW.wall_side, i] * deep
        a[i, i] += dt * dt * plant[ROW.wall, i] + dt * 0.02 * plant[ROW.wall, i]


@njit(cache=True)
def _transmission(plant, i, m, a, rhs, x, v, inertia, dt) -> None:
    """Adds the spring between motor m and link i, or the stop that closes a gap, nearly rigid and without rebound."""
    now, half = x[m] - x[i], 0.5 * plant[ROW.gap, i]
    stiff = plant[ROW.stiff, i] if plant[ROW.stiff, i] > 0.0 else 4.0 * inertia / (dt * dt)
    loss = 2.0 * SPRING_LOSS * np.sqrt(stiff * inertia) if plant[ROW.stiff, i] > 0.0 else 0.0
    ahead = now + dt * (v[m] - v[i])
    if half == 0.0:
        _tie(a, rhs, m, i, stiff, loss, now, dt)
    elif ahead > half:
        _tie(a, rhs, m, i, stiff, loss, now - half, dt)
    elif ahead < -half:
        _tie(a, rhs, m, i, stiff, loss, now + half, dt)


@njit(cache=True)
def _friction(plant, whole, k, i, m, a, rhs, x, v, slip, tl, dt) -> float:
    """Adds damping and slip elements of a joint; returns what its dry friction has beyond its two levels."""
    a[m, m] += dt * (plant[ROW.damp_forth, i] if v[m] > 0.0 else plant[ROW.damp_back, i])
    if plant[ROW.bristle, i] > 0.0:
        each = plant[ROW.bristle, i] / plant[ROW.reach, i] / len(SLIPS)
        for c in range(len(SLIPS)):
            rhs[m] -= dt * each * slip[i, c]
            if abs(slip[i, c] + dt * v[m]) < SLIPS[c] * plant[ROW.reach, i]:
                a[m, m] += dt * dt * each
    level = plant[ROW.loaded, i] * abs(tl[i]) + plant[ROW.warm, i] * np.exp(-k * dt / whole[6])
    if plant[ROW.static, i] > 0.0:
        level += plant[ROW.static, i] * np.exp(-((v[m] / plant[ROW.slide, i]) ** 2))
    if plant[ROW.drag, i] > 0.0:
        level += plant[ROW.drag, i] * max(x[i] - plant[ROW.drag_at, i], 0.0)
    return level


@njit(cache=True)
def _settle(a, inv, rhs, jac, reach, lo, hi, lam, new) -> None:
    """Velocities after the step, and the impulses of dry friction between their limits."""
    size, rows = len(rhs), len(lam)
    _inverse(a, inv)
    for p in range(size):
        new[p] = 0.0
        for r in range(size):
            new[p] += inv[p, r] * rhs[r]
    for c in range(rows):
        lam[c] = min(max(lam[c], lo[c]), hi[c])
        for p in range(size):
            reach[c, p] = 0.0
            for r in range(size):
                reach[c, p] += inv[p, r] * jac[c, r]
            new[p] += reach[c, p] * lam[c]
    for _ in range(SWEEPS):
        most = 0.0
        for c in range(rows):
            w, weight = 0.0, 0.0
            for p in range(size):
                w += jac[c, p] * new[p]
                weight += jac[c, p] * reach[c, p]
            if weight <= 0.0:  # a motor that is too heavy to be moved, as one that is sought for a large effect may be
                continue
            change = min(max(lam[c] - w / weight, lo[c]), hi[c]) - lam[c]
            lam[c] += change
            most = max(most, abs(change * weight))
            for p in range(size):
                new[p] += reach[c, p] * change
        if most < 1e-9:
            break


@njit(cache=True)
def _frame(plant, whole, n) -> tuple[Array, Array]:
    """Index of each joint's motor among the velocities, and the rows that dry friction acts along."""
    motor, size = np.arange(n), n
    for i in range(n):
        if plant[ROW.stiff, i] > 0.0 or plant[ROW.gap, i] > 0.0:
            motor[i] = size
            size += 1
    jac = np.zeros((n + (1 if whole[0] >= 0.0 else 0), size))
    for i in range(n):
        jac[i, motor[i]] = 1.0
    if len(jac) > n:
        jac[n, motor[int(whole[0])]] = 1.0
        jac[n, motor[int(whole[1])]] = whole[2]
    return motor, jac


@njit(cache=True)
def _inertias(plant, whole, links, motor, jac, a, rhs, v, dt) -> None:
    """Writes mass matrix and momentum, rotors and a coupled mass included, and adds the coupling's damping."""
    n, size = len(motor), len(rhs)
    a[:] = 0.0
    rhs[:] = 0.0
    a[:n, :n] = links
    for i in range(n):
        a[motor[i], motor[i]] += plant[ROW.rotor, i]
    coupled = len(jac) > n
    for p in range(size):
        for r in range(size):
            if coupled:
                a[p, r] += whole[5] * jac[n, p] * jac[n, r]
            rhs[p] += a[p, r] * v[r]
            if coupled:
                a[p, r] += dt * whole[4] * jac[n, p] * jac[n, r]


@njit(cache=True)
def _loop(plant, whole, chains, task, extra, held, dt) -> tuple[Array, Array, Array, Array]:
    ref, speed, feed, kp, kd = task
    steps, n = ref.shape
    motor, jac = _frame(plant, whole, n)
    rows, size = jac.shape
    x, v = np.zeros(size), np.zeros(size)
    for i in range(n):
        x[i], v[i] = ref[0, i] - plant[ROW.shift, i], speed[0, i]
        x[motor[i]], v[motor[i]] = x[i], v[i]
    a, inv, links, bias = np.zeros((size, size)), np.zeros((size, size)), np.zeros((n, n)), np.zeros(n)
    rhs, new, lam, slip = np.zeros(size), np.zeros(size), np.zeros(rows), np.zeros((n, len(SLIPS)))
    lo, hi, tl, lagged, reach = np.zeros(rows), np.zeros(rows), np.zeros(n), np.zeros(n), np.zeros((rows, size))
    reading, rate, command = np.zeros((steps, n)), np.zeros((steps, n)), np.zeros((steps, n))
    rubbed = np.zeros((steps, n))
    usual, load = 0.0, 0.0
    for k in range(steps):
        total = 0.0
        for i in range(n):
            total += _read(plant, k, i, x[motor[i]], v[motor[i]], ref, speed, feed, kp, kd, reading, rate, command)
        load += (total - load) * dt / 0.1
        usual += (load - usual) / (k + 1.0)
        drop = whole[7] * (load / usual - 1.0) if usual > 0.0 else 0.0
        if held[k]:
            mass_and_bias(chains[1], x[:n], v[:n], links, bias)
        else:
            mass_and_bias(chains[0], x[:n], v[:n], links, bias)
        _inertias(plant, whole, links, motor, jac, a, rhs, v, dt)
        for i in range(n):
            m = motor[i]
            rhs[m] += dt * _drive(plant, k, i, x[m], command, lagged, drop, dt)
            rhs[i] += dt * (extra[k, i] - bias[i])
            _link_springs(plant, i, a, rhs, x, dt)
            if m != i:
                inertia = plant[ROW.rotor, i] if plant[ROW.rotor, i] > 0.0 else links[i, i]
                _transmission(plant, i, m, a, rhs, x, v, inertia, dt)
            level = _friction(plant, whole, k, i, m, a, rhs, x, v, slip, tl, dt)
            lo[i] = -dt * max(plant[ROW.forth, i] + level, 0.0)
            hi[i] = dt * max(plant[ROW.back, i] + level, 0.0)
        if rows > n:
            lo[n], hi[n] = -dt * whole[3], dt * whole[3]
        _settle(a, inv, rhs, jac, reach, lo, hi, lam, new)
        for i in range(n):
            rubbed[k, i] = lam[i] / dt
            tl[i] = bias[i]
            for j in range(n):
                tl[i] += links[i, j] * (new[j] - v[j]) / dt
            for c in range(len(SLIPS)):
                far = SLIPS[c] * plant[ROW.reach, i]
                slip[i, c] = min(max(slip[i, c] + dt * new[motor[i]], -far), far)
        for p in range(size):
            v[p] = new[p]
            x[p] += dt * new[p]
    return reading, rate, command, rubbed


def run(plant: Plant, chain: Chain, task: Task, loaded: Chain | None = None) -> Run:
    """Moves the robot through a task; ``loaded`` is the chain while `Task.held`."""
    chains = (chain.numbers(), (loaded or chain).numbers())
    asked = (task.ref, task.speed, task.feed, task.kp, task.kd)
    return Run(*_loop(*rows_of(plant), chains, asked, task.extra, task.held, STEP))
