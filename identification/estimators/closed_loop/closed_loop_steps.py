"""Compiled simulation of a robot under position controllers, the robot given by parameters that are being estimated.

The step is the one of `phantom_dyn.simulation.stepping`: the midpoint rule on velocity level with dry friction as an
impulse, so that a joint at standstill stays there. Each joint of the tree has one degree of freedom.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identification.estimators.closed_loop.plant import Plant
from phantom_dyn._kernels.dry_friction import FrictionPlaces, apply_dry_friction
from phantom_dyn._kernels.followed_loops import rewind
from phantom_dyn._kernels.jit import jit
from phantom_dyn._kernels.single_state import chained_mass_and_bias, invert
from phantom_dyn.array_types import Array

_TOO_FAST = 1e6
"""Speed [rad/s or m/s] at which the integration has blown up."""


class Controllers(NamedTuple):
    """Position controllers of all joints and how they are integrated.

    Attributes:
        q_ref: References, ``(N, nv)``.
        gains: Position gain, velocity gain and torque limit of each joint, ``(3, nv)``.
        window: Samples over which the controller differentiates, 0 for the true velocity.
        delay: Time [s] by which the torque is late.
        held: True if the controller works once a sample, else all the time.
        dt: Time between samples [s].
        steps: Integration steps per sample.
    """

    q_ref: Array
    gains: Array
    window: int
    delay: float
    held: bool
    dt: float
    steps: int


class Moved(NamedTuple):
    """Inputs of a simulation of N samples, each of shape ``(N, nv)``.

    Attributes:
        q: Positions.
        v: Velocities.
        a: Accelerations, means over a step before and one after the sample.
        tau: Drive torque.
    """

    q: Array
    v: Array
    a: Array
    tau: Array


@jit
def run(plant: Plant, controllers: Controllers, q0: Array, v0: Array, out: Moved) -> int:
    """Simulate N samples from ``q0``, ``v0``, ``(nv,)`` each; the sample at which the robot cannot go on, or -1."""
    N, nv = out.q.shape
    held, steps = controllers.held, controllers.steps
    h = controllers.dt / steps
    every = steps if held else 1
    asked = np.empty((N if held else N * steps, nv))
    room, mass, weight = plant.root.copy(), np.empty((nv, nv)), np.empty(nv)
    qm, vm, applied, force, speed = np.empty(nv), np.empty(nv), np.zeros(nv), np.empty(nv), np.empty(nv)
    viscous, level, impulse = np.empty(len(plant.E)), np.empty(len(plant.E)), np.empty(len(plant.E))
    places = FrictionPlaces(np.arange(nv), plant.E[nv:], np.empty((len(plant.E) - nv, nv + 1)))
    q, v, a = q0.copy(), v0.copy(), np.zeros(nv)
    rewind(plant.chain.loops)
    for k in range(N):
        for i in range(nv):
            out.q[k, i], out.v[k, i], out.a[k, i] = q[i], v[i], a[i]
        for s in range(steps):
            # The last sample needs one step for its torque and acceleration, and no more.
            if k == N - 1 and s == 1:
                break
            for i in range(nv):
                qm[i], vm[i] = q[i] + 0.5 * h * v[i], v[i] + 0.5 * h * a[i]
            if s % every == 0:
                share = 0.0 if held else (s + 0.5) / steps
                at, rate = (q, v) if held else (qm, vm)
                ask(controllers, k, share, at, rate, (q0, v0), out.q, asked[k if held else k * steps + s])
            arrive(controllers, k, s, asked, applied, out.tau)
            # Half a step ahead.
            if not chained_mass_and_bias(plant.numbers, plant.places, room, plant.chain, qm, vm, mass, weight):
                return k
            for e in range(len(plant.passive)):
                plant.E[nv + e] = plant.chain.slope[plant.passive[e]]
            for i in range(nv):
                force[i] = applied[i] + plant.push[i] - plant.spring[i] * qm[i] - weight[i]
                for c in range(nv):
                    mass[i, c] += plant.rotor[i, c]
            friction_levels(plant.E, plant.dry, vm, h, viscous, level)
            add_viscous(plant.E, viscous, v, h, force, mass)
            if not invert(mass):
                return k
            accelerate(mass, force, h, v, speed)
            impulse[:] = 0.0
            apply_dry_friction(mass, speed, places, impulse, level, 1.0)
            for i in range(nv):
                if not abs(speed[i]) < _TOO_FAST:
                    return k
                a[i] = (speed[i] - v[i]) / h
                if s == 0:
                    out.a[k, i] = a[i] if k == 0 else 0.5 * (out.a[k, i] + a[i])
                q[i] = qm[i] + 0.5 * h * speed[i]
                v[i] = speed[i]
    return -1


@jit
def accelerate(mobility: Array, force: Array, h: float, v: Array, speed: Array) -> None:
    """Write the velocities that ``h`` seconds of force without dry friction leave behind velocities ``v``."""
    for i in range(len(v)):
        speed[i] = v[i]
        for c in range(len(v)):
            speed[i] += h * mobility[i, c] * force[c]


@jit
def ask(
    controllers: Controllers,
    k: int,
    share: float,
    q: Array,
    v: Array,
    start: tuple[Array, Array],
    past: Array,
    out: Array,
) -> None:
    """Write the torque that the controllers ask for behind sample ``k``.

    Args:
        controllers: References, gains and window.
        k: The sample.
        share: Fraction of the way to the next sample.
        q: Positions, ``(nv,)``.
        v: Velocities, ``(nv,)``.
        start: Positions and velocities at the start, before which motion is taken to be uniform.
        past: Positions of the samples up to this one, ``(N, nv)``.
        out: Receives the torque, ``(nv,)``.
    """
    q0, v0 = start
    wanted, gains, window, dt = controllers.q_ref, controllers.gains, controllers.window, controllers.dt
    for i in range(len(q)):
        goal = wanted[k, i] + share * (wanted[min(k + 1, len(wanted) - 1), i] - wanted[k, i])
        rate = v[i]
        if window > 0:
            before = past[k - window, i] if k >= window else q0[i] - (window - k) * dt * v0[i]
            rate = (q[i] - before) / (window * dt)
        out[i] = gains[0, i] * (goal - q[i]) - gains[1, i] * rate


@jit
def arrive(controllers: Controllers, k: int, s: int, asked: Array, applied: Array, tau: Array) -> None:
    """Write the torque that acts in step ``s`` behind sample ``k``: late, within its limits; and that of the sample.

    Between samples the delay of a torque that changes all the time is interpolated linearly; one that is held arrives
    whole. A simulation with a step of its own choice keeps a line of commands instead, see
    `phantom_dyn.effects.drive.input_delay`.
    """
    held, steps = controllers.held, controllers.steps
    if held:
        old, part = max(0, int(np.floor(k - controllers.delay / controllers.dt + 1e-9))), 0.0
    else:
        place = max(0.0, k * steps + s - controllers.delay / (controllers.dt / steps))
        old = int(place)
        part = place - old
    for i in range(len(applied)):
        given, before = asked[old, i], applied[i]
        if part > 0.0:
            given += part * (asked[old + 1, i] - given)
        limit = controllers.gains[2, i]
        applied[i] = min(max(given, -limit), limit)
        if s == 0:
            # A torque that changes all the time is known half a step before and half a step after a sample.
            tau[k, i] = applied[i] if held or k == 0 else 0.5 * (before + applied[i])


@jit
def friction_levels(E: Array, dry: Array, v: Array, h: float, viscous: Array, level: Array) -> None:
    """Write the viscous coefficient and the largest dry impulse in ``h`` seconds of each rubbing joint, ``(ne,)``."""
    for e in range(len(E)):
        rate = 0.0
        for i in range(len(v)):
            rate += E[e, i] * v[i]
        viscous[e] = dry[e, 3] if rate >= 0.0 else dry[e, 4]
        level[e] = dry[e, 0]
        if dry[e, 1] != 0.0:
            level[e] += dry[e, 1] * np.exp(-((rate / dry[e, 2]) ** 2))
        level[e] = h * max(level[e], 0.0)


@jit
def add_viscous(E: Array, viscous: Array, v: Array, h: float, force: Array, mass: Array) -> None:
    """Add viscous friction to the force and, half a step implicit, to the mass matrix."""
    nv = len(v)
    for e in range(len(E)):
        if viscous[e] != 0.0:
            rate = 0.0
            for i in range(nv):
                rate += E[e, i] * v[i]
            for i in range(nv):
                force[i] -= viscous[e] * rate * E[e, i]
                for c in range(nv):
                    mass[i, c] += 0.5 * h * viscous[e] * E[e, i] * E[e, c]
