# pyright: reportAttributeAccessIssue=false
"""Joint positions of a closed chain at measured poses, and their change by a wrong zero or place of a joint.

Active joints have encoders. Passive ones keep the loops closed: an error that moves the two frames of a loop apart by
:math:`dc` moves the passive joints by :math:`dz = -(J_z)^+ dc`. The pseudo-inverse is needed for planar loops, whose
joints cannot move the frames along one direction: an error along it stays open, and bearings take it up.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from identification.geometry.pins import Loops
from phantom_dyn.array_types import Array, Float
from phantom_dyn.loops.chain import Constraints, constraints_of, error_and_slope
from phantom_dyn.loops.solver import SINGULAR
from phantom_dyn.motion import configurations

_STEPS = 20
_LAST_STEP = 1e-11
"""Step [rad or m] at which a loop is closed, as of `phantom_dyn.loops.solver`."""
_NOTHING = 1e-10
"""Motion of a frame per unit of a place below which it is rounding: a joint compensates a turn about its own axis."""


@dataclass(frozen=True)
class Followed:
    """Changes of all joint positions of the tree by errors, at ``n`` poses.

    Attributes:
        by_active: Per position of the active joints, ``(n, nt, nv)``.
        by_place: Per twist of the places of all joints, in their own axes, ``(n, nt, 6 (njoints - 1))``.
        by_pin: For each frame of a loop, per twist of its place in its own axes, each ``(n, nt, 6)``.
    """

    by_active: Float[Array, "n nt nv"]
    by_place: Float[Array, "n nt p"]
    by_pin: dict[int, Float[Array, "n nt 6"]]


def closed_positions(loops: Loops, q: Float[Array, "n nv"], near: Float[Array, "n nt"]) -> Float[Array, "n nt"]:
    """Positions of the tree at which frames of loops come nearest to each other, whether or not they meet [rad or m].

    Args:
        loops: Tree and loops of the current model.
        q: Positions of the active joints.
        near: Positions of the tree near those wanted.
    """
    chain = loops.chain
    S, nv = chain.linear_map, chain.nv
    z = near[:, list(chain.unknowns)].copy()
    fixed = q @ S[:, :nv].T + chain.offset
    if chain.anchors:
        at = constraints_of(loops.model, chain.anchors)
        for k in range(len(q)):
            for _ in range(_STEPS):
                error, slope = error_and_slope(at, fixed[k] + S[:, nv:] @ z[k])
                step = -np.linalg.pinv(slope @ S[:, nv:], rcond=SINGULAR) @ error
                z[k] += step
                if np.abs(step).max() <= _LAST_STEP:
                    break
    return fixed + z @ S[:, nv:].T


def followed(loops: Loops, x: Float[Array, "n nt"]) -> Followed:
    """Changes of the joint positions by errors, at positions that close the loops.

    Args:
        loops: Tree and loops.
        x: Positions of the tree.
    """
    model, chain = loops.model, loops.chain
    S, nv, n = chain.linear_map, chain.nv, len(x)
    by_active = np.broadcast_to(S[:, :nv], (n, len(S), nv)).copy()
    by_place = np.zeros((n, len(S), 6 * (model.njoints - 1)))
    by_pin = {frame: np.zeros((n, len(S), 6)) for frame in loops.pins}
    if not chain.anchors:
        return Followed(by_active, by_place, by_pin)
    at, configuration, data = constraints_of(model, chain.anchors), configurations(model, x), model.createData()
    for k in range(n):
        slope = error_and_slope(at, x[k])[1] @ S
        back = -S[:, nv:] @ np.linalg.pinv(slope[:, nv:], rcond=SINGULAR)
        by_active[k] += back @ slope[:, :nv]
        pin.framesForwardKinematics(model, data, configuration[k])
        places, pins = _moved_frames(at, data)
        by_place[k] = back @ places
        for frame, moves in pins.items():
            by_pin[frame][k] = back @ moves
    return Followed(by_active, by_place, by_pin)


def _moved_frames(at: Constraints, data: pin.Data) -> tuple[Float[Array, "m p"], dict[int, Float[Array, "m 6"]]]:
    """Distance of the frames of all anchors per twist of the places of joints, and per twist of each frame's own."""
    model, count = at.model, sum(rows.stop - rows.start for rows in at.slices)
    places, pins = np.zeros((count, 6 * (model.njoints - 1))), {}
    for anchor, rows in zip(at.anchors, at.slices, strict=True):
        kept = rows.stop - rows.start
        apart = data.oMf[anchor.frame_a].actInv(data.oMf[anchor.frame_b])
        # Of the second frame against the first, in the axes and, for shifts, at the place of the first.
        second = apart.toActionMatrix()
        to_point = np.eye(6)
        to_point[:3, 3:] = -pin.skew(apart.translation)
        places[rows] = (to_point @ (second @ _regressor(model, data, anchor.frame_b)))[:kept]
        places[rows] -= (to_point @ _regressor(model, data, anchor.frame_a))[:kept]
        for frame, moves in ((anchor.frame_a, -to_point), (anchor.frame_b, to_point @ second)):
            # One body may carry several loops at one frame.
            pins.setdefault(frame, np.zeros((count, 6)))[rows] += moves[:kept]
    return places, pins


def _regressor(model: pin.Model, data: pin.Data, frame: int) -> Float[Array, "6 p"]:
    """Pinocchio's kinematic regressor of a frame in its own axes; nothing moves what is fixed to the root."""
    if model.frames[frame].parentJoint == 0:
        return np.zeros((6, 6 * (model.njoints - 1)))
    return pin.computeFrameKinematicRegressor(model, data, frame, pin.LOCAL)


def rounded(columns: Array) -> Array:
    """Columns without motions that are rounding."""
    return np.where(np.abs(columns) < _NOTHING, 0.0, columns)
