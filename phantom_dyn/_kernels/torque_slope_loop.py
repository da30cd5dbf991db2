"""Compiled loop over samples: derivatives of the torque of the links by positions and velocities.

All quantities are about the origin of the root, so that those of the bodies that a joint carries can be added. A joint
moves these bodies by a motion ``s`` per unit of its velocity, and its parent has velocity ``v`` and acceleration ``a``.
Per unit of the joint's position, the velocity of the bodies changes by ``v x s`` and their acceleration by
``a x s + v x (v x s)``; per unit of the joint's velocity, they change by ``s`` and ``2 v x s`` (S. Singh, R. P. Russell
and P. M. Wensing, IEEE Robotics and Automation Letters 7(2), 2022). If the angular velocity changes by ``w``, a
particle of mass ``m`` at ``r`` with velocity ``u`` needs a force ``2 m w x u``. So the forces on a body follow from its
sums of ``m u`` and ``m u r^T``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn._kernels.poses import cross, dot, place
from phantom_dyn._kernels.rigid_body_loops import Workspace, carry, hand_over, set_root, times_inertia
from phantom_dyn._kernels.tree_arrays import Kinematics
from phantom_dyn.array_types import Array


class SlopeWorkspace(NamedTuple):
    """Work arrays of `torque_slope_loop`: motions and forces about the origin of the root, the linear part first.

    Attributes:
        s: Motion of each joint per unit of its velocity, ``(nt, 6)``.
        velocity_change: ``v x s`` of each joint, ``(nt, 6)``.
        half_acceleration_change: Half of ``a x s + v x (v x s)`` of each joint, ``(nt, 6)``.
        v, a: Velocity and acceleration of each body, the root first, ``(n, 6)``.
        f: Force on all bodies that a joint carries, ``(n, 6)``.
        flow: Sums of ``m u`` and ``m u r^T`` over all bodies that a joint carries, ``(n, 12)``.
        force: Forces on the carried bodies of the current joint: their derivatives by its position and by its velocity,
            then the force of a unit acceleration, ``(3, 6)``.
    """

    s: Array
    velocity_change: Array
    half_acceleration_change: Array
    v: Array
    a: Array
    f: Array
    flow: Array
    force: Array


def slope_workspace_of(tree: Kinematics, gravity: Array) -> SlopeWorkspace:
    """Work arrays for one sample of a tree, whose root is fixed under this gravity [m/s2]."""
    n = len(tree.parents)
    s, velocity_change, half_acceleration_change = np.zeros((3, n - 1, 6))
    v, a, f = np.zeros((3, n, 6))
    a[0, :3] = -gravity
    return SlopeWorkspace(s, velocity_change, half_acceleration_change, v, a, f, np.zeros((n, 12)), np.zeros((3, 6)))


@fused
def torque_slope_loop(
    tree: Kinematics,
    inertias: Array,
    workspace: Workspace,
    slope_workspace: SlopeWorkspace,
    root: Array,
    q: Array,
    v: Array,
    a: Array,
    out: Array,
) -> None:
    """Write the derivatives of the torque of N samples for joints of one degree of freedom.

    Args:
        tree: The joints.
        inertias: Mass, first moments and inertia of each body, from `TreeArrays`.
        workspace: Work arrays of the tree, from `workspace_of`.
        slope_workspace: Work arrays of the derivatives, from `slope_workspace_of`.
        root: Motion of a moving root, see `torque_loop`, ``(N, 9)``; ``(0, 9)`` for a fixed one.
        q: Pinocchio's configurations, ``(N, nq)``.
        v: Velocities, ``(N, nt)``.
        a: Accelerations, ``(N, nt)``.
        out: Zeros, ``(2, nt, nt, N)``. Output: in ``[0, j, i, sample]`` the derivative of the torque of joint i by the
            position of joint j, and in ``[1, j, i, sample]`` the derivative by its velocity.
    """
    parents, kinds, first_q, first_v, rotations, translations, axes = tree
    R, o, _, _, _, lin, ang, _, _, whole = workspace
    s, velocity_change, half_acceleration_change, velocity, acceleration, f, flow, force = slope_workspace
    n = len(parents)
    for k in range(len(q)):
        place(parents, kinds, first_q, first_v, rotations, translations, axes, q, k, R, o, lin, ang)
        set_root(root, k, velocity, acceleration, acceleration, 3)
        for i in range(1, n):
            p, d = parents[i], first_v[i]
            x, y, z = cross(o[i, 0], o[i, 1], o[i, 2], ang[d, 0], ang[d, 1], ang[d, 2])
            s[d, 0], s[d, 1], s[d, 2] = lin[d, 0] + x, lin[d, 1] + y, lin[d, 2] + z
            for c in range(3):
                s[d, 3 + c] = ang[d, c]
            for c in range(6):
                velocity_change[d, c] = half_acceleration_change[d, c] = 0.0
            add_crossed(velocity, p, s, d, velocity_change)
            add_crossed(acceleration, p, s, d, half_acceleration_change)
            add_crossed(velocity, p, velocity_change, d, half_acceleration_change)
            for c in range(6):
                half_acceleration_change[d, c] *= 0.5
                velocity[i, c] = velocity[p, c] + s[d, c] * v[k, d]
                acceleration[i, c] = acceleration[p, c] + s[d, c] * a[k, d] + velocity_change[d, c] * v[k, d]
            # Parameters of the body about the origin of the root, computed in the row of the root, which has no body.
            for c in range(10):
                whole[0, c], whole[i, c] = 0.0, inertias[i, c]
            carry(whole, i, R)
            hand_over(whole, i, 0, o[i, 0], o[i, 1], o[i, 2])
            for c in range(10):
                whole[i, c] = whole[0, c]
            write_flow(whole, i, velocity, flow)
            write_force(whole, flow, i, velocity, acceleration, i, f, i)
        for i in range(n - 1, 0, -1):
            p, d = parents[i], first_v[i]
            write_force(whole, flow, i, velocity_change, half_acceleration_change, d, force, 0)
            write_force(whole, flow, i, s, velocity_change, d, force, 1)
            # The force on the carried bodies turns with the joint, which changes the torque of the joints before it.
            for c in range(6):
                force[0, c], force[1, c] = 2.0 * force[0, c], 2.0 * force[1, c]
            add_force_crossed(s, d, f, i, force)
            inertia_times(whole, i, s, d, force, 2)
            x, y, z = cross(flow[i, 0], flow[i, 1], flow[i, 2], s[d, 0], s[d, 1], s[d, 2])
            trace = flow[i, 3] + flow[i, 7] + flow[i, 11]
            x += trace * ang[d, 0] - dot(flow[i, 3], flow[i, 6], flow[i, 9], ang[d, 0], ang[d, 1], ang[d, 2])
            y += trace * ang[d, 1] - dot(flow[i, 4], flow[i, 7], flow[i, 10], ang[d, 0], ang[d, 1], ang[d, 2])
            z += trace * ang[d, 2] - dot(flow[i, 5], flow[i, 8], flow[i, 11], ang[d, 0], ang[d, 1], ang[d, 2])
            j = i
            while j > 0:
                e = first_v[j]
                by_q = by_v = on_q = on_v = 0.0
                for c in range(6):
                    by_q += s[e, c] * force[0, c]
                    by_v += s[e, c] * force[1, c]
                    on_q += force[2, c] * half_acceleration_change[e, c]
                    on_v += force[2, c] * velocity_change[e, c]
                out[0, d, e, k], out[1, d, e, k] = by_q, by_v
                turn_x, turn_y, turn_z = velocity_change[e, 3], velocity_change[e, 4], velocity_change[e, 5]
                out[0, e, d, k] = 2.0 * (on_q + dot(x, y, z, turn_x, turn_y, turn_z))
                out[1, e, d, k] = 2.0 * (on_v + dot(x, y, z, ang[e, 0], ang[e, 1], ang[e, 2]))
                j = parents[j]
            for c in range(10):
                whole[p, c] += whole[i, c]
            for c in range(12):
                flow[p, c] += flow[i, c]
            for c in range(6):
                f[p, c] += f[i, c]


@inlined
def add_crossed(by: Array, i: int, motion: Array, d: int, out: Array) -> None:
    """Add the motion ``by[i] x motion[d]`` to ``out[d]``."""
    ux, uy, uz, wx, wy, wz = by[i, 0], by[i, 1], by[i, 2], by[i, 3], by[i, 4], by[i, 5]
    x, y, z = cross(wx, wy, wz, motion[d, 0], motion[d, 1], motion[d, 2])
    out[d, 0], out[d, 1], out[d, 2] = out[d, 0] + x, out[d, 1] + y, out[d, 2] + z
    sx, sy, sz = motion[d, 3], motion[d, 4], motion[d, 5]
    x, y, z = cross(ux, uy, uz, sx, sy, sz)
    out[d, 0], out[d, 1], out[d, 2] = out[d, 0] + x, out[d, 1] + y, out[d, 2] + z
    x, y, z = cross(wx, wy, wz, sx, sy, sz)
    out[d, 3], out[d, 4], out[d, 5] = out[d, 3] + x, out[d, 4] + y, out[d, 5] + z


@inlined
def add_force_crossed(s: Array, d: int, f: Array, i: int, force: Array) -> None:
    """Add the change of the force ``f[i]``, if the motion ``s[d]`` moves it, to ``force[0]``."""
    x, y, z = cross(s[d, 3], s[d, 4], s[d, 5], f[i, 0], f[i, 1], f[i, 2])
    force[0, 0], force[0, 1], force[0, 2] = force[0, 0] + x, force[0, 1] + y, force[0, 2] + z
    x, y, z = cross(s[d, 0], s[d, 1], s[d, 2], f[i, 0], f[i, 1], f[i, 2])
    force[0, 3], force[0, 4], force[0, 5] = force[0, 3] + x, force[0, 4] + y, force[0, 5] + z
    x, y, z = cross(s[d, 3], s[d, 4], s[d, 5], f[i, 3], f[i, 4], f[i, 5])
    force[0, 3], force[0, 4], force[0, 5] = force[0, 3] + x, force[0, 4] + y, force[0, 5] + z


@inlined
def inertia_times(whole: Array, i: int, motion: Array, d: int, out: Array, row: int) -> None:
    """Write to ``out[row]`` the force that accelerates the bodies that joint ``i`` carries by ``motion[d]``."""
    m, hx, hy, hz = whole[i, 0], whole[i, 1], whole[i, 2], whole[i, 3]
    lx, ly, lz, sx, sy, sz = motion[d, 0], motion[d, 1], motion[d, 2], motion[d, 3], motion[d, 4], motion[d, 5]
    x, y, z = cross(sx, sy, sz, hx, hy, hz)
    out[row, 0], out[row, 1], out[row, 2] = m * lx + x, m * ly + y, m * lz + z
    x, y, z = cross(hx, hy, hz, lx, ly, lz)
    tx, ty, tz = times_inertia(whole, i, sx, sy, sz)
    out[row, 3], out[row, 4], out[row, 5] = x + tx, y + ty, z + tz


@inlined
def write_force(whole: Array, flow: Array, i: int, turning: Array, motion: Array, d: int, out: Array, row: int) -> None:
    """Write to ``out[row]`` the force of `inertia_times` plus forces ``m w x u``; ``turning[d]`` contains ``w``."""
    inertia_times(whole, i, motion, d, out, row)
    wx, wy, wz = turning[d, 3], turning[d, 4], turning[d, 5]
    x, y, z = cross(wx, wy, wz, flow[i, 0], flow[i, 1], flow[i, 2])
    out[row, 0], out[row, 1], out[row, 2] = out[row, 0] + x, out[row, 1] + y, out[row, 2] + z
    trace = flow[i, 3] + flow[i, 7] + flow[i, 11]
    out[row, 3] += trace * wx - dot(flow[i, 3], flow[i, 4], flow[i, 5], wx, wy, wz)
    out[row, 4] += trace * wy - dot(flow[i, 6], flow[i, 7], flow[i, 8], wx, wy, wz)
    out[row, 5] += trace * wz - dot(flow[i, 9], flow[i, 10], flow[i, 11], wx, wy, wz)


@inlined
def write_flow(whole: Array, i: int, velocity: Array, flow: Array) -> None:
    """Write the sums of ``m u`` and ``m u r^T`` of body ``i`` alone to ``flow[i]``."""
    m, hx, hy, hz = whole[i, 0], whole[i, 1], whole[i, 2], whole[i, 3]
    ux, uy, uz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
    wx, wy, wz = velocity[i, 3], velocity[i, 4], velocity[i, 5]
    x, y, z = cross(wx, wy, wz, hx, hy, hz)
    flow[i, 0], flow[i, 1], flow[i, 2] = m * ux + x, m * uy + y, m * uz + z
    # Sums of m r r^T are half the trace of the inertia times the identity, minus the inertia.
    half = 0.5 * (whole[i, 4] + whole[i, 6] + whole[i, 9])
    xy, xz, yz = -whole[i, 5], -whole[i, 7], -whole[i, 8]
    x, y, z = cross(wx, wy, wz, half - whole[i, 4], xy, xz)
    flow[i, 3], flow[i, 6], flow[i, 9] = ux * hx + x, uy * hx + y, uz * hx + z
    x, y, z = cross(wx, wy, wz, xy, half - whole[i, 6], yz)
    flow[i, 4], flow[i, 7], flow[i, 10] = ux * hy + x, uy * hy + y, uz * hy + z
    x, y, z = cross(wx, wy, wz, xz, yz, half - whole[i, 9])
    flow[i, 5], flow[i, 8], flow[i, 11] = ux * hz + x, uy * hz + y, uz * hz + z
