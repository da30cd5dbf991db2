# pyright: reportAttributeAccessIssue=false
"""The loops of a closed chain as pairs of frames that stay together, also where the file states a formula.

A file may state a parallelogram by a formula (``elbow: theta3 - theta2``). In the robot a pin holds two links together,
and with other link lengths the formula does not hold. So pins are searched for: two points, one on each link, that the
formula keeps together in every posture. Where there are none, the formula is kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float
from phantom_dyn.loops.chain import Anchor, ClosedChain, constraints_of, error_and_slope
from phantom_dyn.loops.solver import CLOSED, SINGULAR
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import configurations
from phantom_dyn.random_streams import random_stream

_POSTURES = 12


@dataclass(frozen=True)
class KnownPlaces:
    """Corrected places of a closed chain, from earlier diagnoses of poses.

    Attributes:
        twists: Correction of each joint, or frame of a loop, in its own axes [m, rad].
        targets: Pose of the target on each frame.
    """

    twists: Mapping[str, Float[Array, " 6"]] = field(default_factory=dict)
    targets: Mapping[str, pin.SE3] = field(default_factory=dict)


@dataclass(frozen=True)
class Loops:
    """A closed chain whose loops are frames that stay together.

    Attributes:
        model: The tree, with a frame for each pin.
        chain: Its loops; ``linear_map`` and ``offset`` hold the formulas for which there is no pin.
        targets: For each frame with a known target, the index of the target's frame.
    """

    model: pin.Model
    chain: ClosedChain
    targets: Mapping[str, int] = field(default_factory=dict)

    @property
    def pins(self) -> tuple[int, ...]:
        """Frames that loops keep together, in the order of the loops."""
        return tuple(dict.fromkeys(frame for one in self.chain.anchors for frame in (one.frame_a, one.frame_b)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of `pins`."""
        return tuple(self.model.frames[frame].name for frame in self.pins)


def loops_of(robot: Robot, known: KnownPlaces | None = None) -> Loops | None:
    """The loops of a closed chain with known corrections of their places; None for an open chain.

    Args:
        robot: The given model.
        known: Corrections from earlier poses.
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
        targets[name] = _added(model, f"target on {name}", frame, model.frames[frame].placement * place)
    return replace(loops, targets=targets)


def move_frame(model: pin.Model, frame: int, move: pin.SE3) -> None:
    """Move a frame in its own axes, with all that is fixed to it.

    Args:
        model: It is changed.
        frame: Index of the frame.
        move: Of the frame.
    """
    own = model.frames[frame].placement.copy()
    for index in range(model.nframes):
        if is_carried(model, index, frame):
            model.frames[index].placement = own * move * own.inverse() * model.frames[index].placement


def is_carried(model: pin.Model, frame: int, by: int) -> bool:
    """True if a frame is ``by`` itself, or fixed to it."""
    joint = model.frames[by].parentJoint
    while frame and model.frames[frame].parentJoint == joint:
        if frame == by:
            return True
        frame = model.frames[frame].parentFrame
    return False


def around(model: pin.Model, anchor: Anchor) -> set[int]:
    """Joints of a loop, by Pinocchio's index: those that move one of its frames and not the other."""
    a, b = (set(model.supports[model.frames[frame].parentJoint]) for frame in (anchor.frame_a, anchor.frame_b))
    return a ^ b


def _with_found_pins(loops: Loops) -> Loops:
    """The loops with pins in the place of formulas, where two points stay together."""
    model, chain = loops.model, loops.chain
    q = random_stream("postures for pins").uniform(-0.7, 0.7, (_POSTURES, chain.linear_map.shape[1]))
    x = q @ chain.linear_map.T + chain.offset
    followers = [row for row in chain.passive if row not in chain.unknowns]
    for first, second in combinations(followers, 2):
        if first in loops.chain.unknowns or second in loops.chain.unknowns:
            continue
        points = _staying_together(model, x, first, second)
        if points is not None:
            trial = _with_pin(loops, (first, second), points)
            loops = loops if trial is None or not _determined(trial, x) else trial
    return loops


