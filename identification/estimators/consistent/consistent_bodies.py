r"""Which inertial parameters a body can have, as matrices that are linear in them, and where its mass can be.

A body exists exactly if its pseudo-inertia :math:`P = \int [x; 1][x; 1]^T dm` (4 x 4, [Wensing]_) is not negative; its
mass lies in an ellipsoid exactly if besides :math:`\mathrm{tr}(P Q) \ge 0`, and its centre of mass lies in a convex
hull if it is on the inner side of every face. Ellipsoid and hull come from the points of the body's shape.

References:
    .. [Wensing] P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial
       parameter identification, IEEE Robotics and Automation Letters 3(1), 2018. The eigenvalues are checked against
       central inertias in tests/identification/estimators/consistent/test_consistent_bodies.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError, RobotError
from phantom_dyn.model.robot import Robot
from phantom_dyn.shapes.robot_shapes import robot_shapes

_ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # order of the six inertia entries

_FLOOR = 1e-4
"""A reference body counts as at least 1 % as thick as its radius of gyration: files state rods and points, to which no
distance is finite, and vendors' inertias that break the triangle inequality."""

_ALL = 10**9  # faces of a mesh that is not reduced: a reduced one is smaller than the body
_FACES = 200  # more halfspaces than this are replaced by as many that touch the hull from outside
_TOUCHING = 1e-2  # of the squared distance: the ellipsoid is less than 1 % wider than the smallest one
_ITERATIONS = 1000  # most steps towards the smallest ellipsoid


def _pseudo_basis() -> Array:
    basis = np.zeros((10, 4, 4))
    basis[0, 3, 3] = 1.0
    for axis in range(3):
        basis[1 + axis, axis, 3] = basis[1 + axis, 3, axis] = 1.0
    for k, (i, j) in enumerate(_ENTRIES):
        if i == j:
            basis[4 + k, :3, :3] = 0.5 * np.eye(3)
        basis[4 + k, i, j] -= 1.0
        basis[4 + k, j, i] = basis[4 + k, i, j]
    return basis


PSEUDO = _pseudo_basis()
"""Pseudo-inertia per unit of each of the ten parameters, ``(10, 4, 4)``."""


def pseudo_inertia(standard: Float[Array, "*b 10"]) -> Float[Array, "*b 4 4"]:
    """Pseudo-inertia [kg m^2, kg m, kg] from the ten standard parameters about the joint origin.

    Args:
        standard: In the order of `phantom_dyn.model.inertia.STANDARD_NAMES`.
    """
    return np.einsum("...k,kij->...ij", standard, PSEUDO)


def standard_of(pseudo: Float[Array, "4 4"]) -> Float[Array, " 10"]:
    """The ten standard parameters of a pseudo-inertia, inverse of `pseudo_inertia`."""
    second = pseudo[:3, :3]
    inertia = np.trace(second) * np.eye(3) - second
    return np.concatenate([[pseudo[3, 3]], pseudo[:3, 3], [inertia[i, j] for i, j in _ENTRIES]])


