# pyright: reportAttributeAccessIssue=false
r"""Loops of a closed chain as pairs of coincident frames (pins), and derivatives of passive joint positions by errors.

A file may state a parallelogram by a formula for a passive joint (``elbow: theta3 - theta2``). In the real robot a pin
connects two links, and with wrong link lengths the formula does not hold. Therefore this module searches for pins: two
points, one on each link, that coincide in every posture if the formula holds. If there are no such points, the formula
is kept.

Only active joints have encoders. Passive joints keep the loops closed: a placement error that moves the two frames of a
loop apart by :math:`dc` moves the passive joints by :math:`dz = -(J_z)^+ dc`. The pseudo-inverse is needed for planar
loops, whose joints cannot move the frames in one direction. An error in this direction is not closed: in the real robot
the bearings yield.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float
from phantom_dyn.loops.chain import Anchor, ClosedChain, Constraints, constraints_of, error_and_jacobian
from phantom_dyn.loops.solver import CLOSED, SINGULAR
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import configurations
from phantom_dyn.random_streams import random_stream

_POSTURES = 12  # number of random postures in which two points have to coincide


@dataclass(frozen=True)
class KnownPlaces:
    """Corrected placements of joints and frames of a closed chain, from earlier diagnoses of poses.

    Attributes:
        twists: Correction of each joint, or frame of a loop, in its own axes [m, rad].
        targets: Pose of the tracker's target in the frame that carries it.
    """

    twists: Mapping[str, Float[Array, " 6"]] = field(default_factory=dict)
    targets: Mapping[str, pin.SE3] = field(default_factory=dict)


@dataclass(frozen=True)
class Loops:
    """A closed chain whose loops are pairs of coincident frames.

    Attributes:
        model: The tree, with a frame for each end of a pin.
        chain: The loops; ``linear_map`` and ``offset`` hold the formulas for which there is no pin.
        targets: For each frame with a known target, the index of the target's frame.
    """

    model: pin.Model
    chain: ClosedChain
    targets: Mapping[str, int] = field(default_factory=dict)

    @property
    def pins(self) -> tuple[int, ...]:
        """Indices of the frames that loops keep together, in the order of the loops."""
        return tuple(dict.fromkeys(frame for one in self.chain.anchors for frame in (one.frame_a, one.frame_b)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of `pins`."""
        return tuple(self.model.frames[frame].name for frame in self.pins)


def loops_of(robot: Robot, known: KnownPlaces | None = None) -> Loops | None:
    """The loops of a closed chain, with known corrections of placements; None for an open chain.

    Args:
        robot: The given model.
        known: Corrections from an earlier diagnosis of poses.
    """
    if robot.chain is None:
        return None
    loops = _with_found_pins(Loops(robot.model.copy(), robot.chain))
    if known is None:
        return loops
    model = loops.model
    names = dict(zip(loops.names, loops.pins, strict=True))
    for name, twist in known.twists.items():
        if name in names:
            move_frame(model, names[name], pin.exp6(twist))
        else:
            index = model.getJointId(name)
            model.jointPlacements[index] = model.jointPlacements[index] * pin.exp6(twist)
    targets = {}
    for name, place in known.targets.items():
        frame = model.getFrameId(name)
        targets[name] = _add_frame(model, f"target on {name}", frame, model.frames[frame].placement * place)
    return replace(loops, targets=targets)


def move_frame(model: pin.Model, frame: int, move: pin.SE3) -> None:
    """Move a frame, and all frames that are fixed to it.

    Args:
        model: The model, which is changed in place.
        frame: Index of the frame.
        move: Displacement of the frame in its own axes.
    """
    own = model.frames[frame].placement.copy()
    for index in range(model.nframes):
        if is_fixed_to(model, index, frame):
            model.frames[index].placement = own * move * own.inverse() * model.frames[index].placement


def is_fixed_to(model: pin.Model, frame: int, parent: int) -> bool:
    """True if a frame is ``parent`` itself, or a frame below it with the same parent joint."""
    joint = model.frames[parent].parentJoint
    while frame and model.frames[frame].parentJoint == joint:
        if frame == parent:
            return True
        frame = model.frames[frame].parentFrame
    return False


