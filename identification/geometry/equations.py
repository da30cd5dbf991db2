# pyright: reportAttributeAccessIssue=false
"""Linear equations of measured poses: residuals, and the kinematic regressor of all candidate geometry errors.

The predicted pose of a target is ``T_tracker_base @ T_base_frame(q) @ T_frame_target``. If poses are given in the
robot's root frame, ``T_tracker_base`` and ``T_frame_target`` are identities, except for the candidate errors
``base_pose`` and ``tool_pose``. Residuals and columns are twists of the target in the target's axes, so that isotropic
noise stays isotropic. In a closed chain an error moves the target directly, and also through the passive joints, which
keep the loops closed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicSpline

from identification.geometry.measured import PoseSet
from identification.geometry.pins import (
    Loops,
    closed_positions,
    is_fixed_to,
    joint_index,
    move_frame,
    position_sensitivities,
    without_rounding_errors,
)
from identification.geometry.terms import BASE_POSE, ELASTIC, LINK, TOOL_POSE, ZERO, PoseTerm, pose_of_numbers, subspace
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import configurations

BASE, TOOL, DELAY = "base", "tool", "delay"


@dataclass(frozen=True)
class Estimate:
    """Estimated errors, poses and delays of a fit.

    Attributes:
        values: Value of each term in its unit, zero if it is not in the fit, ``(p,)``.
        base: ``T_tracker_base`` of each recording, ``(4, 4)``.
        tool: ``T_frame_target`` of each set of poses, ``(4, 4)``.
        delay: For each recording, the time by which the time stamps of its poses are too late [s].
    """

    values: Float[Array, " p"]
    base: tuple[Float[Array, "4 4"], ...]
    tool: tuple[Float[Array, "4 4"], ...]
    delay: tuple[float, ...]


@dataclass(frozen=True)
class Nuisance:
    """A column that is always in the fit: a component of a base or tool pose, or a delay.

    Attributes:
        kind: `BASE`, `TOOL` or `DELAY`.
        of: Index of the recording; for `TOOL` the index of the set of poses.
        part: Component of the twist, 0 to 5; 0 for a delay.
    """

    kind: str
    of: int
    part: int


@dataclass(frozen=True)
class Equations:
    """Residuals of all poses, and the derivatives of the predicted poses.

    Attributes:
        residual: Measured minus predicted pose [m or rad], ``(m,)``.
        nuisance: Columns that are always in the fit, ``(m, k)``.
        columns: Columns of the terms, ``(m, p)``.
        kinds: Kind of each column of ``nuisance``.
        pose: Index of the pose of each row, counted over all sets, ``(m,)``.
        series: Index of the noise series of each row, ``(m,)``: twice the index of its set of poses, plus one for
            orientations.
    """

    residual: Float[Array, " m"]
    nuisance: Float[Array, "m k"]
    columns: Float[Array, "m p"]
    kinds: tuple[Nuisance, ...]
    pose: Int[Array, " m"]
    series: Int[Array, " m"]

    def rows(self, kept: Array) -> Equations:
        """The equations of some rows."""
        return replace(
            self,
            residual=self.residual[kept],
            nuisance=self.nuisance[kept],
            columns=self.columns[kept],
            pose=self.pose[kept],
            series=self.series[kept],
        )


@dataclass(frozen=True)
class PoseProblem:
    """Measured poses and all candidate errors of the geometry.

    Attributes:
        robot: The given model.
        sets: Sets of measured poses: one for each frame of each recording.
        paths: Joint positions over time of the recordings that are motions, by index of the recording.
        terms: The candidate errors.
        in_root: True if poses are given in the robot's root frame, so that no pose of the base is fitted.
        on_frame: Frames whose own poses are measured, so that no pose of a target on them is fitted.
        loops: Loops of a closed chain, else None.
        compensated: Errors that are not among the terms because passive joints compensate them: no measured frame
            moves.
    """

    robot: Robot
    sets: tuple[PoseSet, ...]
    paths: Mapping[int, CubicSpline]
    terms: tuple[PoseTerm, ...]
    in_root: bool = False
    on_frame: tuple[str, ...] = ()
    loops: Loops | None = None
    compensated: tuple[PoseTerm, ...] = ()

    @property
    def model(self) -> pin.Model:
        """The robot's model. For a closed chain, its tree with pins as frames and known geometry errors corrected."""
        return self.robot.model if self.loops is None else self.loops.model

    @property
    def recordings(self) -> int:
        """Number of recordings, those without poses included."""
        return 1 + max(one.recording for one in self.sets)


def nuisances_of(problem: PoseProblem) -> tuple[Nuisance, ...]:
    """The nuisances: pose of the base and delay of each recording, and pose of the target of each set."""
    own = sorted({one.recording for one in problem.sets})
    out = [] if problem.in_root else [Nuisance(BASE, number, part) for number in own for part in range(6)]
    for k, one in enumerate(problem.sets):
        if one.frame not in problem.on_frame:
            out += [Nuisance(TOOL, k, part) for part in range(3 if one.turn is None else 6)]
    return (*out, *(Nuisance(DELAY, number, 0) for number in own if number in problem.paths))