@dataclass(frozen=True)
class Region:
    """Where the mass of a body is, in the frame of its joint.

    Attributes:
        center: Of an ellipsoid that holds all of the mass [m], or None for no ellipsoid.
        shape: Of that ellipsoid [m^2]: the points ``x`` with ``(x - center)^T shape^-1 (x - center) <= 1``.
        normals: Outward, of the faces of a hull that holds the centre of mass, shape ``(F, 3)``; empty for no hull.
        offsets: ``normals @ x <= offsets`` inside [m], shape ``(F,)``.
    """

    center: Float[Array, " 3"] | None = None
    shape: Float[Array, "3 3"] | None = None
    normals: Float[Array, "F 3"] | None = None
    offsets: Float[Array, " F"] | None = None

    def __post_init__(self):
        if (self.center is None) != (self.shape is None) or (self.normals is None) != (self.offsets is None):
            raise ParameterError("A region needs center and shape of an ellipsoid, or normals and offsets of a hull.")
        given = [value for value in (self.center, self.shape, self.normals, self.offsets) if value is not None]
        if not all(np.isfinite(value).all() for value in given):
            raise ParameterError("A region holds values that are not finite: give finite lengths.")
        if self.shape is not None and np.linalg.eigvalsh(self.shape)[0] <= 0:
            raise ParameterError("The ellipsoid of a region has an axis of no length: give one with a volume.")

    def rows(self) -> Float[Array, "F 10"]:
        """Left sides of ``rows @ standard >= 0``: of the ellipsoid [kg], then of the faces [kg m]."""
        out = [np.zeros((0, 10))]
        if self.center is not None and self.shape is not None:
            inverse = np.linalg.inv(self.shape)
            form = np.empty((4, 4))
            form[:3, :3] = -inverse
            form[:3, 3] = form[3, :3] = inverse @ self.center
            form[3, 3] = 1 - self.center @ inverse @ self.center
            out.append(np.einsum("kij,ij->k", PSEUDO, form)[None])
        if self.normals is not None and self.offsets is not None:
            faces = np.zeros((len(self.normals), 10))
            faces[:, 0], faces[:, 1:4] = self.offsets, -self.normals
            out.append(faces)
        return np.concatenate(out)


@dataclass(frozen=True)
class ReferenceBody:
    """A body to measure another one by, in units of its own mass and radius of gyration.

    Attributes:
        standard: Its ten parameters, made possible where they are not.
        scale: Unit of each of the ten parameters.
        whitening: ``C^-1`` with ``C C^T`` its pseudo-inertia in those units.
    """

    standard: Float[Array, " 10"]
    scale: Float[Array, " 10"]
    whitening: Float[Array, "4 4"]

    @property
    def metric(self) -> Float[Array, "16 10"]:
        r"""``L`` with :math:`|L d|^2 = |C^{-1} P(d) C^{-T}|_F^2` for a change ``d`` in units of ``scale``."""
        whitened = np.einsum("ai,kij,bj->abk", self.whitening, PSEUDO, self.whitening)
        return whitened.reshape(16, 10)


def reference_body(
    standard: Float[Array, " 10"], *, mass: float | None = None, length: float | None = None
) -> ReferenceBody:
    """How to measure bodies by a given one; eigenvalues that are too small or negative are lifted, see `_FLOOR`.

    Args:
        standard: Its ten parameters.
        mass: Unit of mass [kg]; by default its own, 1 for a body without mass.
        length: Unit of length [m]; by default its radius of gyration about the joint, 0.1 where it has none.
    """
    unit = mass if mass is not None else float(standard[0])
    unit = unit if unit > 0 else 1.0
    squared = max(0.5 * float(standard[4] + standard[6] + standard[9]), 0.0) / unit
    reach = length if length is not None else float(np.sqrt(squared))
    reach = reach if reach > 1e-4 else 0.1
    scale = unit * np.concatenate([[1.0], np.full(3, reach), np.full(6, reach**2)])
    values, vectors = np.linalg.eigh(pseudo_inertia(standard / scale))
    lifted = np.maximum(values, _FLOOR)
    possible = standard_of((vectors * lifted) @ vectors.T) * scale if (values < _FLOOR).any() else standard
    return ReferenceBody(possible, scale, (vectors / np.sqrt(lifted)).T)


def reference_bodies(standard: Float[Array, " p"]) -> tuple[ReferenceBody, ...]:
    """One reference per ten parameters; bodies without mass are measured by the mean of those that have some."""
    bodies = standard.reshape(-1, 10)
    if not np.isfinite(bodies).all():
        raise ParameterError("The parameters of a reference body are not finite: give finite ones.")
    masses = bodies[bodies[:, 0] > 0, 0]
    usual = float(masses.mean()) if len(masses) else 1.0
    return tuple(reference_body(body, mass=float(body[0]) if body[0] > 0 else usual) for body in bodies)


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
    from scipy.spatial import ConvexHull, QhullError

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