def joints_of_loop(model: pin.Model, anchor: Anchor) -> set[int]:
    """Pinocchio's indices of the joints of a loop: those that move one of its two frames and not the other."""
    a, b = (set(model.supports[model.frames[frame].parentJoint]) for frame in (anchor.frame_a, anchor.frame_b))
    return a ^ b


def _with_found_pins(loops: Loops) -> Loops:
    """The loops, with pins in place of those formulas that keep two points together."""
    model, chain = loops.model, loops.chain
    q = random_stream("postures for pins").uniform(-0.7, 0.7, (_POSTURES, chain.linear_map.shape[1]))
    x = q @ chain.linear_map.T + chain.offset
    by_formula = [row for row in chain.passive if row not in chain.unknowns]
    for first, second in combinations(by_formula, 2):
        if first in loops.chain.unknowns or second in loops.chain.unknowns:
            continue  # a pin that was found before determines this joint
        points = _coincident_points(model, x, first, second)
        if points is not None:
            trial = _with_pin(loops, (first, second), points)
            if trial is not None and _is_determined(trial, x):
                loops = trial
    return loops


def _coincident_points(model: pin.Model, x: Float[Array, "n nt"], first: int, second: int) -> Array | None:
    """Points on the bodies of two joints [m], ``(2, 3)``, that coincide at all positions; None if there are none."""
    data, joints = model.createData(), [joint_index(model, row) for row in (first, second)]
    if joints[1] in list(model.supports[joints[0]]) or joints[0] in list(model.supports[joints[1]]):
        return None  # one joint carries the other: any point on the axis of the outer one coincides
    matrix, right = [], []
    for configuration in configurations(model, x):
        pin.forwardKinematics(model, data, configuration)
        a, b = (data.oMi[joint] for joint in joints)
        matrix.append(np.hstack([a.rotation, -b.rotation]))
        right.append(b.translation - a.translation)
    A, y = np.concatenate(matrix), np.concatenate(right)
    # In a planar loop any points along the joint axes coincide. The solution of least norm is nearest to the joints.
    points = np.linalg.lstsq(A, y, rcond=SINGULAR)[0]
    return points.reshape(2, 3) if np.abs(A @ points - y).max() <= CLOSED else None


def _with_pin(loops: Loops, rows: tuple[int, int], points: Float[Array, "2 3"]) -> Loops | None:
    """The loops with a pin in place of the formulas of two joints; None if the pin's loop lacks one of the joints."""
    model, chain = loops.model.copy(), loops.chain
    links = [_link(model, row) for row in rows]
    ends = [
        _pin_frame(model, row, point, f"{own}_to_{other}")
        for row, point, own, other in zip(rows, points, links, links[::-1], strict=True)
    ]
    anchor = Anchor(f"pin of {links[0]} and {links[1]}", "point", ends[0], ends[1])
    inside = {model.joints[index].idx_v for index in joints_of_loop(model, anchor)}
    own = inside & (set(chain.passive) - set(chain.unknowns))
    if not own >= set(rows):
        return None
    unknowns = tuple(sorted({*chain.unknowns, *own}))
    nv = chain.nv
    linear_map = np.zeros((len(chain.linear_map), nv + len(unknowns)))
    linear_map[:, :nv] = chain.linear_map[:, :nv]
    offset = chain.offset.copy()
    for column, row in enumerate(unknowns):
        if row in own:
            linear_map[row], offset[row] = 0.0, 0.0
            linear_map[row, nv + column] = 1.0
        else:
            linear_map[:, nv + column] = chain.linear_map[:, nv + chain.unknowns.index(row)]
    new = replace(chain, unknowns=unknowns, linear_map=linear_map, offset=offset, anchors=(*chain.anchors, anchor))
    return replace(loops, model=model, chain=new)


