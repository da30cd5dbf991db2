"""Equations of motion of a serial chain: composite rigid bodies and Newton-Euler, all about the world's origin.

Every axis, inertia and force is a spatial vector in world axes, angular part first, so nothing is ever transformed
from link to link. Written for this package alone; the tests hold it against MuJoCo and closed forms. Numba keeps what
it compiled of `simulate`, and does not see a change here: remove ``__pycache__`` after one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

Array = np.ndarray


@dataclass(frozen=True)
class Chain:
    """A serial robot on a fixed base; link i moves with joint i.

    Attributes:
        linear: True where the joint is linear, shape ``(n,)``.
        axis: Unit axis of each joint in its own frame, shape ``(n, 3)``.
        turn: Orientation of each joint frame in the one before, shape ``(n, 3, 3)``.
        place: Its origin there [m], shape ``(n, 3)``.
        mass: Of each link [kg], shape ``(n,)``.
        center: Centre of mass in the joint's frame [m], shape ``(n, 3)``.
        inertia: About the centre, axes of the joint's frame [kg m^2], shape ``(n, 3, 3)``.
        gravity: In the base frame [m/s^2], shape ``(3,)``.
    """

    linear: Array
    axis: Array
    turn: Array
    place: Array
    mass: Array
    center: Array
    inertia: Array
    gravity: Array

    @property
    def n(self) -> int:
        return len(self.mass)

    def numbers(self) -> tuple[Array, ...]:
        """The fields as the compiled functions take them."""
        return (
            self.linear,
            self.axis,
            self.turn,
            self.place,
            self.mass,
            self.center,
            self.inertia,
            self.gravity,
        )


@njit(cache=True)
def _cross(a: Array, b: Array, out: Array) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _momentum(m: float, mc: Array, inertia: Array, twist: Array, out: Array) -> None:
    """Spatial inertia (mass, first moment, moment about the origin) times a twist."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[i] = inertia[i, 0] * twist[0] + inertia[i, 1] * twist[1] + inertia[i, 2] * twist[2]
        out[i] += mc[j] * twist[3 + k] - mc[k] * twist[3 + j]
        out[3 + i] = m * twist[3 + i] + twist[j] * mc[k] - twist[k] * mc[j]


@njit(cache=True)
def _times(a: Array, b: Array, out: Array) -> None:
    """Product of two 3 x 3 matrices."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@njit(cache=True)
def _along(rot: Array, x: Array, out: Array) -> None:
    """A vector of a body in world axes."""
    for i in range(3):
        out[i] = rot[i, 0] * x[0] + rot[i, 1] * x[1] + rot[i, 2] * x[2]


@njit(cache=True)
def _go(linear: bool, axis: Array, turn: Array, place: Array, q: float, rot: Array, pos: Array, s: Array) -> None:
    """From a body's pose to that of the next one, in place; writes the twist of the joint between them."""
    here, step, z = np.zeros((3, 3)), np.zeros(3), np.zeros(3)
    column, first, second = np.zeros(3), np.zeros(3), np.zeros(3)
    _along(rot, place, step)
    for i in range(3):
        pos[i] += step[i]
    _times(rot, turn, here)
    _along(here, axis, z)
    if linear:
        rot[:] = here
        for i in range(3):
            pos[i] += z[i] * q
            s[3 + i] = z[i]
        return
    # Rodrigues about the world axis: R = here + sin(q) [z] here + (1 - cos q) [z]^2 here, column by column.
    sin, vers = np.sin(q), 1.0 - np.cos(q)
    for j in range(3):
        for i in range(3):
            column[i] = here[i, j]
        _cross(z, column, first)
        _cross(z, first, second)
        for i in range(3):
            rot[i, j] = column[i] + sin * first[i] + vers * second[i]
    _cross(pos, z, first)
    for i in range(3):
        s[i] = z[i]
        s[3 + i] = first[i]


@njit(cache=True)
def _about_origin(m: float, center: Array, inertia: Array, rot: Array, pos: Array, mc: Array, io: Array) -> None:
    """Writes first moment and inertia of a body about the world's origin, in world axes."""
    c, half = np.zeros(3), np.zeros((3, 3))
    _along(rot, center, c)
    _times(rot, inertia, half)
    for i in range(3):
        c[i] += pos[i]
        mc[i] = m * c[i]
    square = c[0] * c[0] + c[1] * c[1] + c[2] * c[2]
    for i in range(3):
        for j in range(3):
            io[i, j] = half[i, 0] * rot[j, 0] + half[i, 1] * rot[j, 1] + half[i, 2] * rot[j, 2] - m * c[i] * c[j]
        io[i, i] += m * square


