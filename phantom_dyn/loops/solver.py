# pyright: reportAttributeAccessIssue=false
"""Positions of the tree and their slope ``G`` along a trajectory of the active joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from jaxtyping import Float

from phantom_dyn.loops.chain import ClosedChain

Array = np.ndarray


def solve(
    model: pin.Model, chain: ClosedChain, q: Float[Array, "N nv"]
) -> tuple[Float[Array, "N nt"], Float[Array, "N nt nv"]]:
    """Positions of all joints of the tree [rad or m] and their slope in the active ones, for N samples.

    Args:
        model: The tree.
        chain: Its loops.
        q: Positions of the active joints.

    Raises:
        ChainError: If a loop cannot be closed or is singular at a sample.
    """
    nt = len(chain.offset)
    return q @ chain.linear_map.T + chain.offset, np.broadcast_to(chain.linear_map, (len(q), nt, chain.nv))


def tree_positions(model: pin.Model, chain: ClosedChain, q: Float[Array, "N nv"]) -> Float[Array, "N nt"]:
    """Positions of all joints of the tree [rad or m], see `solve`."""
    return solve(model, chain, q)[0]