def _is_determined(loops: Loops, x: Float[Array, "n nt"]) -> bool:
    """True if the loops determine all their passive joints in every posture."""
    at, to_unknown = constraints_of(loops.model, loops.chain.anchors), loops.chain.linear_map[:, loops.chain.nv :]
    for positions in x:
        values = np.linalg.svd(error_and_jacobian(at, positions)[1] @ to_unknown, compute_uv=False)
        if len(values) < to_unknown.shape[1] or not values[-1] > SINGULAR * values[0]:
            return False
    return True


def _pin_frame(model: pin.Model, row: int, point: Float[Array, " 3"], name: str) -> int:
    """A frame of a body at a point: one of the file if its origin differs along the joint axis only, else a new one."""
    index = joint_index(model, row)
    body, axis = _link_frame(model, index), _axis(model, index)
    for frame in range(model.nframes):
        one = model.frames[frame]
        distance = one.placement.translation - point
        distance = distance - axis * (axis @ distance)
        if one.parentJoint == index and one.type == pin.FrameType.BODY and np.abs(distance).max() <= CLOSED:
            return frame
    return _add_frame(model, name, body, pin.SE3(np.eye(3), point))


def _add_frame(model: pin.Model, name: str, parent: int, placement: pin.SE3) -> int:
    """Index of a new frame, fixed to the frame ``parent`` of the model, which is changed in place."""
    joint = model.frames[parent].parentJoint
    return model.addFrame(pin.Frame(name, joint, parent, placement, pin.FrameType.OP_FRAME), False)


def _axis(model: pin.Model, index: int) -> Float[Array, " 3"]:
    """Unit vector of the axis of a revolute joint; zero for a prismatic joint."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axis = pin.getJointJacobian(model, data, index, pin.LOCAL)[3:, model.joints[index].idx_v]
    return axis / max(float(np.linalg.norm(axis)), 1e-300)


def joint_index(model: pin.Model, row: int) -> int:
    """Pinocchio's index of the joint whose velocity is row ``row``."""
    return next(index for index in range(1, model.njoints) if model.joints[index].idx_v == row)


def _link_frame(model: pin.Model, index: int) -> int:
    """The frame of the link that a joint moves."""
    frames = [k for k in range(model.nframes) if model.frames[k].parentJoint == index]
    links = [k for k in frames if model.frames[k].type == pin.FrameType.BODY]
    return (links or frames)[0]


def _link(model: pin.Model, row: int) -> str:
    """Name of the link that the joint whose velocity is row ``row`` moves."""
    return model.frames[_link_frame(model, joint_index(model, row))].name


_MOST_STEPS = 20  # largest number of Gauss-Newton steps to close the loops
_LAST_STEP = 1e-11
"""Step [rad or m] below which a loop counts as closed."""
_ROUNDING = 1e-10
"""Derivatives below this are set to zero, because they are rounding errors. An example is the derivative by a rotation
about a passive joint's axis, which the joint compensates."""


@dataclass(frozen=True)
class PositionSensitivities:
    """Derivatives of all joint positions of the tree by errors, with the loops closed, at ``n`` poses.

    Attributes:
        by_active: Derivatives by the positions of the active joints, ``(n, nt, nv)``.
        by_place: Derivatives by twists of the placements of all joints, in the joints' axes,
            ``(n, nt, 6 (njoints - 1))``.
        by_pin: For each frame of a loop, derivatives by the twist of its placement, in the frame's axes,
            ``(n, nt, 6)``.
    """

    by_active: Float[Array, "n nt nv"]
    by_place: Float[Array, "n nt p"]
    by_pin: dict[int, Float[Array, "n nt 6"]]


