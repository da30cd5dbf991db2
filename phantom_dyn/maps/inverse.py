"""Inverse kinematics for maps: joint positions for tip positions, on the branch nearest to a given posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array
from phantom_dyn.errors import ParameterError
from phantom_dyn.maps.map_model import MapModel, tip_of, within_limits

CLOSE = 1e-9
"""Distance [m] between tip and point below which Newton's method has converged, far above rounding errors."""
# Number of random configurations, and of starts of Newton's method for each point.
_SAMPLES, _STARTS = 20000, 8
# The same numbers for a chain that is closed numerically: each configuration takes about a millisecond.
_NUMERIC_SAMPLES, _NUMERIC_STARTS = 4000, 6
# Number of random configurations whose tips are nearest to a point, from which the starts for this point are chosen.
_NEAR = 48
# Largest number of steps of Newton's method.
_STEPS = 25
# Two starts count as on the same branch if no joint differs by more than this [rad or m].
_SAME_BRANCH = 0.5


@dataclass(frozen=True)
class Cloud:
    """Random configurations within the limits, and their tip positions, from which Newton's method starts.

    Attributes:
        q: Configurations [rad or m], shape ``(n, nv)``.
        tip: Tip positions [m], shape ``(n, 3)``.
    """

    q: Array
    tip: Array


def require_determined(model: MapModel, axes: tuple[str, ...]) -> None:
    """Refuse a grid over tip positions that do not determine the joints, or to which the tip cannot move.

    Args:
        model: The robot.
        axes: Axes of the grid, out of x, y and z.

    Raises:
        ParameterError: If the number of joints differs from that of the axes.
    """
    joint = f"q.{model.joint_names[0]}=-1:1:21"
    if model.nv not in (2, 3):
        many = "a tip position does not determine them" if model.nv > 3 else "it cannot follow a tip position"
        joints = f"{model.nv} active joints" if model.nv > 1 else "one active joint"
        raise ParameterError(f"{model.name} has {joints}, and {many}: give a grid over joints, such as {joint}.")
    if model.nv == 2 and len(axes) != 2:
        raise ParameterError(
            f"The grid is over {', '.join(axes)}, and the tip of {model.name}, which has two active joints, moves on "
            f"a surface: give the two of x, y and z in which it moves, or a grid over joints, such as {joint}."
        )


def cloud_of(model: MapModel) -> Cloud | None:
    """Random configurations; None for a robot with inverse kinematics in closed form."""
    if model.branches is not None:
        return None
    active = list(model.robot.tree_rows)
    low, high = model.lower[active], model.upper[active]
    # Of a revolute joint one turn is drawn, which has all its poses; of a prismatic joint without limits a metre to
    # both sides of the posture.
    span = np.where(model.robot.prismatic, 1.0, np.pi)
    narrow = np.isfinite(high - low) & (model.robot.prismatic | (high - low < 2 * np.pi))
    low, high = np.where(narrow, low, model.posture - span), np.where(narrow, high, model.posture + span)
    # The same seed gives the same configurations in every process and run.
    samples = _NUMERIC_SAMPLES if model.closed_numerically else _SAMPLES
    q = np.random.default_rng(0).uniform(low, high, (samples, model.nv))
    q = q[within_limits(model, q)]
    tip = tip_of(model, q)[0]
    # With wide limits, the loops of a closed chain cannot be closed in most postures; the tip of such a posture is NaN.
    closed = np.isfinite(tip).all(axis=1)
    return Cloud(q[closed], tip[closed])


