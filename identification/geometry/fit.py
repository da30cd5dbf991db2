# pyright: reportAttributeAccessIssue=false
"""Gauss-Newton fit to measured poses; unknowns are the poses of base and targets, delays and the chosen terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from identification.geometry.equations import (
    BASE,
    TOOL,
    Equations,
    Estimate,
    Nuisance,
    PoseProblem,
    equations,
    tree_positions,
)
from identification.geometry.measured import PoseSet
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.motion import configurations

_STEPS = 30  # largest number of Gauss-Newton steps
_HALVINGS = 6  # a step that does not lower the sum of squares is halved at most this many times
_SMALL = 1e-10  # relative decrease of the weighted sum of squares at which a fit has converged
RANK = 1e-7
"""Singular values below this share of the largest one are rounding errors of robot files and of sums."""


def start_of(problem: PoseProblem) -> Estimate:
    """Start of the fit: poses of base and targets by the Kabsch method, no delay, and all terms zero.

    Poses that are not fitted are identities.
    """
    first: dict[int, Array] = {}
    tools = []
    for one in problem.sets:
        frames = frame_poses(problem, one)
        if one.recording not in first:
            first[one.recording] = np.eye(4) if problem.in_root else _aligned(frames[:, :3, 3], one.position)
        on_frame = one.frame in problem.on_frame
        tools.append(np.eye(4) if on_frame else _target(frames, first[one.recording], one))
    base = tuple(first.get(number, np.eye(4)) for number in range(problem.recordings))
    return Estimate(np.zeros(len(problem.terms)), base, tuple(tools), (0.0,) * problem.recordings)


def frame_poses(problem: PoseProblem, one: PoseSet) -> Float[Array, "n 4 4"]:
    """Poses of a frame in the robot's root frame, predicted by the given model.

    Args:
        problem: The problem with the model.
        one: Set of poses with the frame and the joint positions.
    """
    model, data = problem.model, problem.model.createData()
    out = np.empty((len(one.t), 4, 4))
    for k, q in enumerate(configurations(model, tree_positions(problem, model, one, one.q))):
        pin.framesForwardKinematics(model, data, q)
        out[k] = data.oMf[one.index].homogeneous
    return out


def _aligned(points: Float[Array, "n 3"], measured: Float[Array, "n 3"]) -> Float[Array, "4 4"]:
    """Rigid transformation that maps points to measured points with the least sum of squared distances (Kabsch)."""
    center, measured_center = points.mean(axis=0), measured.mean(axis=0)
    rotation = _nearest_rotation((measured - measured_center).T @ (points - center))
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, measured_center - rotation @ center
    return out


def _nearest_rotation(matrix: Float[Array, "3 3"]) -> Float[Array, "3 3"]:
    """The rotation with the least distance to a matrix, apart from the scale of the matrix."""
    u, _, vt = np.linalg.svd(matrix)
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt


def _target(frames: Float[Array, "n 4 4"], base: Float[Array, "4 4"], one: PoseSet) -> Float[Array, "4 4"]:
    """Pose of a target in its frame: mean orientation, and no translation."""
    out = np.eye(4)
    if one.turn is None:
        return out
    turns = np.array([pin.Quaternion(turn).toRotationMatrix() for turn in one.turn])
    out[:3, :3] = _nearest_rotation(np.sum(np.swapaxes(base[:3, :3] @ frames[:, :3, :3], 1, 2) @ turns, axis=0))
    return out


def fitted(
    problem: PoseProblem,
    estimate: Estimate,
    chosen: Sequence[int],
    weights: Float[Array, " s"],
    kept: Bool[Array, " m"] | float = 1.0,
) -> tuple[Estimate, Equations]:
    """The least-squares estimate with some of the terms, and the equations at this estimate.

    Args:
        problem: Poses and terms.
        estimate: Start of the fit; the values of other terms are not changed.
        chosen: Indices of the terms that are fitted.
        weights: One over the noise of each series.
        kept: True for rows that are used; by default all.
    """
    current = equations(problem, estimate)
    cost = _cost(current, weights, kept)
    for _ in range(_STEPS):
        step = _step(current, chosen, weights, kept)
        for halving in range(_HALVINGS):
            trial = stepped(current.kinds, estimate, chosen, step * 0.5**halving)
            at_trial = equations(problem, trial)
            lower = _cost(at_trial, weights, kept)
            if lower <= cost:
                break
        else:
            return estimate, current
        gained, estimate, current, cost = cost - lower, trial, at_trial, lower
        if gained <= _SMALL * max(cost, 1e-300):
            break
    return estimate, current


def _cost(linearised: Equations, weights: Array, kept: Array | float) -> float:
    """Weighted sum of squares of the residual."""
    return float(np.sum((linearised.residual * weights[linearised.series] * kept) ** 2))


def _step(linearised: Equations, chosen: Sequence[int], weights: Array, kept: Array | float) -> Array:
    """Gauss-Newton step of the nuisances and the chosen terms; the step of least norm if it is not unique."""
    scale = weights[linearised.series] * kept
    matrix = np.hstack([linearised.nuisance, linearised.columns[:, list(chosen)]]) * scale[:, None]
    norms = np.linalg.norm(matrix, axis=0)
    norms[norms == 0] = 1.0
    return np.linalg.lstsq(matrix / norms, linearised.residual * scale, rcond=RANK)[0] / norms


def stepped(kinds: Sequence[Nuisance], estimate: Estimate, chosen: Sequence[int], step: Float[Array, " k"]) -> Estimate:
    """The estimate after a step in the nuisances and the chosen terms; ``step`` has the nuisances first."""
    twists: dict[tuple[str, int], Array] = {}
    delay = list(estimate.delay)
    for kind, value in zip(kinds, step[: len(kinds)], strict=True):
        if kind.kind in (BASE, TOOL):
            twists.setdefault((kind.kind, kind.of), np.zeros(6))[kind.part] = value
        else:
            delay[kind.of] += float(value)
    values = estimate.values.copy()
    values[list(chosen)] += step[len(kinds) :]

    def moved(kind: str, poses: tuple[Array, ...]) -> tuple[Array, ...]:
        none = np.zeros(6)
        return tuple(pose @ pin.exp6(twists.get((kind, k), none)).homogeneous for k, pose in enumerate(poses))

    return replace(
        estimate,
        values=values,
        base=moved(BASE, estimate.base),
        tool=moved(TOOL, estimate.tool),
        delay=tuple(delay),
    )