def _staying_together(model: pin.Model, x: Float[Array, "n nt"], first: int, second: int) -> Array | None:
    """Points of the bodies of two joints [m], ``(2, 3)``, that are together at all positions; None without such."""
    data, joints = model.createData(), [_index(model, row) for row in (first, second)]
    if set(model.supports[joints[0]]) & {joints[1]} or set(model.supports[joints[1]]) & {joints[0]}:
        return None
    matrix, right = [], []
    for configuration in configurations(model, x):
        pin.forwardKinematics(model, data, configuration)
        a, b = (data.oMi[joint] for joint in joints)
        matrix.append(np.hstack([a.rotation, -b.rotation]))
        right.append(b.translation - a.translation)
    A, y = np.concatenate(matrix), np.concatenate(right)
    # The points nearest to the joints: those of a planar loop may be anywhere along its axes.
    points = np.linalg.lstsq(A, y, rcond=SINGULAR)[0]
    return points.reshape(2, 3) if np.abs(A @ points - y).max() <= CLOSED else None


def _with_pin(loops: Loops, rows: tuple[int, int], points: Float[Array, "2 3"]) -> Loops | None:
    """The loops with a pin at two points in place of the formulas of its joints; None if it does not close them."""
    model, chain = loops.model.copy(), loops.chain
    links = [_link(model, row) for row in rows]
    ends = [
        _pin_frame(model, row, point, f"{own}_to_{other}")
        for row, point, own, other in zip(rows, points, links, links[::-1], strict=True)
    ]
    anchor = Anchor(f"pin of {links[0]} and {links[1]}", "point", ends[0], ends[1])
    inside = {model.joints[index].idx_v for index in around(model, anchor)}
    own = inside & set(chain.passive) - set(chain.unknowns)
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


def _determined(loops: Loops, x: Float[Array, "n nt"]) -> bool:
    """True if the loops determine all their passive joints in every posture."""
    at, to_unknown = constraints_of(loops.model, loops.chain.anchors), loops.chain.linear_map[:, loops.chain.nv :]
    for positions in x:
        values = np.linalg.svd(error_and_slope(at, positions)[1] @ to_unknown, compute_uv=False)
        if len(values) < to_unknown.shape[1] or not values[-1] > SINGULAR * values[0]:
            return False
    return True


def _pin_frame(model: pin.Model, row: int, point: Float[Array, " 3"], name: str) -> int:
    """A frame of the body at a point: one of the file, if it differs only along the joint's axis, else a new one."""
    index = _index(model, row)
    body, axis = _link_frame(model, index), _axis(model, index)
    for frame in range(model.nframes):
        one = model.frames[frame]
        beside = one.placement.translation - point
        beside = beside - axis * (axis @ beside)
        if one.parentJoint == index and one.type == pin.FrameType.BODY and np.abs(beside).max() <= CLOSED:
            return frame
    return _added(model, name, body, pin.SE3(np.eye(3), point))


def _added(model: pin.Model, name: str, beside: int, placement: pin.SE3) -> int:
    joint = model.frames[beside].parentJoint
    return model.addFrame(pin.Frame(name, joint, beside, placement, pin.FrameType.OP_FRAME), False)


def _axis(model: pin.Model, index: int) -> Float[Array, " 3"]:
    """Axis about which a joint turns, zero if it slides."""
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axis = pin.getJointJacobian(model, data, index, pin.LOCAL)[3:, model.joints[index].idx_v]
    return axis / max(float(np.linalg.norm(axis)), 1e-300)


def _index(model: pin.Model, row: int) -> int:
    return next(index for index in range(1, model.njoints) if model.joints[index].idx_v == row)


def _link_frame(model: pin.Model, index: int) -> int:
    """The frame of the link that a joint moves."""
    frames = [k for k in range(model.nframes) if model.frames[k].parentJoint == index]
    links = [k for k in frames if model.frames[k].type == pin.FrameType.BODY]
    return (links or frames)[0]


def _link(model: pin.Model, row: int) -> str:
    return model.frames[_link_frame(model, _index(model, row))].name
