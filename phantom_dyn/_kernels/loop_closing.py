"""Compiled loops that close the loops of a chain along a trajectory, and find what they do to accelerations."""

from __future__ import annotations

import numpy as np

from phantom_dyn._kernels.anchors import Tree, anchor_acceleration, anchor_error
from phantom_dyn._kernels.jit import fused

Array = np.ndarray

Limits = tuple[float, float, float, float, float, float, float]
_SWEEPS = 40
_TURNED = 1e-15


@fused
def pseudo_inverse(slope: Array, singular: float, inverse: Array) -> bool:
    """Write the pseudo-inverse of a matrix with no more columns than rows, by one-sided Jacobi rotations.

    Args:
        slope: The matrix, ``(m, n)``.
        singular: Smallest over largest singular value below which there is none.
        inverse: Receives it, ``(n, m)``.

    Returns:
        False if there is none.
    """
    m, n = slope.shape
    if m < n:
        return False
    U, V, squares = slope.copy(), np.eye(n), np.empty(n)
    for _ in range(_SWEEPS):
        turned = False
        for i in range(n):
            for j in range(i + 1, n):
                a = b = both = 0.0
                for r in range(m):
                    a, b, both = a + U[r, i] * U[r, i], b + U[r, j] * U[r, j], both + U[r, i] * U[r, j]
                if not abs(both) > _TURNED * np.sqrt(a * b):
                    continue
                turned, zeta = True, (b - a) / (2 * both)
                t = (1.0 if zeta >= 0 else -1.0) / (abs(zeta) + np.sqrt(1 + zeta * zeta))
                c = 1 / np.sqrt(1 + t * t)
                s = c * t
                for r in range(m):
                    U[r, i], U[r, j] = c * U[r, i] - s * U[r, j], s * U[r, i] + c * U[r, j]
                for r in range(n):
                    V[r, i], V[r, j] = c * V[r, i] - s * V[r, j], s * V[r, i] + c * V[r, j]
        if not turned:
            break
    for i in range(n):
        squares[i] = 0.0
        for r in range(m):
            squares[i] += U[r, i] * U[r, i]
    # Not a number is singular too.
    if not np.sqrt(squares.min()) > singular * np.sqrt(squares.max()):
        return False
    for i in range(n):
        for r in range(m):
            inverse[i, r] = 0.0
            for k in range(n):
                inverse[i, r] += V[i, k] * U[r, k] / squares[k]
    return True


@fused
def newton(
    tree: Tree, S: Array, offset: Array, q: Array, z: Array, limits: Limits, slope: Array, inverse: Array
) -> bool:
    """The unknowns next to ``z`` that close the loops at active positions ``q``.

    Args:
        tree: Kinematics and anchors.
        S: ``S`` of `ClosedChain`, ``(nt, nv + nz)``.
        offset: Its ``o``, ``(nt,)``.
        q: Active positions, ``(nv,)``.
        z: Where to begin, ``(nz,)``; receives the solution.
        limits: As of `close_loops`.
        slope: Receives the slope of the unknowns in the active positions, ``(nz, nv)``.
        inverse: Receives the inverse of the constraint's slope in the unknowns, ``(nz, m)``.

    Returns:
        False where there is none or it is singular.
    """
    closed, singular, last, _, _, _, iterations = limits
    nt, nv, nz, m = len(offset), len(q), len(z), inverse.shape[1]
    x, error, on_tree, both = np.empty(nt), np.empty(m), np.empty((m, nt)), np.empty((m, nv + nz))
    for _ in range(int(iterations)):
        for i in range(nt):
            x[i] = offset[i]
            for j in range(nv):
                x[i] += S[i, j] * q[j]
            for j in range(nz):
                x[i] += S[i, nv + j] * z[j]
        anchor_error(tree, x, error, on_tree)
        for r in range(m):
            for j in range(nv + nz):
                both[r, j] = 0.0
                for i in range(nt):
                    both[r, j] += on_tree[r, i] * S[i, j]
        if not pseudo_inverse(both[:, nv:], singular, inverse):
            return False
        still, together = True, True
        for j in range(nz):
            step = 0.0
            for r in range(m):
                step -= inverse[j, r] * error[r]
                together = together and abs(error[r]) <= closed
            z[j] += step
            still = still and abs(step) <= last
        if still:
            for i in range(nz):
                for j in range(nv):
                    slope[i, j] = 0.0
                    for r in range(m):
                        slope[i, j] -= inverse[i, r] * both[r, j]
            return together
    return False