def nearest_branch(model: MapModel, points: Array, cloud: Cloud | None, axes: tuple[int, ...] = (0, 1, 2)) -> Array:
    """Joint positions for tip positions.

    Args:
        model: A robot with two or three active joints.
        points: Points in the root frame [m], shape ``(N, 3)``.
        cloud: Result of `cloud_of`.
        axes: Coordinates of the points that the tip has to reach, as many as there are active joints.

    Returns:
        Active positions, shape ``(N, nv)``, on the branch within the limits that is nearest to ``model.posture``; NaN
        for points that no branch reaches.
    """
    if model.branches is not None:
        candidates = model.branches(points)
    else:
        assert cloud is not None
        candidates = _searched(model, points, cloud, list(axes))
    best, least = np.full((len(points), model.nv), np.nan), np.full(len(points), np.inf)
    for q in candidates:
        q = _near_posture(model, q)
        rows = np.flatnonzero(np.isfinite(q).all(axis=1))
        rows = rows[within_limits(model, q[rows])]
        rows = rows[np.linalg.norm((tip_of(model, q[rows])[0] - points[rows])[:, list(axes)], axis=1) < CLOSE]
        distance = np.full(len(q), np.inf)
        distance[rows] = np.linalg.norm(q[rows] - model.posture, axis=1)
        nearer = distance < least
        best[nearer], least[nearer] = q[nearer], distance[nearer]
    return best


def _near_posture(model: MapModel, q: Array) -> Array:
    """Angles shifted by whole turns to within half a turn of the posture, or further if the limits require this."""
    active = list(model.robot.tree_rows)
    turns = np.where(model.robot.prismatic, 0.0, 2 * np.pi)
    q = q - turns * np.round((q - model.posture) / (2 * np.pi))
    q = q + turns * (q < model.lower[active] - 1e-9)
    return q - turns * (q > model.upper[active] + 1e-9)


def _searched(model: MapModel, points: Array, cloud: Cloud, axes: list[int]) -> Array:
    """Results of Newton's method, ``(starts, N, nv)``, each from a random configuration whose tip is near the point."""
    # Imported here because the import takes longer than many maps that do not need it.
    from scipy.spatial import KDTree

    if not len(cloud.q):
        return np.full((1, len(points), model.nv), np.nan)
    _, index = KDTree(cloud.tip[:, axes]).query(points[:, axes], k=min(_NEAR, len(cloud.q)))
    near = cloud.q[index.reshape(len(points), -1)]
    return np.stack([_newton(model, points, start, axes) for start in _distinct(model, near)])


def _distinct(model: MapModel, near: Array) -> list[Array]:
    """Starts of Newton's method, each ``(N, nv)`` for all points, those nearest to the posture first.

    The starts of a point are chosen from its ``k`` configurations ``near``, ``(N, k, nv)``, each on another branch
    (`_SAME_BRANCH`) than those before; NaN if there are no more branches.
    """
    rows = np.arange(len(near))
    distance = np.linalg.norm(near - model.posture, axis=2)
    starts = []
    for _ in range(_NUMERIC_STARTS if model.closed_numerically else _STARTS):
        pick = np.argmin(distance, axis=1)
        start = np.where(np.isfinite(distance[rows, pick])[:, None], near[rows, pick], np.nan)
        starts.append(start)
        same = (np.abs(near - start[:, None]) < _SAME_BRANCH).all(axis=2)
        distance = np.where(same, np.inf, distance)
    return starts


def _newton(model: MapModel, points: Array, start: Array, axes: list[int]) -> Array:
    """Joint positions after damped Newton steps, which may not have converged; NaN where the start is NaN."""
    q = start.copy()
    unfinished = np.flatnonzero(np.isfinite(q).all(axis=1))
    for _ in range(_STEPS):
        if not len(unfinished):
            break
        tip, J = tip_of(model, q[unfinished])
        gap, J = (points[unfinished] - tip)[:, axes], J[:, axes]
        # The damping decreases with the gap: steps are safe far from the point, and converge quadratically near it.
        damping = (np.sum(gap**2, axis=1)[:, None, None] + 1e-14) * np.eye(len(axes))
        step = np.einsum("nji,nj->ni", J, np.linalg.solve(J @ np.swapaxes(J, 1, 2) + damping, gap[..., None])[..., 0])
        q[unfinished] += step * np.minimum(1, 0.5 / np.maximum(np.abs(step).max(axis=1), 1e-12))[:, None]
        moving = np.abs(step).max(axis=1) > 1e-13
        unfinished = unfinished[moving & np.isfinite(q[unfinished]).all(axis=1)]
    return q
