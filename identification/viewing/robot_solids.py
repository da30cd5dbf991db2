# pyright: reportAttributeAccessIssue=false
"""Makes the solids that show one copy of the robot: links, joints, and rails of linear joints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from identification.viewing.replay import Replay
from phantom_dyn.array_types import Array, Float
from phantom_dyn.shapes.meshes import Mesh, capsule, joined, moved
from phantom_dyn.shapes.robot_shapes import joint_axis, joint_solid, robot_shapes

_FACES = 12_000
"""Largest number of triangles for the links of one copy."""
_POSTURES = 60
"""Number of frames from which the extent of the robot is computed."""
_DRUM = 0.75
"""Size of the solids of joints relative to the report, which draws the robot smaller and so needs larger joints."""
_PASSIVE = 0.8
"""Size of a passive joint relative to active joints, so that it does not hide an active joint at the same position."""
_RAIL = 0.008
"""Radius of a rail, relative to its length."""
_APART, _LEAST_APART = 1.15, 0.3
"""Distance between copies relative to the robot's width, and smallest distance relative to its longest side."""


@dataclass(frozen=True, eq=False)
class Solids:
    """Meshes of one copy, and its extent.

    Attributes:
        links: Link of each joint of Pinocchio's model, in the joint's frame, beginning with the root; may be empty.
        drums: Solid that shows each joint, in the joint's frame; empty for the root.
        rails: Rails of the linear joints whose parent is the joint, in the joint's frame, for each joint.
        boxes: Lowest and highest corner [m] of the robot in some postures of the measured motion, ``(f, 2, 3)``.
    """

    links: tuple[Mesh, ...]
    drums: tuple[Mesh, ...]
    rails: tuple[Mesh, ...]
    boxes: Float[Array, "f 2 3"]

    @property
    def size(self) -> Float[Array, "3"]:
        """Largest extent along each axis over all postures [m]."""
        return (self.boxes[:, 1] - self.boxes[:, 0]).max(axis=0)

    @property
    def middle(self) -> Float[Array, "3"]:
        """Mean of the centres of all postures [m]."""
        return self.boxes.mean(axis=(0, 1))

    @property
    def top(self) -> float:
        """Highest point of any posture [m]."""
        return float(self.boxes[:, 1, 2].max())

    @property
    def floor(self) -> float:
        """Lowest point of the fixed base [m]; zero without a fixed base."""
        return float(self.links[0].points[:, 2].min()) if len(self.links[0].faces) else 0.0

    def offsets(self, count: int) -> Float[Array, "count 3"]:
        """Positions of copies in a row [m]: along x or y, whichever side of the robot is narrower."""
        axis = 0 if self.size[0] < self.size[1] else 1
        out = np.zeros((count, 3))
        spacing = max(_APART * self.size[axis], _LEAST_APART * self.size.max())
        out[:, axis] = spacing * np.arange(count)
        return out


def robot_solids(replay: Replay) -> Solids:
    """Makes the solids for the robot of a replay."""
    model = replay.robot.model
    measured = replay.copies[0]
    known = np.flatnonzero(np.isfinite(measured.poses).all(axis=(1, 2)))
    poses = measured.poses[known[np.unique(np.linspace(0, len(known) - 1, _POSTURES).astype(int))]]
    links = robot_shapes(replay.robot, _FACES).links
    rails = _rails(model, replay)
    bare = boxes(poses, tuple(joined(pair) for pair in zip(links, rails, strict=True)))
    size = float((bare[:, 1] - bare[:, 0]).max()) or 0.1
    active = {model.getJointId(name) for name in replay.robot.joint_names}
    sizes = [size * _DRUM * (1.0 if k in active else _PASSIVE) for k in range(1, model.njoints)]
    drums = (joined([]), *(joint_solid(model, k + 1, one) for k, one in enumerate(sizes)))
    every = tuple(joined(parts) for parts in zip(links, rails, drums, strict=True))
    return Solids(links, drums, rails, boxes(poses, every))


def boxes(poses: Float[Array, "f J 7"], meshes: tuple[Mesh, ...]) -> Float[Array, "f 2 3"]:
    """Lowest and highest corner [m] of meshes and of the origins of their frames, in each posture.

    Args:
        poses: Poses of the frames from `identification.viewing.replay.link_poses`.
        meshes: Mesh in each frame.
    """
    out = []
    for pose in poses:
        points = [pose[:, :3]]
        for (x, y, z, *wxyz), mesh in zip(pose, meshes, strict=True):
            points.append(moved(mesh, pin.Quaternion(*wxyz).matrix(), np.array([x, y, z])).points)
        every = np.concatenate(points)
        out.append([every.min(axis=0), every.max(axis=0)])
    return np.array(out)


def _rails(model: pin.Model, replay: Replay) -> tuple[Mesh, ...]:
    """Thin rods along the travel of the linear joints, in the frame of the parent joint, for each parent joint."""
    rails: list[list[Mesh]] = [[] for _ in range(model.njoints)]
    for row, name in enumerate(replay.robot.joint_names):
        joint, travel = model.getJointId(name), replay.copies[0].q[:, row]
        axis, linear = joint_axis(model, joint)
        low, high = float(np.nanmin(travel)), float(np.nanmax(travel))
        if linear and high > low:
            place = model.jointPlacements[joint]
            rod = capsule(low * axis, high * axis, _RAIL * (high - low))
            rails[model.parents[joint]].append(moved(rod, place.rotation, place.translation))
    return tuple(joined(one) for one in rails)