@fused
def close_loops(
    tree: Tree, S: Array, offset: Array, limits: Limits, q: Array, begin: Array, z: Array, slopes: Array,
    inverses: Array, first: int,
) -> int:  # fmt: skip
    """Unknowns of samples ``first`` to N, each reached along the straight line from the one before.

    Args:
        tree: Kinematics and anchors.
        S: ``S`` of `ClosedChain`, ``(nt, nv + nz)``.
        offset: Its ``o``, ``(nt,)``.
        limits: Largest distance that counts as closed, smallest share of singular values, Newton's last step, longest
            step of a joint, largest correction of a step over its length, smallest part of the way, iterations.
        q: Active positions, ``(N, nv)``.
        begin: Active positions of the solution in the last rows of the next three, ``(nv,)``.
        z: Receives the unknowns, ``(N + 1, nz)``; row ``first - 1`` holds where to begin (the last one for 0).
        slopes: Receives their slopes in the active positions, the same, ``(N + 1, nz, nv)``.
        inverses: Receives the inverses of the constraint's slope, ``(N + 1, nz, m)``.
        first: Where to begin.

    Returns:
        The first sample at which the loops were not closed, N if there is none.
    """
    _, _, last, reach, foreseen, shortest, _ = limits
    N, nv, nz = len(q), q.shape[1], z.shape[1]
    at, way, target, unknown, trial = begin.copy(), np.empty(nv), np.empty(nv), z[first - 1].copy(), np.empty(nz)
    slope, inverse = slopes[first - 1].copy(), inverses[first - 1].copy()
    next_slope, next_inverse = slope.copy(), inverse.copy()
    for k in range(first, N):
        done, part = 0.0, 1.0
        for j in range(nv):
            way[j] = q[k, j] - at[j]
        while done < 1.0:
            part = min(part, 1.0 - done)
            longest = 0.0
            for j in range(nv):
                longest = max(longest, abs(part * way[j]))
                target[j] = q[k, j] if done + part >= 1.0 else at[j] + (done + part) * way[j]
            for i in range(nz):
                trial[i] = unknown[i]
                for j in range(nv):
                    trial[i] += slope[i, j] * (part * way[j])
                longest = max(longest, abs(trial[i] - unknown[i]))
            found = False
            if longest <= reach:
                ahead = trial.copy()
                found = newton(tree, S, offset, target, trial, limits, next_slope, next_inverse)
                for i in range(nz):
                    found = found and abs(trial[i] - ahead[i]) <= foreseen * longest + last
            if found:
                unknown[:], slope[:], inverse[:] = trial, next_slope, next_inverse
                done, part = done + part, 2 * part
                continue
            part /= 2
            if part < shortest and not longest >= reach:
                return k
        at[:] = q[k]
        z[k], slopes[k], inverses[k] = unknown, slope, inverse
    return N


@fused
def drift_loop(tree: Tree, S: Array, x: Array, v: Array, inverses: Array, out: Array) -> None:
    """Accelerations of the tree while no active joint accelerates.

    Args:
        tree: Kinematics and anchors.
        S: Columns of ``S`` of `ClosedChain` for the unknowns, ``(nt, nz)``.
        x: Positions of the tree, ``(N, nt)``.
        v: Its velocities, ``(N, nt)``.
        inverses: Unknown accelerations per acceleration of the constraint, ``(N, nz, m)``.
        out: Receives the accelerations, ``(N, nt)``.
    """
    m, nz = inverses.shape[2], inverses.shape[1]
    apart, still = np.empty(m), np.zeros((1, v.shape[1]))
    for k in range(len(x)):
        anchor_acceleration(tree, x[k], v[k : k + 1], still, apart)
        for i in range(len(S)):
            out[k, i] = 0.0
        for j in range(nz):
            pulled = 0.0
            for r in range(m):
                pulled -= inverses[k, j, r] * apart[r]
            for i in range(len(S)):
                out[k, i] += S[i, j] * pulled
