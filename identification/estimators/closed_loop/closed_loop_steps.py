"""Compiled simulation of a robot under position controllers, the robot given by parameters that are being estimated.

The step is the one of `phantom_dyn.simulation.stepping`: the midpoint rule on velocity level with dry friction as an
impulse, so that a joint at rest stays at rest.
"""

from __future__ import annotations

import numpy as np

from identification.estimators.closed_loop.loop_dynamics import inverse, inverted, place
from phantom_dyn._kernels.jit import jit

Array = np.ndarray

_SWEEPS = 100  # of the friction solver; it stops when no impulse moves by more than 1e-10 of its limit
_TOO_FAST = 1e6  # [rad/s or m/s]: the integration has blown up


@jit
def rub(mobility: Array, E: Array, limit: Array, impulse: Array, speed: Array) -> None:
    """Apply impulses of dry friction to ``speed``: each stops its joint if it can, else opposes it.

    Args:
        mobility: Inverse of the mass matrix, ``(nv, nv)``.
        E: How fast each rubbing joint turns per velocity of the active ones, ``(ne, nv)``.
        limit: Largest impulses, ``(ne,)``.
        impulse: Receives the impulses, ``(ne,)``.
        speed: Velocities, changed in place, ``(nv,)``.
    """
    ne, nv = E.shape
    reply, own = np.empty((ne, nv)), np.empty(ne)
    for e in range(ne):
        own[e] = impulse[e] = 0.0
        for i in range(nv):
            reply[e, i] = 0.0
            for k in range(nv):
                reply[e, i] += mobility[i, k] * E[e, k]
        for i in range(nv):
            own[e] += E[e, i] * reply[e, i]
    for _ in range(_SWEEPS):
        largest = 0.0
        for e in range(ne):
            if limit[e] > 0.0:
                rate = 0.0
                for i in range(nv):
                    rate += E[e, i] * speed[i]
                wanted = min(max(impulse[e] - rate / own[e], -limit[e]), limit[e])
                change = wanted - impulse[e]
                if change != 0.0:
                    impulse[e] = wanted
                    largest = max(largest, abs(change) / limit[e])
                    for i in range(nv):
                        speed[i] += reply[e, i] * change
        if largest <= 1e-10:
            break
    # A joint that friction holds is at rest, not almost.
    for e in range(min(ne, nv)):
        if limit[e] > 0.0 and abs(impulse[e]) < limit[e]:
            speed[e] = 0.0