def changed_model(model: pin.Model, terms: Sequence[PoseTerm], values: Float[Array, " p"]) -> pin.Model:
    """A copy of the model with joints and pins moved by ``link_geometry`` terms: ``placement @ exp(twist)``.

    Args:
        model: The given model.
        terms: Errors; terms of other effects than ``link_geometry`` are ignored.
        values: Value of each term.
    """
    out = model.copy()
    twists: dict[tuple[int, int], Array] = {}
    for term, value in zip(terms, values, strict=True):
        if term.effect == LINK and value != 0.0:
            twists.setdefault((term.row, term.frame), np.zeros(6))[term.part] = value
    for (row, frame), twist in twists.items():
        if frame < 0:
            index = joint_index(model, row)
            out.jointPlacements[index] = model.jointPlacements[index] * pin.exp6(twist)
        else:
            move_frame(out, frame, pin.exp6(twist))
    return out


def true_positions(
    q: Float[Array, "n nv"], load: Float[Array, "n nv"], terms: Sequence[PoseTerm], values: Float[Array, " p"]
) -> Float[Array, "n nv"]:
    """Positions of the links [rad or m]: encoder readings minus zero errors and minus deflections under load."""
    out = q.copy()
    for term, value in zip(terms, values, strict=True):
        if term.effect in (ZERO, ELASTIC) and value != 0.0:
            out[:, term.row] -= value * (load[:, term.row] if term.effect == ELASTIC else 1.0)
    return out


def equations(problem: PoseProblem, estimate: Estimate) -> Equations:
    """Residuals of the poses at an estimate, and the derivatives of the predicted poses there.

    Args:
        problem: Poses and terms.
        estimate: The estimate about which the equations are linearised.
    """
    kinds = nuisances_of(problem)
    model = changed_model(problem.model, problem.terms, estimate.values)
    parts, first = [], 0
    for number, one in enumerate(problem.sets):
        parts.append(_equations_of_set(problem, model, kinds, number, estimate, first))
        first += len(one.t)
    return Equations(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("residual", "nuisance", "columns")),
        kinds=kinds,
        pose=np.concatenate([part.pose for part in parts]),
        series=np.concatenate([part.series for part in parts]),
    )


def _equations_of_set(
    problem: PoseProblem, model: pin.Model, kinds: tuple[Nuisance, ...], number: int, estimate: Estimate, first: int
) -> Equations:
    """Equations of set ``number``; ``first`` is the number of poses of all sets before it."""
    one = problem.sets[number]
    delay = estimate.delay[one.recording]
    q, v = one.q, one.v
    if delay != 0.0:
        path = problem.paths[one.recording]
        q, v = path(one.t - delay), path(one.t - delay, 1)
    q = true_positions(q, one.load, problem.terms, estimate.values)
    base_error = _pose_error(problem, estimate, BASE_POSE, None)
    tool_error = _pose_error(problem, estimate, TOOL_POSE, one.frame)
    base = pin.SE3(estimate.base[one.recording]) * pose_of_numbers(base_error)
    tool = pin.SE3(estimate.tool[number]) * pose_of_numbers(tool_error)
    x = tree_positions(problem, model, one, q)
    # Derivatives of the target's twist by the base, by the joint placements (regressor), and by the joint positions.
    residual, by_base, regressor = _residuals_and_derivatives(model, one, x, base, tool)
    motions = _joint_columns(model, regressor)
    by_pin: dict[int, Array] = {}
    if problem.loops is not None:
        # An error moves the target directly, and through the passive joints that close the loops again.
        changes = position_sensitivities(replace(problem.loops, model=model), x)
        regressor = without_rounding_errors(regressor + motions @ changes.by_place)
        for frame, moves in changes.by_pin.items():
            by_pin[frame] = without_rounding_errors(_pin_columns(model, one, frame, tool) + motions @ moves)
        motions = motions @ changes.by_active
    nuisance = np.zeros((len(one.t), 6, len(kinds)))
    for k, unknown in enumerate(kinds):
        # A tool pose belongs to one set of poses, a base pose and a delay to all sets of one recording.
        if unknown.kind == TOOL and unknown.of == number:
            nuisance[:, unknown.part, k] = 1.0
        elif unknown.kind == BASE and unknown.of == one.recording:
            nuisance[:, :, k] = by_base[:, :, unknown.part]
        elif unknown.kind == DELAY and unknown.of == one.recording:
            nuisance[:, :, k] = -np.einsum("nij,nj->ni", motions, v)
    pose_columns = {
        BASE_POSE: by_base @ _pose_error_columns(base_error),
        TOOL_POSE: np.broadcast_to(_pose_error_columns(tool_error), by_base.shape),
    }
    columns = np.zeros((len(one.t), 6, len(problem.terms)))
    for k, term in enumerate(problem.terms):
        if term.effect not in pose_columns:
            if term.frame in by_pin:
                columns[:, :, k] = by_pin[term.frame][:, :, term.part]
            else:
                columns[:, :, k] = _term_column(model, term, regressor, motions, one.load)
        elif term.joint in (None, one.frame):
            columns[:, :, k] = pose_columns[term.effect][:, :, term.part]
    kept = 3 if one.turn is None else 6
    rows = len(one.t) * kept
    return Equations(
        residual[:, :kept].reshape(rows),
        nuisance[:, :kept].reshape(rows, -1),
        columns[:, :kept].reshape(rows, -1),
        kinds,
        np.repeat(first + np.arange(len(one.t)), kept),
        np.tile(2 * number + (np.arange(kept) >= 3), len(one.t)),
    )


