"""Minimum of a quadratic loss over inertial parameters of possible bodies, by a compiled interior-point method.

A body is possible if its pseudo-inertia ``S``, a symmetric 4 x 4 matrix, is positive semidefinite. The unknowns are the
ten entries of each ``S`` and a matrix of multipliers ``Z`` for each. At the minimum ``S Z`` is zero. Each step solves
for ``S`` and ``Z`` at once, such that ``S Z`` is a multiple of the identity, which becomes smaller from step to step.
The direction of a step is that of [Helmberg]_, with the Hessian ``tr(S^-1 B_k Z B_l)`` for the symmetric unit matrices
``B_k``. A step is first predicted, then computed again with corrections for its second-order terms [Mehrotra]_.

A general cone solver takes five times as long for one body (benchmarks/test_cone_minimum_benchmark.py), and a diagnosis
needs many minima.

References:
    .. [Helmberg] C. Helmberg, F. Rendl, R. J. Vanderbei, H. Wolkowicz, An interior-point method for semidefinite
       programming, SIAM Journal on Optimization 6(2), 1996.
    .. [Mehrotra] S. Mehrotra, On the implementation of a primal-dual interior point method, SIAM Journal on
       Optimization 2(4), 1992. Minima are checked against Clarabel in
       tests/identification/diagnosis/fit/test_possible_bodies.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identification.engine.numerics.elimination import eliminate, solve_eliminated
from identification.estimators.consistent.consistent_bodies import standard_of
from phantom_dyn._kernels.jit import fused, inlined
from phantom_dyn.array_types import Array, Float

# Rows and columns of the entries of a pseudo-inertia: its upper triangle.
_ENTRY_POSITIONS = np.array([(i, j) for i in range(4) for j in range(i, 4)])
# The iteration ends if the loss exceeds its lower bound by less than this share of its increase due to the cone, or by
# less than this many squared standard deviations.
_CONVERGED_GAP = 1e-6
# Largest number of steps; twenty are usual.
_STEPS = 60
# Smallest product ``S Z`` at which a step aims, as a share of the present one.
_LEAST_AIM = 0.01
# Length of a step as a share of the distance to the edge of the cone.
_STEP_SHARE = 0.95
# Factor by which a step is shortened until it stays inside the cone, and the largest number of times.
_SHORTENING, _MOST_SHORTENINGS = 0.8, 60


def _unit(i: int, j: int) -> Array:
    """Symmetric 4 x 4 matrix with ones in entries ``ij`` and ``ji``, else zeros."""
    out = np.zeros((4, 4))
    out[i, j] = out[j, i] = 1.0
    return out


STANDARD = np.stack([standard_of(_unit(i, j)) for i, j in _ENTRY_POSITIONS], axis=1)
"""Derivative of the ten standard parameters with respect to the entries of the pseudo-inertia, ``(10, 10)``."""
ENTRIES = np.linalg.inv(STANDARD)
"""Derivative of the entries of the pseudo-inertia with respect to the standard parameters, ``(10, 10)``."""


class Cone(NamedTuple):
    """The cone of possible bodies.

    Attributes:
        start: Entries of the pseudo-inertias of the given bodies, ``(B, 10)``.
        reach: Rows whose products with the entries are not negative if the centre of mass is within reach,
            ``(B, F, 10)``.
        places: Row and column of each entry in the pseudo-inertia, ``(10, 2)``.
    """

    start: Array
    reach: Array
    places: Array


class Path(NamedTuple):
    """State of the iteration: bodies, slacks of the constraints on their reach, multipliers of both, and next steps.

    Attributes:
        inertias, inverses: Pseudo-inertias and their inverses, ``(B, 4, 4)``.
        multipliers: Multipliers of the pseudo-inertias, ``(B, 4, 4)``.
        inertia_steps, multiplier_steps: Next steps of pseudo-inertias and multipliers, ``(B, 4, 4)``.
        corrections: Second-order terms of the predicted step, ``(B, 4, 4)``.
        slacks, slack_multipliers: Products of `Cone.reach` with the entries, and their multipliers, ``(B, F)``.
        slack_steps, slack_multiplier_steps: Next steps of slacks and their multipliers, ``(B, F)``.
        slack_corrections: Second-order terms of the predicted step of the slacks, ``(B, F)``.
        work: Work array, ``(4, 4)``.
    """

    inertias: Array
    inverses: Array
    multipliers: Array
    inertia_steps: Array
    multiplier_steps: Array
    corrections: Array
    slacks: Array
    slack_multipliers: Array
    slack_steps: Array
    slack_multiplier_steps: Array
    slack_corrections: Array
    work: Array


def best_bodies(
    a: Float[Array, "10B 10B"], b: Float[Array, " 10B"], given: Float[Array, "B 10"], reach: Float[Array, "B F 10"]
) -> Float[Array, " 10B"]:
    """Changes ``x`` of bodies at the minimum of ``x a x / 2 - b x`` among possible bodies, ``(10 B,)``.

    Args:
        a: Quadratic part, positive definite.
        b: Linear part.
        given: Ten standard parameters of each unchanged body, inside the cone.
        reach: Constraints ``reach @ (given + x) >= 0`` of each body, positive for the given bodies.
    """
    count = len(given)
    standard = STANDARD if count == 1 else np.kron(np.eye(count), STANDARD)
    change, work = np.zeros(10 * count), np.zeros((10 * count + 2, 10 * count))
    cone = Cone(given @ ENTRIES.T, reach @ STANDARD, _ENTRY_POSITIONS)
    path = Path._make([*np.zeros((6, count, 4, 4)), *np.zeros((5, *reach.shape[:2])), np.zeros((4, 4))])
    _minimise(standard.T @ a @ standard, standard.T @ b, cone, path, change, work)
    # Given bodies on the edge of the cone are not changed, because no step from there stays inside.
    return standard @ change


@fused
def _minimise(a: Array, b: Array, cone: Cone, path: Path, x: Array, work: Array) -> None:
    """Write the changes of the entries at the minimum, by steps of bodies and multipliers.

    Args:
        a: Quadratic part over the entries of all pseudo-inertias, ``(10 B, 10 B)``.
        b: Linear part.
        cone: The given bodies and their constraints.
        path: State of the iteration; zeros at first.
        x: Changes of the entries: zero at first, then the minimum.
        work: Work array: rows for a matrix, one for a slope and one for a step.
    """
    n = len(x)
    hessian, slope, step = work[:n], work[n], work[n + 1]
    pairs = float(len(cone.start) * (4 + cone.reach.shape[1]))
    # Decrease of the loss from the given bodies to the minimum without the cone. The first multipliers depend on it.
    decrease = 0.0
    _set_up(a, b, x, hessian, slope)
    eliminate(hessian, n)
    for i in range(n):
        step[i] = b[i]
    solve_eliminated(hessian, step, n)
    for i in range(n):
        decrease += 0.5 * b[i] * step[i]
    if not _set_inertias(cone, path, x):
        return
    _set_first_multipliers(max(decrease, _CONVERGED_GAP) / pairs, path)
    # Slope of the Lagrangian as a share of the first one: a step of length one makes it zero.
    unsolved = 1.0
    for _ in range(_STEPS):
        loss, gap = _set_up(a, b, x, hessian, slope), _gap(0.0, path)
        if max(gap, unsolved * decrease) <= _CONVERGED_GAP * max(loss + decrease, 1.0):
            return
        _add_curvature(cone, path, hessian)
        eliminate(hessian, n)
        # Predict a step that aims at a product of zero. The better it would succeed, the smaller the product at which
        # the real step aims. Second-order terms of the prediction correct the real step.
        length = _step(0.0, cone, path, hessian, slope, step)
        aim = gap / pairs * max(_LEAST_AIM, (_gap(length, path) / gap) ** 2)
        _set_corrections(path)
        length = _STEP_SHARE * _step(aim, cone, path, hessian, slope, step)
        unsolved *= 1.0 - length
        _advance(length, path, x, step)
        if length <= 0.0 or not _set_inertias(cone, path, x):
            return


@inlined
def _set_up(a: Array, b: Array, x: Array, hessian: Array, slope: Array) -> float:
    """Write the slope of the loss and its Hessian, and return the loss."""
    n = len(x)
    for i in range(n):
        slope[i] = -b[i]
    for i in range(n):
        for j in range(n):
            slope[j] += a[i, j] * x[i]
            hessian[i, j] = a[i, j]
    loss = 0.0
    for i in range(n):
        loss += 0.5 * x[i] * (slope[i] - b[i])
    return loss


@inlined
def _set_first_multipliers(mean: float, path: Path) -> None:
    """Write the first multipliers: a multiple of the inverses."""
    for body in range(len(path.inertias)):
        for i in range(4):
            for j in range(4):
                path.multipliers[body, i, j] = mean * path.inverses[body, i, j]
        for r in range(path.slacks.shape[1]):
            path.slack_multipliers[body, r] = mean / path.slacks[body, r]


@inlined
def _advance(length: float, path: Path, x: Array, step: Array) -> None:
    """Take a part of the step, and clear the corrections."""
    for i in range(len(x)):
        x[i] += length * step[i]
    for body in range(len(path.inertias)):
        for i in range(4):
            for j in range(4):
                path.multipliers[body, i, j] += length * path.multiplier_steps[body, i, j]
                path.corrections[body, i, j] = 0.0
        for r in range(path.slacks.shape[1]):
            path.slack_multipliers[body, r] += length * path.slack_multiplier_steps[body, r]
            path.slack_corrections[body, r] = 0.0


@inlined
def _set_inertias(cone: Cone, path: Path, x: Array) -> bool:
    """Write pseudo-inertias, their inverses and the slacks; False if a body is outside the cone."""
    start, reach, places = cone
    n = len(places)
    for body in range(len(start)):
        inertia = path.inertias[body]
        for k in range(n):
            entry = start[body, k] + x[body * n + k]
            inertia[places[k, 0], places[k, 1]] = inertia[places[k, 1], places[k, 0]] = entry
        for r in range(reach.shape[1]):
            slack = 0.0
            for k in range(n):
                slack += reach[body, r, k] * inertia[places[k, 0], places[k, 1]]
            path.slacks[body, r] = slack
            if not slack > 0.0:
                return False
        if not _invert(inertia, path.inverses[body]):
            return False
    return True


@inlined
def _gap(length: float, path: Path) -> float:
    """Loss minus its lower bound after a part of a step: products of bodies and slacks with their multipliers."""
    gap = 0.0
    for body in range(len(path.inertias)):
        for i in range(4):
            for j in range(4):
                inertia = path.inertias[body, i, j] + length * path.inertia_steps[body, i, j]
                gap += inertia * (path.multipliers[body, i, j] + length * path.multiplier_steps[body, i, j])
        for r in range(path.slacks.shape[1]):
            slack = path.slacks[body, r] + length * path.slack_steps[body, r]
            gap += slack * (path.slack_multipliers[body, r] + length * path.slack_multiplier_steps[body, r])
    return gap


@inlined
def _add_curvature(cone: Cone, path: Path, hessian: Array) -> None:
    """Add the curvature of all bodies to the upper triangle of the Hessian."""
    reach, places = cone.reach, cone.places
    n = len(places)
    for body in range(len(cone.start)):
        inverse, multiplier, first = path.inverses[body], path.multipliers[body], body * n
        for k in range(n):
            i, j = places[k, 0], places[k, 1]
            for c in range(k, n):
                p, q = places[c, 0], places[c, 1]
                pair = inverse[q, i] * multiplier[j, p] + inverse[q, j] * multiplier[i, p]
                pair += inverse[p, i] * multiplier[j, q] + inverse[p, j] * multiplier[i, q]
                hessian[first + k, first + c] += (0.5 if i == j else 1.0) * (0.5 if p == q else 1.0) * pair
        for r in range(reach.shape[1]):
            stiffness = path.slack_multipliers[body, r] / path.slacks[body, r]
            for k in range(n):
                for c in range(k, n):
                    hessian[first + k, first + c] += stiffness * reach[body, r, k] * reach[body, r, c]


@fused
def _step(aim: float, cone: Cone, path: Path, factor: Array, slope: Array, step: Array) -> float:
    """Write the step after which the product of bodies and multipliers is ``aim`` times the identity.

    Returns:
        Largest part of the step that stays inside the cone, at most one.
    """
    reach, places = cone.reach, cone.places
    n = len(places)
    for body in range(len(cone.start)):
        for k in range(n):
            i, j = places[k, 0], places[k, 1]
            pull = (1.0 if i == j else 2.0) * (aim * path.inverses[body, i, j] - path.corrections[body, i, j])
            for r in range(reach.shape[1]):
                pull += reach[body, r, k] * (aim - path.slack_corrections[body, r]) / path.slacks[body, r]
            step[body * n + k] = pull - slope[body * n + k]
    solve_eliminated(factor, step, len(step))
    length = 1.0
    for body in range(len(cone.start)):
        inertia_step, multiplier_step = path.inertia_steps[body], path.multiplier_steps[body]
        for k in range(n):
            inertia_step[places[k, 0], places[k, 1]] = inertia_step[places[k, 1], places[k, 0]] = step[body * n + k]
        for r in range(reach.shape[1]):
            slack_change = 0.0
            for k in range(n):
                slack_change += reach[body, r, k] * step[body * n + k]
            slack, multiplier = path.slacks[body, r], path.slack_multipliers[body, r]
            multiplier_change = (aim - path.slack_corrections[body, r] - multiplier * slack_change) / slack - multiplier
            path.slack_steps[body, r], path.slack_multiplier_steps[body, r] = slack_change, multiplier_change
            if slack_change < 0.0:
                length = min(length, -slack / slack_change)
            if multiplier_change < 0.0:
                length = min(length, -multiplier / multiplier_change)
        _symmetric_product(path.inverses[body], inertia_step, path.multipliers[body], path.work, multiplier_step)
        for i in range(4):
            for j in range(4):
                kept = aim * path.inverses[body, i, j] - path.multipliers[body, i, j] - path.corrections[body, i, j]
                multiplier_step[i, j] = kept - multiplier_step[i, j]
        length = _inside(length, path.inertias[body], inertia_step, path.work)
        length = _inside(length, path.multipliers[body], multiplier_step, path.work)
    return length


@inlined
def _set_corrections(path: Path) -> None:
    """Write the second-order terms of the predicted step: products of the steps of bodies and multipliers."""
    for body in range(len(path.inertias)):
        _symmetric_product(
            path.inverses[body],
            path.inertia_steps[body],
            path.multiplier_steps[body],
            path.work,
            path.corrections[body],
        )
        for r in range(path.slacks.shape[1]):
            path.slack_corrections[body, r] = path.slack_steps[body, r] * path.slack_multiplier_steps[body, r]


@inlined
def _symmetric_product(left: Array, middle: Array, right: Array, work: Array, out: Array) -> None:
    """Write the symmetric part of the product of three matrices."""
    for i in range(4):
        for j in range(4):
            work[i, j] = 0.0
            for k in range(4):
                work[i, j] += left[i, k] * middle[k, j]
    for i in range(4):
        for j in range(i + 1):
            both = 0.0
            for k in range(4):
                both += work[i, k] * right[k, j] + work[j, k] * right[k, i]
            out[i, j] = out[j, i] = 0.5 * both


@inlined
def _inside(length: float, matrix: Array, change: Array, factor: Array) -> float:
    """The length of a step, shortened until ``matrix + length * change`` is positive definite; zero if it never is."""
    for _ in range(_MOST_SHORTENINGS):
        for i in range(4):
            for j in range(i + 1):
                factor[i, j] = matrix[i, j] + length * change[i, j]
        if _has_factor(factor):
            return length
        length *= _SHORTENING
    return 0.0


@inlined
def _has_factor(factor: Array) -> bool:
    """Overwrite the lower triangle of a matrix with its Cholesky factor; False if it is not positive definite."""
    for j in range(4):
        pivot = factor[j, j]
        for k in range(j):
            pivot -= factor[j, k] * factor[j, k]
        if not pivot > 0.0:
            return False
        factor[j, j] = np.sqrt(pivot)
        for i in range(j + 1, 4):
            entry = factor[i, j]
            for k in range(j):
                entry -= factor[i, k] * factor[j, k]
            factor[i, j] = entry / factor[j, j]
    return True


@inlined
def _invert(matrix: Array, inverse: Array) -> bool:
    """Write the inverse of a positive definite matrix; False if the matrix is not positive definite."""
    for i in range(4):
        for j in range(i + 1):
            inverse[i, j] = matrix[i, j]
    if not _has_factor(inverse):
        return False
    for j in range(4):
        inverse[j, j] = 1.0 / inverse[j, j]
        for i in range(j + 1, 4):
            entry = 0.0
            for k in range(j, i):
                entry -= inverse[i, k] * inverse[k, j]
            inverse[i, j] = entry / inverse[i, i]
    # The lower triangle has the inverse of the Cholesky factor. The result is written row by row into the upper one.
    for i in range(4):
        for j in range(i + 1):
            total = 0.0
            for k in range(i, 4):
                total += inverse[k, i] * inverse[k, j]
            inverse[j, i] = total
    for i in range(4):
        for j in range(i):
            inverse[i, j] = inverse[j, i]
    return True
