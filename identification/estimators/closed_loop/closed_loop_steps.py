"""Compiled simulation of a robot under position controllers, for estimators that change the robot's parameters.

The integration step is that of `phantom_dyn.simulation.stepping`: the midpoint rule for velocities, with dry friction
as an impulse, so that a joint at standstill stays there. Each joint of the tree has one degree of freedom.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identification.estimators.closed_loop.plant import Plant
from phantom_dyn._kernels.dry_friction import FrictionPlaces, apply_dry_friction
from phantom_dyn._kernels.jit import jit
from phantom_dyn._kernels.loop_closure_state import rewind
from phantom_dyn._kernels.single_state import chained_mass_and_bias, invert
from phantom_dyn.array_types import Array

_TOO_FAST = 1e6
"""Speed [rad/s or m/s] above which the integration has diverged."""


class Controllers(NamedTuple):
    """Position controllers of all joints, and settings of the integration.

    Attributes:
        q_ref: References, ``(N, nv)``.
        gains: Rows with position gain, velocity gain and torque limit of each joint, ``(3, nv)``.
        window: Samples over which the controller differentiates positions; 0 if it uses the true velocity.
        delay: Delay of the torque [s].
        held: True if the controller computes a torque once per sample and holds it, False if in every step.
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


class Trajectory(NamedTuple):
    """Simulated motion and torque of N samples, which `run` writes; each has shape ``(N, nv)``.

    Attributes:
        q: Positions.
        v: Velocities.
        a: Accelerations: means of the step before and the step after each sample.
        tau: Drive torque.
    """

    q: Array
    v: Array
    a: Array
    tau: Array


@jit
def run(plant: Plant, controllers: Controllers, q0: Array, v0: Array, out: Trajectory) -> int:
    """Simulate N samples from ``q0`` and ``v0``, ``(nv,)`` each; return the sample at which it failed, or -1."""
    N, nv = out.q.shape
    held, steps = controllers.held, controllers.steps
    h = controllers.dt / steps
    every = steps if held else 1
    commanded = np.empty((N if held else N * steps, nv))
    moving, mass, bias = plant.root.copy(), np.empty((nv, nv)), np.empty(nv)
    qm, vm, applied, force, speed = np.empty(nv), np.empty(nv), np.zeros(nv), np.empty(nv), np.empty(nv)
    viscous, level, impulse = (
        np.empty(len(plant.J_friction)),
        np.empty(len(plant.J_friction)),
        np.empty(len(plant.J_friction)),
    )
    places = FrictionPlaces(np.arange(nv), plant.J_friction[nv:], np.empty((len(plant.J_friction) - nv, nv + 1)))
    q, v, a = q0.copy(), v0.copy(), np.zeros(nv)
    rewind(plant.chain.loops)
    for k in range(N):
        for i in range(nv):
            out.q[k, i], out.v[k, i], out.a[k, i] = q[i], v[i], a[i]
        for s in range(steps):
            # The last sample needs only one step, for its torque and acceleration.
            if k == N - 1 and s == 1:
                break
            for i in range(nv):
                qm[i], vm[i] = q[i] + 0.5 * h * v[i], v[i] + 0.5 * h * a[i]
            if s % every == 0:
                share = 0.0 if held else (s + 0.5) / steps
                at, rate = (q, v) if held else (qm, vm)
                write_command(controllers, k, share, at, rate, (q0, v0), out.q, commanded[k if held else k * steps + s])
            write_torque(controllers, k, s, commanded, applied, out.tau)
            # Mass matrix and bias torque at the middle of the step.
            if not chained_mass_and_bias(
                plant.joint_constants, plant.joint_indices, moving, plant.chain, qm, vm, mass, bias
            ):
                return k
            for e in range(len(plant.passive)):
                plant.J_friction[nv + e] = plant.chain.slope[plant.passive[e]]
            for i in range(nv):
                force[i] = applied[i] + plant.constant_torque[i] - plant.stiffness[i] * qm[i] - bias[i]
                for c in range(nv):
                    mass[i, c] += plant.rotor[i, c]
            friction_levels(plant.J_friction, plant.friction, vm, h, viscous, level)
            add_viscous(plant.J_friction, viscous, v, h, force, mass)
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
    """Write the velocities after a step of ``h`` seconds from velocities ``v``, without dry friction."""
    for i in range(len(v)):
        speed[i] = v[i]
        for c in range(len(v)):
            speed[i] += h * mobility[i, c] * force[c]


@jit
def write_command(
    controllers: Controllers,
    k: int,
    share: float,
    q: Array,
    v: Array,
    start: tuple[Array, Array],
    past: Array,
    out: Array,
) -> None:
    """Write the torque that the controllers command at a time between samples ``k`` and ``k + 1``.

    Args:
        controllers: References, gains and window.
        k: Index of the sample before this time.
        share: Fraction of the time to the next sample.
        q: Positions, ``(nv,)``.
        v: Velocities, ``(nv,)``.
        start: Positions and velocities at the start; before it, these velocities are taken to be constant.
        past: Positions of the samples up to this one, ``(N, nv)``.
        out: Receives the torque, ``(nv,)``.
    """
    q0, v0 = start
    q_ref, gains, window, dt = controllers.q_ref, controllers.gains, controllers.window, controllers.dt
    for i in range(len(q)):
        reference = q_ref[k, i] + share * (q_ref[min(k + 1, len(q_ref) - 1), i] - q_ref[k, i])
        rate = v[i]
        if window > 0:
            before = past[k - window, i] if k >= window else q0[i] - (window - k) * dt * v0[i]
            rate = (q[i] - before) / (window * dt)
        out[i] = gains[0, i] * (reference - q[i]) - gains[1, i] * rate


@jit
def write_torque(controllers: Controllers, k: int, s: int, commanded: Array, applied: Array, tau: Array) -> None:
    """Write the torque that acts in step ``s`` after sample ``k``, with delay and limits, and the torque of the sample.

    Commands that are computed in every step are interpolated linearly at the delayed time. Commands that are held for a
    sample are not interpolated.
    """
    held, steps = controllers.held, controllers.steps
    if held:
        old, part = max(0, int(np.floor(k - controllers.delay / controllers.dt + 1e-9))), 0.0
    else:
        place = max(0.0, k * steps + s - controllers.delay / (controllers.dt / steps))
        old = int(place)
        part = place - old
    for i in range(len(applied)):
        given, before = commanded[old, i], applied[i]
        if part > 0.0:
            given += part * (commanded[old + 1, i] - given)
        limit = controllers.gains[2, i]
        applied[i] = min(max(given, -limit), limit)
        if s == 0:
            # The torque of a step is that at its middle; the torque at the sample is the mean of the two steps around.
            tau[k, i] = applied[i] if held or k == 0 else 0.5 * (before + applied[i])


@jit
def friction_levels(E: Array, dry: Array, v: Array, h: float, viscous: Array, level: Array) -> None:
    """Write viscous coefficient and largest dry impulse in ``h`` seconds of each joint with friction, ``(ne,)``."""
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
    """Add viscous friction at the middle of a step: by the old velocity to the force, by its change to the mass."""
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
