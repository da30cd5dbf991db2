"""Minimum of a quadratic loss over inertial parameters of bodies that can exist: a compiled interior-point method.

The unknowns are the ten entries of each pseudo-inertia, where the cone is simplest: with ``V`` the inverse, the barrier
``-log det`` has the gradient ``-V`` and the Hessian ``tr(V B_k V B_l)``, with ``B_k`` the symmetric unit matrices
[Boyd]_. Newton's method follows the central path from bodies inside the cone. A general solver of cones takes 2.5 times
as long for one body (benchmarks/test_cone_minimum_benchmark.py), and a diagnosis asks for many minima.

References:
    .. [Boyd] S. Boyd, L. Vandenberghe, Convex Optimization, Cambridge University Press, 2004, sections 11.3 and 11.6.
       Minima are checked against Clarabel in tests/identification/diagnosis/fit/test_cone_minimum.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identification.estimators.consistent.consistent_bodies import standard_of
from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn.array_types import Array, Float

# Rows and columns of the entries of a pseudo-inertia: its upper triangle.
_PLACES = np.array([(i, j) for i in range(4) for j in range(i, 4)])
# Gap between loss and lower bound at which the iteration ends: as a share of what the cone costs, and in squared
# deviations where that is small.
_GAP = 1e-6
# Factor by which the weight of the loss grows from one point of the central path to the next.
_FASTER = 20.0
# Largest number of steps, shortened ones included; forty are usual.
_STEPS = 600
# A point is on the path where the square of Newton's decrement is below this.
_ON_PATH = 0.1
# Part of the expected decrease that a step has to reach, and the factor that shortens it if it does not.
_DECREASE, _SHORTER = 0.1, 0.6


def _unit(i: int, j: int) -> Array:
    out = np.zeros((4, 4))
    out[i, j] = out[j, i] = 1.0
    return out


STANDARD = np.stack([standard_of(_unit(i, j)) for i, j in _PLACES], axis=1)
"""The ten standard parameters per entry of the pseudo-inertia, ``(10, 10)``."""
ENTRIES = np.linalg.inv(STANDARD)
"""Entries of the pseudo-inertia per standard parameter, ``(10, 10)``."""


class Cone(NamedTuple):
    """The cone of bodies that can exist.

    Attributes:
        start: Entries of the given bodies, ``(B, 10)``.
        reach: Rows that are not negative, ``(B, F, 10)``.
        places: Row and column of each entry, ``(10, 2)``.
    """

    start: Array
    reach: Array
    places: Array


def best_bodies(
    a: Float[Array, "10B 10B"], b: Float[Array, " 10B"], given: Float[Array, "B 10"], reach: Float[Array, "B F 10"]
) -> Float[Array, " 10B"]:
    """Changes of bodies at the minimum of ``x a x / 2 - b x`` among bodies that can exist.

    Args:
        a: Quadratic part, positive definite.
        b: Linear part.
        given: The bodies whose changes are sought, inside the cone.
        reach: Rows ``reach @ (given + x) >= 0``, all of them above zero for the given bodies.
    """
    count = len(given)
    standard = STANDARD if count == 1 else np.kron(np.eye(count), STANDARD)
    change, room, inverse = np.zeros(10 * count), np.zeros((10 * count + 2, 10 * count)), np.empty((count, 4, 4))
    cone = Cone(given @ ENTRIES.T, reach @ STANDARD, _PLACES)
    _follow_path(standard.T @ a @ standard, standard.T @ b, cone, change, room, inverse)
    # Given bodies on the edge of the cone stay as they are: no step from there is accepted.
    return standard @ change


@fused
def _follow_path(a: Array, b: Array, cone: Cone, x: Array, room: Array, inverse: Array) -> None:
    """Follow the central path to its end.

    Args:
        a: Quadratic part over the entries of all pseudo-inertias, ``(10 B, 10 B)``.
        b: Linear part.
        cone: The bodies.
        x: Changes of the entries: zero at first, then the minimum.
        room: Work array: rows for a matrix, one for a gradient, one for a step, which is zero at first.
        inverse: Work array for the inverse of each pseudo-inertia, ``(B, 4, 4)``.
    """
    n = len(x)
    hessian, gradient, step = room[:n], room[n], room[n + 1]
    numbers = float(len(cone.start) * (4 + cone.reach.shape[1]))
    # How much lower the loss could be than that of the given bodies without the cone: this gives the first weight.
    most = 0.0
    for i in range(n):
        gradient[i] = b[i]
        for j in range(n):
            hessian[i, j] = a[i, j]
    _factorise(hessian)
    _solve(hessian, gradient)
    for i in range(n):
        most += 0.5 * b[i] * gradient[i]
    weight = numbers / max(most, _GAP)
    length, least, decrement = 0.0, np.inf, 0.0
    # Slope and curvature of the loss along a step: in a difference of two losses the small change would be rounding.
    slope, bend = 0.0, 0.0
    for _ in range(_STEPS):
        barrier = _barrier(length, cone, x, step, inverse)
        change = weight * length * (slope + 0.5 * length * bend)
        if not change + barrier <= least - _DECREASE * length * decrement:
            length *= _SHORTER
            continue
        for i in range(n):
            x[i] += length * step[i]
        loss = _set_up(weight, a, b, cone, x, hessian, gradient, inverse)
        _factorise(hessian)
        for i in range(n):
            step[i] = -gradient[i]
        _solve(hessian, step)
        decrement, slope, bend = 0.0, 0.0, 0.0
        for i in range(n):
            decrement -= gradient[i] * step[i]
            along = pull = 0.0
            for j in range(n):
                along += a[i, j] * x[j]
                pull += a[i, j] * step[j]
            slope += (along - b[i]) * step[i]
            bend += pull * step[i]
        length, least = 1.0, barrier
        if decrement < _ON_PATH:
            if numbers <= weight * _GAP * max(loss + most, 1.0):
                return
            # The next point of the path is sought from here.
            weight *= _FASTER
            length, least = 0.0, np.inf


@inlined
def _barrier(length: float, cone: Cone, x: Array, step: Array, factors: Array) -> float:
    """Barrier at the end of a step, infinite outside of the cone; the Cholesky factors are kept."""
    start, reach, places = cone
    barrier, n = 0.0, len(places)
    for body in range(len(start)):
        factor = factors[body]
        for k in range(n):
            factor[places[k, 1], places[k, 0]] = start[body, k] + x[body * n + k] + length * step[body * n + k]
        for r in range(reach.shape[1]):
            slack = 0.0
            for k in range(n):
                slack += reach[body, r, k] * factor[places[k, 1], places[k, 0]]
            if not slack > 0.0:
                return np.inf
            barrier -= np.log(slack)
        for j in range(len(factor)):
            pivot = factor[j, j]
            for k in range(j):
                pivot -= factor[j, k] * factor[j, k]
            if not pivot > 0.0:
                return np.inf
            barrier -= np.log(pivot)
            factor[j, j] = np.sqrt(pivot)
            for i in range(j + 1, len(factor)):
                left = factor[i, j]
                for k in range(j):
                    left -= factor[i, k] * factor[j, k]
                factor[i, j] = left / factor[j, j]
    return barrier


@inlined
def _set_up(
    weight: float,
    a: Array,
    b: Array,
    cone: Cone,
    x: Array,
    hessian: Array,
    gradient: Array,
    inverses: Array,
) -> float:
    """Write Hessian and gradient of loss and barrier; Cholesky factors of the pseudo-inertias become their inverses.

    Returns:
        The loss.
    """
    loss = 0.0
    for i in range(len(x)):
        slope = -b[i]
        for j in range(len(x)):
            slope += a[i, j] * x[j]
            hessian[i, j] = weight * a[i, j]
        gradient[i] = weight * slope
        loss += 0.5 * x[i] * (slope - b[i])
    start, reach, places = cone
    n = len(places)
    for body in range(len(start)):
        inverse, first = inverses[body], body * n
        _invert(inverse)
        for k in range(n):
            i, j = places[k, 0], places[k, 1]
            gradient[first + k] -= inverse[i, j] if i == j else 2.0 * inverse[i, j]
            for c in range(k, n):
                p, q = places[c, 0], places[c, 1]
                pair = inverse[i, p] * inverse[j, q] + inverse[i, q] * inverse[j, p]
                hessian[first + k, first + c] += (1.0 if i == j else 2.0) * (0.5 if p == q else 1.0) * pair
        for r in range(reach.shape[1]):
            slack = 0.0
            for k in range(n):
                slack += reach[body, r, k] * (start[body, k] + x[first + k])
            for k in range(n):
                part = reach[body, r, k] / slack
                gradient[first + k] -= part
                for c in range(k, n):
                    hessian[first + k, first + c] += part * reach[body, r, c] / slack
    return loss


@inlined
def _invert(inverse: Array) -> None:
    """Overwrite the Cholesky factor of a matrix with its inverse."""
    m = len(inverse)
    for j in range(m):
        inverse[j, j] = 1.0 / inverse[j, j]
        for i in range(j + 1, m):
            left = 0.0
            for k in range(j, i):
                left -= inverse[i, k] * inverse[k, j]
            inverse[i, j] = left / inverse[i, i]
    # Row by row into the upper triangle: finished rows of the lower one are not needed any more.
    for i in range(m):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, m):
                total += inverse[k, i] * inverse[k, j]
            inverse[j, i] = total
    for i in range(m):
        for j in range(i):
            inverse[i, j] = inverse[j, i]


@inlined
def _factorise(a: Array) -> None:
    """Overwrite the upper triangle of a matrix with its Cholesky factor.

    Four rows of the factor are made at a time, and taken out of all rows below in one pass: the compiler then keeps a
    row in registers.
    """
    n = len(a)
    for first in range(0, n, 4):
        last = min(first + 4, n)
        for j in range(first, last):
            pivot = 1.0 / np.sqrt(max(a[j, j], 1e-300))
            for k in range(j, n):
                a[j, k] *= pivot
            for i in range(j + 1, last):
                part = a[j, i]
                for k in range(i, n):
                    a[i, k] -= part * a[j, k]
        for i in range(last, n):
            left, one, two = a[i, i:], a[first, i:], a[first + 1, i:]
            three, four = a[first + 2, i:], a[first + 3, i:]
            for k in range(len(left)):
                left[k] -= one[0] * one[k] + two[0] * two[k] + three[0] * three[k] + four[0] * four[k]


@inlined
def _solve(factor: Array, x: Array) -> None:
    """Overwrite the right side with the solution."""
    for i in range(len(x)):
        x[i] /= factor[i, i]
        for k in range(i + 1, len(x)):
            x[k] -= factor[i, k] * x[i]
    for back in range(len(x)):
        i = len(x) - 1 - back
        for k in range(i + 1, len(x)):
            x[i] -= factor[i, k] * x[k]
        x[i] /= factor[i, i]