@jit
def run(
    parents: Array,
    rotations: Array,
    translations: Array,
    angular: Array,
    linear: Array,
    gravity: Array,
    G: Array,
    offset: Array,
    pi: Array,
    rotor: Array,
    E: Array,
    dry: Array,
    push: Array,
    spring: Array,
    q_ref: Array,
    gains: Array,
    window: int,
    delay: float,
    held: bool,
    dt: float,
    steps: int,
    q0: Array,
    v0: Array,
    q: Array,
    v: Array,
    a: Array,
    tau: Array,
) -> int:
    """Simulate N samples; the sample at which the robot cannot go on, or -1.

    Args:
        parents: The tree, as in `phantom_dyn.maps.tree.Tree`, as the next five.
        rotations: .
        translations: .
        angular: .
        linear: .
        gravity: .
        G: Velocities of the tree per velocity of the active joints, ``(nt, nv)``.
        offset: Positions of the tree where the active joints are at zero, ``(nt,)``.
        pi: Parameters of the bodies, ``(nt, 10)``.
        rotor: What rotors add to the mass matrix, ``(nv, nv)``.
        E: See `rub`; the first ``nv`` rows are the active joints themselves.
        dry: Of each row of ``E``: level at speed, what it is higher by at rest, velocity over which that fades,
            viscous coefficient forward, backward, ``(ne, 5)``.
        push: Constant torque on the joints, ``(nv,)``.
        spring: Stiffness of springs at the joints, at rest at zero, ``(nv,)``.
        q_ref: References, ``(N, nv)``.
        gains: Position gain, velocity gain and torque limit of each joint, ``(3, nv)``.
        window: Samples over which the controller differentiates, 0 for the true velocity.
        delay: Time [s] by which the torque is late.
        held: True if the controller works once a sample, else all the time.
        dt: Time between samples [s].
        steps: Integration steps per sample.
        q0: Start, ``(nv,)``.
        v0: Start, ``(nv,)``.
        q: Receives positions, ``(N, nv)``.
        v: Receives velocities.
        a: Receives accelerations, means over a step before and one after the sample.
        tau: Receives the drive torque.
    """
    N, nv = q.shape
    nt, ne = len(parents), len(E)
    h = dt / steps
    every = steps if held else 1
    asked = np.empty((N if held else N * steps, nv))
    late = delay / (dt if held else h)
    R, p, w, f = np.empty((nt, 3, 3)), np.empty((nt, 3)), np.empty((nt, 9)), np.empty((nt, 6))
    x, xv, xa, tt = np.empty(nt), np.empty(nt), np.empty(nt), np.empty(nt)
    A, mobility, still, none = np.empty((nv, nv)), np.empty((nv, nv)), np.zeros(nt), np.zeros(3)
    qm, vm, applied, force, speed = np.empty(nv), np.empty(nv), np.empty(nv), np.empty(nv), np.empty(nv)
    viscous, level, impulse = np.empty(ne), np.empty(ne), np.empty(ne)
    qc, vc, ac = q0.copy(), v0.copy(), np.zeros(nv)
    for k in range(N):
        for i in range(nv):
            q[k, i], v[k, i], a[k, i] = qc[i], vc[i], ac[i]
        for s in range(steps):
            # The last sample needs one step for its torque and acceleration, and no more.
            if k == N - 1 and s == 1:
                break
            for i in range(nv):
                qm[i], vm[i] = qc[i] + 0.5 * h * vc[i], vc[i] + 0.5 * h * ac[i]
            now = k if held else k * steps + s
            if s % every == 0:
                share = 0.0 if held else (s + 0.5) / steps
                for i in range(nv):
                    wanted = q_ref[k, i] + share * (q_ref[min(k + 1, N - 1), i] - q_ref[k, i])
                    at, rate = (qc[i], vc[i]) if held else (qm[i], vm[i])
                    if window > 0:
                        past = q[k - window, i] if k >= window else q0[i] - (window - k) * dt * v0[i]
                        rate = (qc[i] - past) / (window * dt)
                    asked[now, i] = gains[0, i] * (wanted - at) - gains[1, i] * rate
            if held:
                old = max(0, int(np.floor(now - late + 1e-9)))
                part = 0.0
            else:
                place_of = max(0.0, now - late)
                old = int(place_of)
                part = place_of - old
            for i in range(nv):
                given, before = asked[old, i], applied[i]
                if part > 0.0:
                    given += part * (asked[old + 1, i] - given)
                applied[i] = min(max(given, -gains[2, i]), gains[2, i])
                if s == 0:
                    # A torque that changes all the time is known half a step before and half a step after a sample.
                    tau[k, i] = applied[i] if held or k == 0 else 0.5 * (before + applied[i])
            # Half a step ahead.
            for j in range(nt):
                x[j], xv[j] = offset[j], 0.0
                for i in range(nv):
                    x[j] += G[j, i] * qm[i]
                    xv[j] += G[j, i] * vm[i]
            place(rotations, translations, angular, linear, x, R, p)
            inverse(parents, angular, linear, R, p, pi, gravity, xv, still, w, f, tt)
            for i in range(nv):
                force[i] = applied[i] + push[i] - spring[i] * qm[i]
                for j in range(nt):
                    force[i] -= G[j, i] * tt[j]
            for e in range(ne):
                rate = 0.0
                for i in range(nv):
                    rate += E[e, i] * vm[i]
                viscous[e] = dry[e, 3] if rate >= 0.0 else dry[e, 4]
                level[e] = dry[e, 0]
                if dry[e, 1] != 0.0:
                    level[e] += dry[e, 1] * np.exp(-((rate / dry[e, 2]) ** 2))
                level[e] = h * max(level[e], 0.0)
            for c in range(nv):
                for j in range(nt):
                    xa[j] = G[j, c]
                inverse(parents, angular, linear, R, p, pi, none, still, xa, w, f, tt)
                for i in range(nv):
                    A[i, c] = rotor[i, c]
                    for j in range(nt):
                        A[i, c] += G[j, i] * tt[j]
            for e in range(ne):
                if viscous[e] != 0.0:
                    rate = 0.0
                    for i in range(nv):
                        rate += E[e, i] * vc[i]
                    for i in range(nv):
                        force[i] -= viscous[e] * rate * E[e, i]
                        for c in range(nv):
                            A[i, c] += 0.5 * h * viscous[e] * E[e, i] * E[e, c]
            if not inverted(A, mobility):
                return k
            for i in range(nv):
                speed[i] = vc[i]
                for c in range(nv):
                    speed[i] += h * mobility[i, c] * force[c]
            rub(mobility, E, level, impulse, speed)
            for i in range(nv):
                if not abs(speed[i]) < _TOO_FAST:
                    return k
                ac[i] = (speed[i] - vc[i]) / h
                if s == 0:
                    a[k, i] = ac[i] if k == 0 else 0.5 * (a[k, i] + ac[i])
                qc[i] = qm[i] + 0.5 * h * speed[i]
                vc[i] = speed[i]
    return -1