@njit(cache=True)
def _crossed_motion(twist: Array, s: Array, out: Array) -> None:
    """Rate of a twist that is carried by a body that moves with another one."""
    one, two = np.zeros(3), np.zeros(3)
    _cross(twist[:3], s[:3], one)
    out[:3] = one
    _cross(twist[:3], s[3:], one)
    _cross(twist[3:], s[:3], two)
    out[3:] = one + two


@njit(cache=True)
def _crossed_force(twist: Array, mom: Array, out: Array) -> None:
    """Adds the rate of a spatial momentum that is carried by a moving body."""
    one, two = np.zeros(3), np.zeros(3)
    _cross(twist[:3], mom[:3], one)
    _cross(twist[3:], mom[3:], two)
    out[:3] += one + two
    _cross(twist[:3], mom[3:], one)
    out[3:] += one


@njit(cache=True)
def _composed(s: Array, ms: Array, mcs: Array, ios: Array, force: Array, big: Array, bias: Array) -> None:
    """Writes mass matrix and bias from the tip inwards: each joint moves all bodies behind it as one."""
    n, mom = len(ms), np.zeros(6)
    for i in range(n - 1, -1, -1):
        if i < n - 1:
            ms[i] += ms[i + 1]
            mcs[i] += mcs[i + 1]
            ios[i] += ios[i + 1]
            force[i] += force[i + 1]
        _momentum(ms[i], mcs[i], ios[i], s[i], mom)
        bias[i] = 0.0
        for a in range(6):
            bias[i] += s[i, a] * force[i, a]
        for j in range(i + 1):
            total = 0.0
            for a in range(6):
                total += s[j, a] * mom[a]
            big[i, j] = big[j, i] = total


@njit(cache=True)
def mass_and_bias(chain: tuple[Array, ...], q: Array, v: Array, big: Array, bias: Array) -> None:
    """Writes the mass matrix of the links and the torque that no acceleration needs (gravity included).

    Args:
        chain: `Chain.numbers`.
        q: Positions [rad or m], shape ``(n,)``.
        v: Velocities [rad/s or m/s], shape ``(n,)``.
        big: Mass matrix, written, shape ``(n, n)``.
        bias: Torques at zero acceleration [N m or N], written, shape ``(n,)``.
    """
    linear, axis, turn, place, mass, center, inertia, gravity = chain
    n = len(q)
    s, mom, rate = np.zeros((n, 6)), np.zeros(6), np.zeros(6)
    mcs, ios, force = np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros((n, 6))
    rot, pos, twist, acc = np.eye(3), np.zeros(3), np.zeros(6), np.zeros(6)
    acc[3:] = -gravity
    for i in range(n):
        _go(linear[i], axis[i], turn[i], place[i], q[i], rot, pos, s[i])
        _crossed_motion(twist, s[i], rate)
        for a in range(6):
            twist[a] += s[i, a] * v[i]
            acc[a] += rate[a] * v[i]
        _about_origin(mass[i], center[i], inertia[i], rot, pos, mcs[i], ios[i])
        _momentum(mass[i], mcs[i], ios[i], acc, force[i])
        _momentum(mass[i], mcs[i], ios[i], twist, mom)
        _crossed_force(twist, mom, force[i])
    _composed(s, mass.copy(), mcs, ios, force, big, bias)


@njit(cache=True)
def _many(chain: tuple[Array, ...], q: Array, v: Array, a: Array) -> Array:
    rows, n = q.shape
    out, big, bias = np.zeros((rows, n)), np.zeros((n, n)), np.zeros(n)
    for k in range(rows):
        mass_and_bias(chain, q[k], v[k], big, bias)
        for i in range(n):
            total = bias[i]
            for j in range(n):
                total += big[i, j] * a[k, j]
            out[k, i] = total
    return out


def link_torque(chain: Chain, q: Array, v: Array, a: Array) -> Array:
    """Torques that the links need for a motion [N m or N], without rotors and friction, shape ``(N, n)``."""
    return _many(chain.numbers(), *(np.ascontiguousarray(x, dtype=float) for x in (q, v, a)))
