"""Motion of all joints of a closed chain from its active joints, for compiled simulations.

A state stores the latest solution of the loops, from which the next search starts. Each joint of the tree has one
degree of freedom.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from phantom_dyn._kernels.jit import jit
from phantom_dyn._kernels.loop_closing import AnchoredTree, Closed, Limits, close_loops, drift_loop
from phantom_dyn.array_types import Array


class LoopClosureState(NamedTuple):
    """Loops that are closed numerically, with the solution at the start and the latest solution.

    Attributes:
        tree: Joints and anchors.
        linear_map: ``S`` of `ClosedChain`, ``(nt, nv + nz)``.
        to_tree: Columns of ``S`` for the unknowns, ``(nt, nz)``.
        limits: When Newton's method stops.
        start: Active positions at the start, ``(nv,)``.
        started: Solution at the start, arrays of one row.
        q: Active positions of the latest solution, ``(nv,)``.
        wanted: Work array for the active positions of the next solution, ``(1, nv)``. If the loops cannot be closed, it
            shows the positions at which they fail.
        last: Work arrays of two rows: the next solution and the latest one.
        speed: Work array for the velocities of the tree, ``(1, nt)``.
        away: Work array for the accelerations of the tree while no active joint accelerates, ``(1, nt)``.
    """

    tree: AnchoredTree
    linear_map: Array
    to_tree: Array
    limits: Limits
    start: Array
    started: Closed
    q: Array
    wanted: Array
    last: Closed
    speed: Array
    away: Array


def initial_loop_closure(
    tree: AnchoredTree, linear_map: Array, limits: Limits, q: Array, started: Closed
) -> LoopClosureState:
    """Loops at the start of their chain, with work arrays for later states.

    Args:
        tree: Joints and anchors.
        linear_map: ``S`` of `ClosedChain`, ``(nt, nv + nz)``.
        limits: When Newton's method stops.
        q: Active positions at the start, ``(nv,)``.
        started: Solution at the start, arrays of one row.
    """
    last = Closed(*(np.repeat(np.array(part, dtype=float), 2, axis=0) for part in started))
    at, S, work = np.array(q, dtype=float), np.array(linear_map, dtype=float), np.zeros((2, 1, len(linear_map)))
    to_tree = np.ascontiguousarray(S[:, len(at) :])
    return LoopClosureState(tree, S, to_tree, limits, at, started, at.copy(), at[None].copy(), last, work[0], work[1])


@jit
def rewind(loops: LoopClosureState | None) -> None:
    """Set the loops back to the start, so that the next simulation does not depend on the one before."""
    if loops is None:
        return
    loops.q[:] = loops.start
    loops.last.z[1], loops.last.slopes[1], loops.last.inverses[1] = (
        loops.started.z[0],
        loops.started.slopes[0],
        loops.started.inverses[0],
    )


@jit
def write_tree_state(
    loops: LoopClosureState | None, slope: Array, offset: Array, q: Array, v: Array, x: Array, u: Array, away: Array
) -> bool:
    """Write positions, velocities and drift of the tree at one state of the active joints.

    Args:
        loops: Loops that are closed numerically, or None.
        slope: ``G`` of `ClosedChain`, ``(nt, nv)``; overwritten if loops are closed numerically.
        offset: Positions of the tree where active joints and unknowns are at zero, ``(nt,)``.
        q: Positions, of which the first ``nv`` are those of the active joints.
        v: Velocities, in the same order.
        x: Output: the positions of the tree, ``(nt,)``.
        u: Output: the velocities of the tree, ``(nt,)``.
        away: Output: the accelerations of the tree while no active joint accelerates, ``(nt,)``.

    Returns:
        False if the loops cannot be closed, or are singular.
    """
    nt, nv = slope.shape
    if loops is None:
        for i in range(nt):
            x[i], u[i] = offset[i], 0.0
            for j in range(nv):
                x[i] += slope[i, j] * q[j]
                u[i] += slope[i, j] * v[j]
        return True
    S, z, slopes, inverses = loops.linear_map, loops.last.z, loops.last.slopes, loops.last.inverses
    for j in range(nv):
        loops.wanted[0, j] = q[j]
    # For a position that is NaN or infinite, `close_loops` would halve its steps without an end.
    if not np.isfinite(loops.wanted).all():
        return False
    if close_loops(loops.tree, S, offset, loops.limits, loops.wanted, loops.q, loops.last) == 0:
        return False
    loops.q[:] = loops.wanted[0]
    z[1], slopes[1], inverses[1] = z[0], slopes[0], inverses[0]
    for i in range(nt):
        x[i], u[i] = offset[i], 0.0
        for j in range(nv):
            x[i] += S[i, j] * q[j]
            slope[i, j] = S[i, j]
            for k in range(z.shape[1]):
                slope[i, j] += S[i, nv + k] * slopes[0, k, j]
            u[i] += slope[i, j] * v[j]
        for k in range(z.shape[1]):
            x[i] += S[i, nv + k] * z[0, k]
        loops.speed[0, i] = u[i]
    drift_loop(loops.tree, loops.to_tree, x.reshape((1, nt)), loops.speed, inverses[:1], loops.away)
    for i in range(nt):
        away[i] = loops.away[0, i]
    return True