def closed_positions(loops: Loops, q: Float[Array, "n nv"], near: Float[Array, "n nt"]) -> Float[Array, "n nt"]:
    """Positions of all joints [rad or m] at which the frames of the loops are nearest to each other, ``(n, nt)``.

    Args:
        loops: Tree and loops of the current model.
        q: Positions of the active joints.
        near: Positions of all joints at which the iteration starts, ``(n, nt)``.
    """
    chain = loops.chain
    S, nv = chain.linear_map, chain.nv
    z = near[:, list(chain.unknowns)].copy()
    fixed = q @ S[:, :nv].T + chain.offset
    if chain.anchors:
        at = constraints_of(loops.model, chain.anchors)
        for k in range(len(q)):
            for _ in range(_MOST_STEPS):
                error, slope = error_and_jacobian(at, fixed[k] + S[:, nv:] @ z[k])
                step = -np.linalg.pinv(slope @ S[:, nv:], rcond=SINGULAR) @ error
                z[k] += step
                if np.abs(step).max() <= _LAST_STEP:
                    break
    return fixed + z @ S[:, nv:].T


def position_sensitivities(loops: Loops, x: Float[Array, "n nt"]) -> PositionSensitivities:
    """Derivatives of all joint positions by errors, at positions that close the loops.

    Args:
        loops: Tree and loops.
        x: Positions of all joints of the tree.
    """
    model, chain = loops.model, loops.chain
    S, nv, n = chain.linear_map, chain.nv, len(x)
    by_active = np.broadcast_to(S[:, :nv], (n, len(S), nv)).copy()
    by_place = np.zeros((n, len(S), 6 * (model.njoints - 1)))
    by_pin = {frame: np.zeros((n, len(S), 6)) for frame in loops.pins}
    if not chain.anchors:
        return PositionSensitivities(by_active, by_place, by_pin)
    at, configuration, data = constraints_of(model, chain.anchors), configurations(model, x), model.createData()
    for k in range(n):
        slope = error_and_jacobian(at, x[k])[1] @ S
        # Change of the joint positions that closes the loops again, per error of the loops.
        response = -S[:, nv:] @ np.linalg.pinv(slope[:, nv:], rcond=SINGULAR)
        by_active[k] += response @ slope[:, :nv]
        pin.framesForwardKinematics(model, data, configuration[k])
        error_by_place, error_by_pin = _loop_errors(at, data)
        by_place[k] = response @ error_by_place
        for frame, error in error_by_pin.items():
            by_pin[frame][k] = response @ error
    return PositionSensitivities(by_active, by_place, by_pin)


def _loop_errors(at: Constraints, data: pin.Data) -> tuple[Float[Array, "m p"], dict[int, Float[Array, "m 6"]]]:
    """Derivatives of the errors of all loops by twists of the joint placements, and by twists of each loop frame."""
    model, count = at.model, sum(rows.stop - rows.start for rows in at.slices)
    places, pins = np.zeros((count, 6 * (model.njoints - 1))), {}
    for anchor, rows in zip(at.anchors, at.slices, strict=True):
        kept = rows.stop - rows.start
        apart = data.oMf[anchor.frame_a].actInv(data.oMf[anchor.frame_b])
        # From a twist of the second frame in its own axes to the axes and the origin of the first.
        second = apart.toActionMatrix()
        # From a twist at the origin of the first frame to the motion of the point where the second frame is.
        to_point = np.eye(6)
        to_point[:3, 3:] = -pin.skew(apart.translation)
        places[rows] = (to_point @ (second @ _regressor(model, data, anchor.frame_b)))[:kept]
        places[rows] -= (to_point @ _regressor(model, data, anchor.frame_a))[:kept]
        for frame, moves in ((anchor.frame_a, -to_point), (anchor.frame_b, to_point @ second)):
            # One body may carry several loops at one frame.
            pins.setdefault(frame, np.zeros((count, 6)))[rows] += moves[:kept]
    return places, pins


def _regressor(model: pin.Model, data: pin.Data, frame: int) -> Float[Array, "6 p"]:
    """Pinocchio's kinematic regressor of a frame in the frame's axes; zero for a frame that is fixed to the root."""
    if model.frames[frame].parentJoint == 0:
        return np.zeros((6, 6 * (model.njoints - 1)))
    return pin.computeFrameKinematicRegressor(model, data, frame, pin.LOCAL)


def without_rounding_errors(columns: Array) -> Array:
    """Columns in which rounding errors are set to zero."""
    return np.where(np.abs(columns) < _ROUNDING, 0.0, columns)
