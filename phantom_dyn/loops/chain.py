# pyright: reportAttributeAccessIssue=false
"""Description of a closed chain: a tree, its active and passive joints, and the anchors that close its loops.

An anchor keeps two frames together. Its error is the displacement between the two frames and, if the anchor fixes
orientations, also the rotation. This module computes, with Pinocchio, the error of the anchors, the Jacobian of the
error, and the passive positions at which the norm of the error is smallest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.motion import configurations

_MODELS = {"point": pin.PointAnchorConstraintModel, "frame": pin.FrameAnchorConstraintModel}
# Step [rad or m] at which the search for the smallest distance ends; smaller steps are rounding errors.
_LAST_STEP = 1e-11
# Largest number of steps of the search; from a start near the solution it needs about ten.
_MOST_STEPS = 100
# First and smallest damping of the Levenberg-Marquardt steps, relative to the trace of the normal matrix.
_DAMPING, _LEAST_DAMPING = 1e-3, 1e-12


@dataclass(frozen=True)
class Anchor:
    """Two frames of the tree that a loop keeps together.

    Attributes:
        label: Name of the loop for messages, such as ``loops[1] (a_pin to c_pin)``.
        kind: ``point`` keeps the origins together, ``frame`` origins and axes.
        frame_a, frame_b: Indices of the frames in the model.
    """

    label: str
    kind: Literal["point", "frame"]
    frame_a: int
    frame_b: int


@dataclass(frozen=True)
class ClosedChain(ReadOnlyArrays):
    r"""Closed chain with joint positions :math:`x = S\,(q, z) + o`, where ``z`` closes all anchors.

    The tree has ``nt`` joints. Its ``nv`` active joints have the positions ``q``. The ``nz`` unknowns ``z`` are the
    positions of passive joints that are not linear functions of others. A chain with only linear loops has no unknowns.

    Attributes:
        active: Indices of the active joints among the tree's velocities, ascending.
        passive: Indices of the passive joints, ascending.
        passive_names: Names of the passive joints.
        unknowns: Indices of ``z`` among the tree's velocities, a part of ``passive``.
        linear_map: ``S``, shape ``(nt, nv + nz)``.
        offset: ``o`` [rad or m], shape ``(nt,)``.
        anchors: Loops that are solved numerically.
        start: Tree positions [rad or m] at which all anchors are closed; they select one assembly mode.
        viscous_friction: Modelled viscous coefficients of the passive joints.
        coulomb_friction: Modelled Coulomb torques of the passive joints.
    """

    active: tuple[int, ...]
    passive: tuple[int, ...]
    passive_names: tuple[str, ...]
    unknowns: tuple[int, ...]
    linear_map: Float[Array, "nt ny"]
    offset: Float[Array, " nt"]
    anchors: tuple[Anchor, ...]
    start: Float[Array, " nt"]
    viscous_friction: Float[Array, " np"]
    coulomb_friction: Float[Array, " np"]

    @property
    def nv(self) -> int:
        """Number of active joints."""
        return len(self.active)


@dataclass(frozen=True)
class Constraints:
    """Pinocchio's constraint models of the anchors with their working memory, created for each trajectory."""

    model: pin.Model
    anchors: tuple[Anchor, ...]
    data: pin.Data
    pairs: tuple[tuple[Any, Any], ...]

    @property
    def slices(self) -> tuple[slice, ...]:
        """Rows of the error that belong to each anchor."""
        ends = np.cumsum([6 if anchor.kind == "frame" else 3 for anchor in self.anchors])
        return tuple(slice(int(a), int(b)) for a, b in zip([0, *ends[:-1]], ends, strict=True))


def constraints_of(model: pin.Model, anchors: tuple[Anchor, ...]) -> Constraints:
    """Constraint models of the anchors of a model, with their working memory."""
    made = []
    for anchor in anchors:
        a, b = model.frames[anchor.frame_a], model.frames[anchor.frame_b]
        made.append(_MODELS[anchor.kind](model, a.parentJoint, a.placement, b.parentJoint, b.placement))
    return Constraints(model, anchors, model.createData(), tuple((one, one.createData()) for one in made))


def error_and_jacobian(at: Constraints, x: Float[Array, " nt"]) -> tuple[Float[Array, " m"], Float[Array, "m nt"]]:
    """Errors of all anchors at positions ``x``, and their Jacobian.

    Returns:
        For each anchor the displacement [m] and, if it is a frame anchor, the rotation vector [rad], in the axes of its
        first frame; then the derivative of these errors by ``x``.
    """
    pin.computeJointJacobians(at.model, at.data, configurations(at.model, x[None])[0])
    errors, slopes = [], []
    for constraint, data in at.pairs:
        constraint.calc(at.model, at.data, data)
        errors.append(data.constraint_position_error)
        slopes.append(constraint.jacobian(at.model, at.data, data))
    return np.concatenate(errors), np.concatenate(slopes)


def nearest(
    chain: ClosedChain, at: Constraints, q: Float[Array, " nv"], z: Float[Array, " nz"]
) -> tuple[Float[Array, " nz"], Float[Array, " m"], Float[Array, "m nz"]]:
    """Unknowns with the smallest norm of the error (Levenberg-Marquardt), and error and Jacobian at this point.

    Args:
        chain: The chain.
        at: Constraints of its anchors.
        q: Positions of the active joints.
        z: Unknowns at which the search starts.
    """
    S, nv = chain.linear_map, chain.nv
    fixed, damping = S[:, :nv] @ q + chain.offset, _DAMPING

    def evaluate(unknowns: Array) -> tuple[Array, Array]:
        found, slope = error_and_jacobian(at, fixed + S[:, nv:] @ unknowns)
        return found, slope @ S[:, nv:]

    error, slope = evaluate(z)
    for _ in range(_MOST_STEPS):
        normal = slope.T @ slope
        # A lower bound, so that the damping is not zero if the Jacobian is zero.
        size = max(np.trace(normal), 1e-12)
        step = np.linalg.solve(normal + damping * size * np.eye(len(z)), -slope.T @ error)
        tried, tried_slope = evaluate(z + step)
        if tried @ tried < error @ error:
            z, error, slope, damping = z + step, tried, tried_slope, max(damping / 10, _LEAST_DAMPING)
        else:
            damping *= 10
        if np.abs(step).max() <= _LAST_STEP:
            break
    return z, error, slope


def widest_open_anchor(chain: ClosedChain, at: Constraints, error: Float[Array, " m"]) -> tuple[str, str]:
    """Label of the anchor with the largest error, and the size of this error in words."""
    worst = max(range(len(chain.anchors)), key=lambda k: float(np.linalg.norm(error[at.slices[k]])))
    rows = error[at.slices[worst]]
    apart = f"{np.linalg.norm(rows[:3]):.3g} m"
    if len(rows) == 6:
        apart += f" and {np.linalg.norm(rows[3:]):.3g} rad"
    return chain.anchors[worst].label, apart
