# pyright: reportAttributeAccessIssue=false
"""Computes distances between bodies of a robot that must not touch, from convex hulls of its collision shapes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from identification.excitation.closable import configurations_in, ordinary_postures, solved_numerically
from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot, position_limits
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.number_checks import require_not_negative
from phantom_dyn.random_streams import random_stream
from phantom_dyn.shapes.robot_shapes import shapes_of_mjcf

CLEARANCE = 0.01
"""Default distance between bodies [m], which allows for tracking errors."""
_POSTURES = 100  # number of random postures in which pairs that touch by design are found
_NEAR = 0.05  # pairs farther apart than the clearance plus this [m] have no effect on the motion
_TOUCHING_BY_DESIGN = 0.5
"""A pair touches by design (for example, shapes that overlap at a joint) if it touches in more than this share of
random postures."""


@dataclass(frozen=True)
class Collisions:
    """Pairs of bodies that must stay ``clearance`` [m] apart.

    Attributes:
        shapes: Convex shapes with their pairs.
        clearance: Smallest distance [m].
        notes: Sentences on shapes that are not checked.
    """

    shapes: pin.GeometryModel
    clearance: float = CLEARANCE
    notes: tuple[str, ...] = ()

    def __post_init__(self):
        require_not_negative(clearance=self.clearance)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each pair."""
        objects = self.shapes.geometryObjects
        return tuple(f"{objects[p.first].name} and {objects[p.second].name}" for p in self.shapes.collisionPairs)


def collisions_of(robot: Robot, *, clearance: float = CLEARANCE) -> Collisions:
    """Pairs of bodies of a robot that are not neighbours, from the collision shapes of its file.

    If the file has no shapes, or a mesh is missing, there are no pairs, and a note says so.

    Args:
        robot: The robot with its file.
        clearance: Smallest distance between bodies [m].
    """
    model, out = robot.model, pin.GeometryModel()
    try:
        full, shapes = _shapes(find_robot(robot.source))
    except (ValueError, RuntimeError) as problem:
        reason = str(problem).partition("\n")[0].strip().rstrip(".")
        return Collisions(out, clearance, (f"Collisions are not checked, as the shapes cannot be read ({reason}).",))
    names = list(model.names)
    for shape in shapes.geometryObjects:
        joint, placement = shape.parentJoint, shape.placement
        # Locked joints are not in the robot's model: their links are fixed to the joint before them.
        while joint and full.names[joint] not in names:
            placement, joint = full.jointPlacements[joint] * placement, full.parents[joint]
        index = names.index(full.names[joint]) if joint else 0
        out.addGeometryObject(pin.GeometryObject(shape.name, index, placement, _hull(shape.geometry)))
    if not len(out.geometryObjects):
        return Collisions(out, clearance, (f"{robot.name} has no collision shapes: collisions are not checked.",))
    return Collisions(_with_pairs(robot, out), clearance)


def distances(
    model: pin.Model, collisions: Collisions, configuration: Float[Array, "N nq"], *, slopes: bool
) -> tuple[Float[Array, "N m"], Float[Array, "N m nt"] | None]:
    """Distance of each pair [m], negative for overlap, and derivatives of small distances by the tree's positions.

    Args:
        model: The tree.
        collisions: Shapes with their pairs.
        configuration: Pinocchio's configurations, shape ``(N, nq)``.
        slopes: True to compute derivatives.

    Returns:
        Distances, and their derivatives (None without ``slopes``), which are zero for distances without effect.
    """
    shapes = collisions.shapes
    data, placed = model.createData(), shapes.createData()
    pairs = [(pair.first, pair.second) for pair in shapes.collisionPairs]
    joints = [shape.parentJoint for shape in shapes.geometryObjects]
    out = np.empty((len(configuration), len(pairs)))
    # Sample, pair, and sign of one body of the pair: its motion along the normal, from the first body to the second,
    # reduces the distance if it is the first body, and increases the distance if it is the second.
    near: list[tuple[int, int, float]] = []
    points, normals, jacobians = [], [], []
    for k, q in enumerate(configuration):
        pin.computeDistances(model, data, shapes, placed, q)
        out[k] = [result.min_distance for result in placed.distanceResults]
        close = np.flatnonzero(out[k] < collisions.clearance + _NEAR).tolist() if slopes else []
        if close:
            pin.computeJointJacobians(model, data, q)
        for m in close:
            result, (first, second) = placed.distanceResults[m], pairs[m]
            sides = ((-1.0, first, result.getNearestPoint1()), (1.0, second, result.getNearestPoint2()))
            for side, body, point in sides:
                if joints[body]:
                    near.append((k, m, side))
                    points.append(np.array(point))
                    normals.append(np.array(result.normal))  # a copy, as the next sample overwrites it
                    jacobians.append(pin.getJointJacobian(model, data, joints[body], pin.ReferenceFrame.WORLD))
    if not slopes:
        return out, None
    slope = np.zeros((*out.shape, model.nv))
    if near:
        n = np.array(normals)
        along = np.concatenate([n, np.cross(np.array(points), n)], axis=1)
        rows = np.einsum("ri,rij->rj", along, np.array(jacobians))
        samples, which, sides = (np.array(part) for part in zip(*near, strict=True))
        np.add.at(slope, (samples, which), sides[:, None] * rows)
    return out, slope


def _shapes(path: Path) -> tuple[pin.Model, pin.GeometryModel]:
    """Model of a robot's file with all its joints, and the collision shapes."""
    if path.suffix == ".urdf":
        full = pin.buildModelFromUrdf(str(path))
        folders = [str(folder) for folder in path.resolve().parents]
        return full, pin.buildGeomFromUrdf(full, str(path), pin.COLLISION, package_dirs=folders)
    return shapes_of_mjcf(path, "collision")


def _hull(geometry: coal.CollisionGeometry) -> coal.CollisionGeometry:
    """Convex hull of a mesh: distances are fast to compute, and never larger than those of the mesh."""
    if isinstance(geometry, coal.BVHModelBase):
        geometry.buildConvexRepresentation(False)
        return geometry.convex
    return geometry


def _with_pairs(robot: Robot, shapes: pin.GeometryModel) -> pin.GeometryModel:
    """The shapes with all pairs, except neighbours and pairs that touch by design."""
    model = robot.model
    joints = [shape.parentJoint for shape in shapes.geometryObjects]
    for i in range(len(joints)):
        for j in range(i + 1, len(joints)):
            a, b = joints[i], joints[j]
            if a != b and model.parents[a] != b and model.parents[b] != a:
                shapes.addCollisionPair(pin.CollisionPair(i, j))
    if solved_numerically(robot):
        reached = configurations_in(robot, ordinary_postures(robot))
    else:
        q = random_stream("postures that may collide").uniform(-np.pi, np.pi, (_POSTURES, robot.nv))
        q[:, np.asarray(robot.prismatic)] *= 0.1
        reached = robot.configuration(np.clip(q, *position_limits(robot)))
    touching = distances(model, Collisions(shapes), reached, slopes=False)[0] < 0
    for pair, often in zip(list(shapes.collisionPairs), touching.mean(axis=0) > _TOUCHING_BY_DESIGN, strict=True):
        if often:
            shapes.removeCollisionPair(pin.CollisionPair(pair.first, pair.second))
    return shapes
