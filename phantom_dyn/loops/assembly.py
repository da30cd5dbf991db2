# pyright: reportAttributeAccessIssue=false
"""Finds positions that close the loops of a closed chain, and checks that the loops determine all passive joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import RobotError
from phantom_dyn.loops.chain import (
    ClosedChain,
    Constraints,
    constraints_of,
    error_and_jacobian,
    nearest,
    widest_open_anchor,
)
from phantom_dyn.loops.solver import CLOSED, SINGULAR

_HINT = "give start: {joint: position} near a position that closes the loop"


def assembled(model: pin.Model, chain: ClosedChain, config: Path) -> ClosedChain:
    """The chain with a start at which its loops are closed, near the given start.

    The active joints keep their positions if the passive joints alone can close the loops; otherwise the positions of
    all joints change.

    Args:
        model: The tree.
        chain: The chain, whose ``start`` need not close the loops.
        config: Path of the configuration for messages.

    Raises:
        RobotError: If no position near the start closes the loops.
    """
    at = constraints_of(model, chain.anchors)
    active, unknowns = chain.start[list(chain.active)], chain.start[list(chain.unknowns)]
    z, error, _ = nearest(chain, at, active, unknowns)
    y = np.concatenate([active, z])
    if not _closed(error):
        every = replace(chain, active=(), unknowns=(*chain.active, *chain.unknowns))
        y, error, _ = nearest(every, at, np.zeros(0), np.concatenate([active, unknowns]))
    if not _closed(error):
        label, apart = widest_open_anchor(chain, at, error)
        raise RobotError(f"{config}: {label} cannot be closed, its frames stay {apart} apart: {_HINT}.")
    return replace(chain, start=chain.linear_map @ y + chain.offset)


def _closed(error: Float[Array, " m"]) -> bool:
    """True if the frames of every anchor coincide."""
    return bool(np.abs(error).max() <= CLOSED)


def _rank(slope: Float[Array, "m n"]) -> int:
    """Number of singular values above the share `SINGULAR` of the largest one."""
    values = np.linalg.svd(slope, compute_uv=False)
    return int((values > SINGULAR * values[0]).sum()) if values[0] > 0 else 0


def require_determined(model: pin.Model, chain: ClosedChain, config: Path) -> None:
    """Refuse a chain whose number of passive joints is not the number that its loops determine.

    Args:
        model: The tree.
        chain: The chain, whose ``start`` closes its loops.
        config: Path of the configuration for messages.

    Raises:
        RobotError: If the numbers differ, or the start is singular.
    """
    at = constraints_of(model, chain.anchors)
    slope = error_and_jacobian(at, chain.start)[1] @ chain.linear_map
    nv, names = chain.nv, [model.names[1 + k] for k in chain.unknowns]
    labels = " and ".join(anchor.label for anchor in chain.anchors)
    passive, every = _rank(slope[:, nv:]) if names else 0, _rank(slope)
    if passive < len(names) and _rank(_elsewhere(chain, at)[:, nv:]) >= len(names):
        raise RobotError(f"{config}: {labels} is singular at its start, so the way of assembly is open: {_HINT}.")
    if passive < len(names):
        loose = _loose(slope[:, nv:], names)
        raise RobotError(
            f"{config}: {labels} determine {every} passive joints of {len(names)}, {loose} is not determined: "
            "make it active, lock it, or state the loop that is missing."
        )
    if every > len(names):
        raise RobotError(
            f"{config}: {labels} determine {every} joints and {', '.join(names) or 'none'} is passive: "
            f"make {every - len(names)} more passive (actuated: false), or list the others under active."
        )


def _elsewhere(chain: ClosedChain, at: Constraints) -> Float[Array, "m n"]:
    """Derivative of the loop constraints at a generic posture, away from the start."""
    turned = 0.3 * np.sin(1 + np.arange(chain.linear_map.shape[1]) ** 2)
    return error_and_jacobian(at, chain.start + chain.linear_map @ turned)[1] @ chain.linear_map


def _loose(slope: Float[Array, "m n"], names: list[str]) -> str:
    """The joint that can move most while the loops stay closed and the active joints do not move."""
    right = np.linalg.svd(slope)[2]
    return names[int(np.abs(right[-1]).argmax())]
