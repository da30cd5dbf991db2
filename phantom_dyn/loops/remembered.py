# pyright: reportAttributeAccessIssue=false
"""Solutions of a closed chain that are asked for again: many questions are about the same positions."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from phantom_dyn.kernels.tree_arrays import TreeArrays
from phantom_dyn.loops.chain import ClosedChain
from phantom_dyn.loops.solver import REACH, Solution, solve

Array = np.ndarray

_REMEMBERED = 4
"""Trajectories whose solution is kept: a motion, its two neighbours in a central difference, and one to spare."""


def solved(
    model: pin.Model, chain: ClosedChain, q: Float[Array, "N nv"], *, arrays: TreeArrays | None = None
) -> Solution:
    """As `phantom_dyn.loops.solver.solve`, from memory where the same chain was solved at the same positions lately.

    Nothing can go out of date, as chains and solutions do not change. A single sample begins at the nearest solution
    that is kept, because a simulation asks sample by sample; whole trajectories always begin where the chain starts,
    so that they do not depend on what was asked before.

    Args:
        model: The tree.
        chain: Its loops.
        q: Positions of the active joints [rad or m].
        arrays: The tree as compiled loops take it; None for steps in Python.

    Raises:
        ChainError: If a loop cannot be closed or is singular at a sample.
    """
    if not chain.anchors:
        return solve(model, chain, q)
    kept = [entry for entry in chain.recent if entry[0] is model]
    for _, positions, solution in kept:
        if positions is q or np.array_equal(positions, q):
            return solution
    near = _nearest(chain, [solution for _, _, solution in kept], q) if len(q) == 1 else None
    found = solve(model, chain, q, near, arrays=arrays)
    chain.recent[:] = [*kept[1 - _REMEMBERED :], (model, np.array(q), found)]
    return found


def _nearest(chain: ClosedChain, kept: list[Solution], q: Float[Array, "1 nv"]) -> Float[Array, " nt"] | None:
    """Positions of the tree among those last solved that one step of the solver takes to ``q``."""
    ends = [solution.x[-1] for solution in kept if len(solution.x)]
    apart = [float(np.abs(x[list(chain.active)] - q[0]).max()) for x in ends]
    return ends[int(np.argmin(apart))] if apart and min(apart) <= REACH else None
