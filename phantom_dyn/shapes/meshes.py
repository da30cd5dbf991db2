"""Makes simple solids as triangle meshes, and simplifies meshes to a number of faces."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float, Int

SIDES = 14
"""Number of corners of a circle."""
# Number of faces that even a small part gets, so that its shape stays visible.
_LEAST_FACES = 24
# Largest number of cells along the longest side of a mesh.
_MOST_CELLS = 300.0
# Number of bisection steps for the cell size; the number of faces is then accurate to one per cent.
_HALVINGS = 12
# Odd factors of a hash of three numbers.
_HASH_FACTORS = (0x1E3779B97F4A7C15, 0x3F58476D1CE4E5B9, 0x14D049BB133111EB)
# Smallest singular value, over the largest, with which the planes determine the position of a corner in a direction.
_SMALLEST_SINGULAR_VALUE = 1e-3


@dataclass(frozen=True)
class Mesh:
    """Triangle mesh.

    Attributes:
        points: Corners [m], ``(P, 3)``.
        faces: Indices of three corners each, ``(F, 3)``.
    """

    points: Float[Array, "P 3"]
    faces: Int[Array, "F 3"]


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """Join the triangles of all meshes in one mesh."""
    if not meshes:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.points for mesh in meshes]), np.concatenate(faces))


def moved(mesh: Mesh, rotation: Float[Array, "3 3"], translation: Float[Array, "3"]) -> Mesh:
    """Rotate the mesh, then translate it."""
    return Mesh(mesh.points @ np.asarray(rotation).T + np.asarray(translation), mesh.faces)


def capsule(start: Float[Array, "3"], end: Float[Array, "3"], radius: float) -> Mesh:
    """A cylinder with round ends from one point to another."""
    axis = end - start
    length = float(np.linalg.norm(axis))
    sines = np.array([0.0, 0.5, 0.87])  # of 0, 30 and 60 degrees
    heights = np.concatenate([-sines[::-1] * radius, length + sines * radius])
    radii = np.sqrt(1 - np.concatenate([sines[::-1], sines]) ** 2) * radius
    mesh = _solid_of_revolution(heights, radii, -radius, length + radius)
    return moved(mesh, _frame(axis), start)


def ball(centre: Float[Array, "3"], radius: float) -> Mesh:
    """A sphere."""
    return capsule(centre, centre + 1e-9, radius)


def cylinder(axis: Float[Array, "3"], length: float, radius: float) -> Mesh:
    """A cylinder along an axis, centred at the origin."""
    mesh = _solid_of_revolution(np.array([-length / 2, length / 2]), np.full(2, radius), -length / 2, length / 2)
    return moved(mesh, _frame(axis), np.zeros(3))


def box(axis: Float[Array, "3"], length: float, width: float, depth: float | None = None) -> Mesh:
    """A box along an axis, centred at the origin; without ``depth`` it is as deep as it is wide."""
    z, x, y = length, width, width if depth is None else depth
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))])
    return moved(Mesh(signs * np.array([x, y, z]) / 2, faces), _frame(axis), np.zeros(3))


def reduced(mesh: Mesh, faces: int) -> Mesh:
    """Simplify the mesh to at most ``faces`` triangles.

    All corners in one cell of a grid become one point, the nearest to the planes of their faces. The size of the cells
    is found by bisection from the number of faces. The usual method of collapsing edges would need a closed, connected
    mesh, which visual meshes often are not.

    References:
        P. Lindstrom, Out-of-core simplification of large polygonal models, SIGGRAPH 2000: cells with quadrics.
    """
    side = float(np.ptp(mesh.points, axis=0).max()) if len(mesh.points) else 0.0
    if len(mesh.faces) <= faces or side == 0.0:
        return mesh
    fine, coarse = side / _MOST_CELLS, 1.01 * side
    points = np.ascontiguousarray((mesh.points - mesh.points.min(axis=0)).T)
    corners = np.ascontiguousarray(mesh.faces.T)
    for _ in range(_HALVINGS):
        cell = float(np.sqrt(fine * coarse))
        if _remaining_faces(points, corners, cell) > faces:
            fine = cell
        else:
            coarse = cell
    cells, triangles = _clustered(mesh, coarse)
    used, faces_of_used = np.unique(triangles, return_inverse=True)
    return Mesh(_corners(mesh, cells, coarse)[used], faces_of_used.reshape(-1, 3))


def face_budgets(areas: list[float], counts: list[int], faces: int) -> list[int]:
    """Number of faces for each part, in proportion to the square root of its area; no part gets more than it has.

    Args:
        areas: Area of each part.
        counts: Number of faces that each part has.
        faces: Number of faces of all parts together.
    """
    own, weight = np.array(counts, dtype=int), np.sqrt(np.array(areas, dtype=float)) + 1e-12
    given = np.minimum(own, min(_LEAST_FACES, faces // max(len(own), 1)))
    for _ in own:
        # Faces that small parts do not need are distributed again over the other parts.
        incomplete = given < own
        undistributed = faces - int(given.sum())
        if undistributed <= 0 or not incomplete.any():
            break
        share = np.where(incomplete, weight, 0.0)
        given = np.minimum(own, given + np.floor(undistributed * share / share.sum()).astype(int))
    return given.tolist()


def surface(mesh: Mesh) -> float:
    """Area of all faces [m^2]."""
    return float(0.5 * np.linalg.norm(_normals(mesh), axis=1).sum())


def _solid_of_revolution(heights: Float[Array, " R"], radii: Float[Array, " R"], bottom: float, top: float) -> Mesh:
    """A solid of revolution about z: rings of corners, and a point at each end."""
    angle = np.arange(SIDES) * 2 * np.pi / SIDES
    circle = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)])
    rings = [circle * radius + [0, 0, height] for height, radius in zip(heights, radii, strict=True)]
    points = np.concatenate([*rings, [[0, 0, bottom], [0, 0, top]]])
    k, after = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    faces = []
    for ring in range(len(heights) - 1):
        low, high = ring * SIDES, (ring + 1) * SIDES
        faces += [np.column_stack([low + k, low + after, high + k])]
        faces += [np.column_stack([low + after, high + after, high + k])]
    last = (len(heights) - 1) * SIDES
    south, north = np.full(SIDES, len(points) - 2), np.full(SIDES, len(points) - 1)
    faces += [np.column_stack([south, after, k]), np.column_stack([last + k, last + after, north])]
    return Mesh(points, np.concatenate(faces))


def _frame(axis: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """A rotation matrix whose third column is the direction of the axis."""
    length = np.linalg.norm(axis)
    z = axis / length if length > 1e-8 else np.array([0, 0, 1.0])
    helper = np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, 1.0, 0])
    x = helper - z * (helper @ z)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _clustered(mesh: Mesh, cell: float) -> tuple[Int[Array, " P"], Int[Array, "F 3"]]:
    """Cell of each corner, and each triangle between three different cells once."""
    grid = np.floor((mesh.points - mesh.points.min(axis=0)) / cell).astype(np.int64)
    wide = int(grid.max()) + 1
    cells = np.unique(_triple_number(grid, wide), return_inverse=True)[1].reshape(-1)
    triangles = cells[mesh.faces]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(_triple_number(np.sort(triangles, axis=1), int(cells.max()) + 1), return_index=True)
    return cells, triangles[np.sort(first)]


def _remaining_faces(points: Float[Array, "3 P"], corners: Int[Array, "3 F"], cell: float) -> int:
    """Number of triangles that `_clustered` would return; no coordinate of ``points`` [m] is negative."""
    x, y, z = np.floor(points / cell).astype(np.int64)
    wide = int(points.max() / cell) + 1
    a, b, c = ((x * wide + y) * wide + z)[corners]
    low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    middle = a + b + c - low - high
    # Sorting one hash is many times as fast as sorting three cells. Two triangles practically never have the same hash.
    number = low * _HASH_FACTORS[0] + middle * _HASH_FACTORS[1] + high * _HASH_FACTORS[2]
    number = np.sort(number[(low < middle) & (middle < high)])
    return int(np.count_nonzero(np.diff(number))) + min(len(number), 1)


def _triple_number(triples: Int[Array, "N 3"], base: int) -> Int[Array, " N"]:
    """A distinct number for each triple: sorting numbers is many times as fast as sorting rows."""
    return (triples[:, 0] * base + triples[:, 1]) * base + triples[:, 2]


def _corners(mesh: Mesh, cells: Int[Array, " P"], cell: float) -> Float[Array, "C 3"]:
    """Point of each cell with the smallest area-weighted sum of squared distances to the planes of its faces."""
    count = int(cells.max()) + 1
    inside = np.bincount(cells, minlength=count)
    mean = np.column_stack([np.bincount(cells, mesh.points[:, k], count) / inside for k in range(3)])
    normals, corners = _normals(mesh), mesh.faces.T
    cell_of_corner = cells[corners.ravel()]
    distance = np.einsum("ij,kij->ki", normals, mesh.points[corners] - mean[cells[corners]])

    def summed(values: Float[Array, "3 F"]) -> Float[Array, " C"]:
        return np.bincount(cell_of_corner, values.ravel(), count)

    # Normal equations ``left shift = right`` of each cell.
    left, right = np.empty((count, 3, 3)), np.empty((count, 3))
    for j in range(3):
        right[:, j] = summed(normals[:, j] * distance)
        for k in range(j + 1):
            left[:, j, k] = left[:, k, j] = summed(np.tile(normals[:, j] * normals[:, k], (3, 1)))
    u, s, vt = np.linalg.svd(left)
    inverse = np.where(s > _SMALLEST_SINGULAR_VALUE * s[:, :1], 1 / np.maximum(s, 1e-300), 0.0)
    shift = np.einsum("nji,nj,nkj,nk->ni", vt, inverse, u, right)
    # Almost parallel planes intersect far away, so the distance to the cell's mean is limited.
    length = np.linalg.norm(shift, axis=1, keepdims=True)
    return mean + shift * np.minimum(1.0, cell / np.maximum(length, 1e-300))


def _normals(mesh: Mesh) -> Float[Array, "F 3"]:
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)
