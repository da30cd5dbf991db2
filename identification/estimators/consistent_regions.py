"""Where the mass of a body can be, from the points of its shape: an ellipsoid about all, and their convex hull."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from identification.diagnosis.robot_shapes import robot_shapes
from identification.estimators.consistent_bodies import Region
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.robot import Robot

Array = np.ndarray

_ALL = 10**9  # faces: a reduced mesh is smaller than the body
_FACES = 200  # more halfspaces than this are replaced by as many that touch the hull from outside
_TOUCHING = 1e-2  # of the squared distance: the ellipsoid is less than 1 % wider than the smallest one
_ITERATIONS = 1000


def body_regions(robot: Robot) -> tuple[Region | None, ...]:
    """Region of each body from the visual shapes of the robot's file; None for a body without a shape.

    Raises:
        RobotError: If the file has no shapes that can be read.
    """
    shapes = robot_shapes(robot, _ALL)
    if not shapes.from_meshes:
        raise RobotError(f"{robot.name} has no shapes that can be read: give regions of your own, or none.")
    return tuple(region_of_points(mesh.points) if len(mesh.points) else None for mesh in shapes.links[1:])


def region_of_points(points: Float[Array, "P 3"]) -> Region:
    """The smallest ellipsoid about the points, and their convex hull.

    Args:
        points: In the frame of the joint [m].

    Raises:
        ParameterError: If the points are not finite or span no volume.
    """
    if not np.isfinite(points).all():
        raise ParameterError("The points of a region are not finite: give finite ones.")
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError) as error:
        raise ParameterError(
            f"{len(points)} points span no volume: give at least four that are not in one plane."
        ) from error
    corners = points[hull.vertices]
    # Triangles of one flat face have one equation; rounding makes them differ in the last digits.
    faces = np.unique(np.round(hull.equations, 9), axis=0)
    normals, offsets = faces[:, :3], -faces[:, 3]
    if len(faces) > _FACES:
        normals = _directions(_FACES)
        offsets = (corners @ normals.T).max(axis=0)
    center, shape = bounding_ellipsoid(corners)
    return Region(center, shape, normals, offsets)


def bounding_ellipsoid(points: Float[Array, "P 3"]) -> tuple[Float[Array, " 3"], Float[Array, "3 3"]]:
    """Center [m] and shape [m^2] of an ellipsoid that holds all points, hardly wider than the smallest one.

    Args:
        points: At least four that span a volume [m].

    References:
        .. [Khachiyan] L. G. Khachiyan, Rounding of polytopes in the real number model of computation, Mathematics of
           Operations Research 21(2), 1996. Checked against cube, box and simplex in closed form.
    """
    lifted = np.column_stack([points, np.ones(len(points))])
    weights = np.full(len(points), 1 / len(points))
    for _ in range(_ITERATIONS):
        far = np.sum(lifted @ np.linalg.inv(lifted.T * weights @ lifted) * lifted, axis=1)
        best = int(far.argmax())
        if far[best] <= 4 * (1 + _TOUCHING):
            break
        step = (far[best] / 4 - 1) / (far[best] - 1)
        weights *= 1 - step
        weights[best] += step
    center = weights @ points
    away = points - center
    shape = 3 * (away.T * weights @ away)
    # Just wide enough for the last corner that is outside.
    reach = np.sum(away @ np.linalg.inv(shape) * away, axis=1).max()
    return center, shape * reach * (1 + 1e-12)


def _directions(count: int) -> Array:
    """Unit vectors spread evenly over the sphere (golden spiral), and the axes."""
    k = np.arange(count - 6) + 0.5
    height, angle = 1 - 2 * k / (count - 6), np.pi * (1 + 5**0.5) * k
    round_ = np.sqrt(1 - height**2)
    spiral = np.column_stack([round_ * np.cos(angle), round_ * np.sin(angle), height])
    return np.concatenate([spiral, np.eye(3), -np.eye(3)])