def tree_positions(
    problem: PoseProblem, model: pin.Model, one: PoseSet, q: Float[Array, "n nv"]
) -> Float[Array, "n nt"]:
    """Positions of all joints of the tree [rad or m]; of an open chain, ``q`` itself.

    Args:
        problem: The problem with its loops.
        model: The tree at the current estimate.
        one: Set of poses; the loops are closed near the joint positions of these poses.
        q: Positions of the robot's active joints.
    """
    if problem.loops is None:
        return q
    return closed_positions(replace(problem.loops, model=model), q, problem.robot.solutions.at(one.q).x)


def _pin_columns(model: pin.Model, one: PoseSet, frame: int, tool: pin.SE3) -> Float[Array, "6 6"]:
    """Derivative of the target's twist by the twist of a pin; zero if the target is not fixed to the pin."""
    if not is_fixed_to(model, one.index, frame):
        return np.zeros((6, 6))
    pin_to_target = model.frames[frame].placement.actInv(model.frames[one.index].placement * tool)
    return pin_to_target.toActionMatrixInverse()


def _pose_error_columns(numbers: Float[Array, " 6"]) -> Float[Array, "6 6"]:
    """Derivative of the twist of a ``base_pose`` or ``tool_pose``, in its own axes, by its six numbers."""
    out = np.zeros((6, 6))
    out[:3, :3], out[3:, 3:] = pin.exp3(numbers[3:]).T, pin.Jexp3(numbers[3:])
    return out


def _pose_error(problem: PoseProblem, estimate: Estimate, effect: str, of: str | None) -> Float[Array, " 6"]:
    """The six estimated numbers of a ``base_pose``, or of the ``tool_pose`` of a frame [m and rad]."""
    out = np.zeros(6)
    for term, value in zip(problem.terms, estimate.values, strict=True):
        if term.effect_joint == (effect, of):
            out[term.part] = value
    return out


def _residuals_and_derivatives(
    model: pin.Model, one: PoseSet, x: Array, base: pin.SE3, tool: pin.SE3
) -> tuple[Float[Array, "n 6"], Float[Array, "n 6 6"], Float[Array, "n 6 j"]]:
    """Residual of each pose; derivatives of the target's twist by the twists of the base and of joint placements."""
    data, configuration = model.createData(), configurations(model, x)
    n = len(x)
    residual, by_base = np.zeros((n, 6)), np.empty((n, 6, 6))
    regressor = np.empty((n, 6, 6 * (model.njoints - 1)))
    to_target = tool.toActionMatrixInverse()
    for k in range(n):
        pin.framesForwardKinematics(model, data, configuration[k])
        target = data.oMf[one.index] * tool
        regressor[k] = to_target @ pin.computeFrameKinematicRegressor(model, data, one.index, pin.LOCAL)
        by_base[k] = target.toActionMatrixInverse()
        predicted = base * target
        residual[k, :3] = predicted.rotation.T @ (one.position[k] - predicted.translation)
        if one.turn is not None:
            residual[k, 3:] = pin.log3(predicted.rotation.T @ pin.Quaternion(one.turn[k]).toRotationMatrix())
    return residual, by_base, regressor


def _joint_columns(model: pin.Model, regressor: Float[Array, "n 6 j"]) -> Float[Array, "n 6 nv"]:
    """Derivative of the target's twist by each joint position."""
    out = np.empty((len(regressor), 6, model.nv))
    for index in range(1, model.njoints):
        own = regressor[:, :, 6 * (index - 1) : 6 * index]
        out[:, :, model.joints[index].idx_v] = own @ subspace(model, index)
    return out


def _term_column(
    model: pin.Model, term: PoseTerm, regressor: Array, motions: Array, load: Array
) -> Float[Array, "n 6"]:
    """Derivative of the target's twist by the value of a term."""
    if term.effect == LINK:
        return regressor[:, :, 6 * (joint_index(model, term.row) - 1) + term.part]
    # The minus sign: the position of the link is the reading minus the zero error and minus the deflection under load.
    along = -motions[:, :, term.row]
    return along * load[:, term.row, None] if term.effect == ELASTIC else along
