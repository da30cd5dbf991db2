# pyright: reportAttributeAccessIssue=false
"""Decides whether measured poses are, as their columns state, poses of a robot's frame in the robot's root frame.

By definition the column ``p.<frame>`` is the position of a frame of the robot in its root frame. But a laser tracker
may write positions in the tracker's axes, and its reflector may be mounted beside the frame. If a pose differs from the
model by more than a plausible error, the pose of the base or of the target counts as unknown and is fitted. Otherwise
the difference counts as a candidate error ``base_pose`` or ``tool_pose``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from identification.geometry.equations import Equations, PoseProblem, equations
from identification.geometry.fit import fitted, frame_poses, start_of
from identification.geometry.measured import PoseSet
from identification.geometry.pins import Loops
from identification.geometry.terms import BASE_POSE, LINK, TOOL_POSE, PoseTerm, pose_terms, terms_of
from phantom_dyn.model.robot import Robot

_LITTLE = 1e-3
"""A placement error counts as without effect if it moves frames by less than this share of the most effective one."""
_CHANCE = 1e-4
"""Significance level of the test whether a base near the root frame fits worse than a free base of each recording."""


def problem_of(
    robot: Robot, sets: tuple[PoseSet, ...], paths: Mapping[int, CubicSpline], loops: Loops | None = None
) -> PoseProblem:
    """Measured poses with all candidate errors of the geometry.

    Errors of the base and tool poses are candidates if the columns state poses in the root frame; else the poses are
    nuisances, which every fit contains.

    Args:
        robot: The given model.
        sets: Measured poses.
        paths: Joint positions over time of the recordings that are motions.
        loops: Loops of a closed chain.
    """
    free = _without_compensated(
        PoseProblem(robot, sets, paths, terms_of(robot, [one.frame for one in sets], loops), loops=loops)
    )
    joints = free.terms
    if not joints or any(_is_far(free, one) for one in sets):
        return free
    parts: dict[str, int] = {}
    for one in sets:
        parts[one.frame] = max(parts.get(one.frame, 3), 3 if one.turn is None else 6)
    terms = pose_terms(BASE_POSE, None)
    for frame, count in parts.items():
        terms += pose_terms(TOOL_POSE, frame, count)
    stated = replace(free, terms=terms, in_root=True, on_frame=tuple(parts))
    weights = np.ones(2 * len(sets))
    estimate, fit_as_stated = fitted(stated, start_of(stated), range(len(terms)), weights)
    _, free_fit = fitted(free, start_of(free), (), weights)
    # Errors of base and tool that are larger than plausible: the column is not what its name states.
    far = {term.effect_joint for term, value in zip(terms, estimate.values, strict=True) if abs(value) > term.largest}
    if (BASE_POSE, None) in far or not _as_good(fit_as_stated, len(terms), free_fit):
        return free
    frames = tuple(frame for frame in parts if (TOOL_POSE, frame) not in far)
    kept = tuple(term for term in terms if term.effect == BASE_POSE or term.joint in frames)
    return replace(free, terms=kept + without_errors_of_base(robot, joints, sets), in_root=True, on_frame=frames)


def _without_compensated(problem: PoseProblem) -> PoseProblem:
    """The problem without placement errors that passive joints compensate, so that they hardly move a frame."""
    if problem.loops is None or not problem.terms:
        return problem
    size = np.abs(equations(problem, start_of(problem)).columns).max(axis=0)
    places = np.array([term.effect == LINK for term in problem.terms])
    linear = np.array([term.unit == "m" for term in problem.terms])
    least = np.zeros(len(size))
    for same in (places & linear, places & ~linear):
        least[same] = _LITTLE * size[same].max(initial=0.0)
    moves = ~places | (size > least)
    kept, lost = (tuple(np.array(problem.terms, dtype=object)[rows]) for rows in (moves, ~moves))
    return replace(problem, terms=kept, compensated=lost)


def without_errors_of_base(robot: Robot, joints: Sequence[PoseTerm], sets: Sequence[PoseSet]) -> tuple[PoseTerm, ...]:
    """Terms except placement errors of a first joint that carries all frames: these equal errors of the base's pose.

    Args:
        robot: The given model.
        joints: Terms of joints.
        sets: Measured poses.
    """
    model = robot.model
    carrying = [set(model.supports[model.frames[model.getFrameId(one.frame)].parentJoint]) for one in sets]
    placed = [
        index
        for index in range(1, model.njoints)
        if any(one.effect == LINK and one.row == model.joints[index].idx_v for one in joints)
    ]
    first = {
        index
        for index in set.intersection(*carrying)
        if index and model.parents[index] == 0 and all(index in model.supports[other] for other in placed)
    }
    rows = {model.joints[index].idx_v for index in first}
    return tuple(term for term in joints if term.effect != LINK or term.row not in rows)


def _is_far(problem: PoseProblem, one: PoseSet) -> bool:
    """True if a frame is farther from its predicted position than plausible errors of base and tool explain."""
    reached = frame_poses(problem, one)[:, :3, 3]
    shift, turn = pose_terms(BASE_POSE, None)[0].largest, pose_terms(BASE_POSE, None)[3].largest
    reach = float(np.linalg.norm(reached, axis=1).max())
    # All three shifts of base and tool, and all three rotations of the base, have their largest plausible values.
    return float(np.median(np.linalg.norm(one.position - reached, axis=1))) > np.sqrt(3) * (2 * shift + turn * reach)


def _as_good(stated: Equations, terms: int, free: Equations) -> bool:
    """True if the fit with poses as stated is not significantly worse than that with free poses (F test).

    ``terms`` is the number of terms of the fit with poses as stated.
    """
    from scipy.special import fdtri

    squares_stated, squares_free = float(stated.residual @ stated.residual), float(free.residual @ free.residual)
    more, rest = max(free.nuisance.shape[1] - stated.nuisance.shape[1] - terms, 1), max(len(free.residual) - 1, 1)
    # One over the lower quantile of F(rest, more) is the upper quantile of F(more, rest).
    limit = 1.0 + more / rest / float(fdtri(rest, more, _CHANCE))
    # Residuals below 1e-12 m or rad are rounding errors, as of poses that were simulated without noise.
    return squares_stated <= limit * squares_free + 1e-24 * len(stated.residual)
