"""Meshes with fewer faces, for drawing: corners in one cell of a grid become one."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from phantom_dyn.shapes.solids import Mesh

Array = np.ndarray

_LEAST_FACES = 24  # a small part still has a shape
_FINEST = 300.0  # cells along the longest side of a mesh at most
_HALVINGS = 12  # of the range of cell sizes: enough for one per cent of the faces
_FLAT = 1e-3  # singular values below this share of the largest say nothing about where a corner lies


def reduced(mesh: Mesh, faces: int) -> Mesh:
    """The mesh with at most ``faces`` triangles, its corners where they keep planes and edges best.

    Corners in one cell of a grid become the point nearest to the planes of their faces; the size of the cells follows
    from the number of faces. Unlike collapsing edges this takes any set of triangles: visual meshes are often neither
    closed nor connected, and collapsing them stops early.

    References:
        P. Lindstrom, Out-of-core simplification of large polygonal models, SIGGRAPH 2000: cells with quadrics.
    """
    side = float(np.ptp(mesh.points, axis=0).max()) if len(mesh.points) else 0.0
    if len(mesh.faces) <= faces or side == 0.0:
        return mesh
    fine, coarse = side / _FINEST, 1.01 * side
    best = Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    for _ in range(_HALVINGS):
        cell = float(np.sqrt(fine * coarse))
        cells, triangles = _clustered(mesh, cell)
        if len(triangles) > faces:
            fine = cell
        else:
            coarse, best = cell, Mesh(_corners(mesh, cells, cell), triangles)
    used, faces_of_used = np.unique(best.faces, return_inverse=True)
    return Mesh(best.points[used], faces_of_used.reshape(-1, 3))


def face_budgets(areas: list[float], counts: list[int], faces: int) -> list[int]:
    """How many faces each part may have: by the root of its surface, never more than it has, ``faces`` in all."""
    own, weight = np.array(counts, dtype=int), np.sqrt(np.array(areas, dtype=float)) + 1e-12
    given = np.minimum(own, min(_LEAST_FACES, faces // max(len(own), 1)))
    for _ in own:
        # What a small part does not need goes to the others.
        open_ = given < own
        left = faces - int(given.sum())
        if left <= 0 or not open_.any():
            break
        share = np.where(open_, weight, 0.0)
        given = np.minimum(own, given + np.floor(left * share / share.sum()).astype(int))
    return given.tolist()


def surface(mesh: Mesh) -> float:
    """Area of all faces [m^2]."""
    return float(0.5 * np.linalg.norm(_normals(mesh), axis=1).sum())


def _clustered(mesh: Mesh, cell: float) -> tuple[Int[Array, " P"], Int[Array, "F 3"]]:
    """Cell of each corner, and the triangles between three different cells, each once."""
    grid = np.floor((mesh.points - mesh.points.min(axis=0)) / cell).astype(np.int64)
    wide = int(grid.max()) + 1
    cells = np.unique(_numbered(grid, wide), return_inverse=True)[1].reshape(-1)
    triangles = cells[mesh.faces]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(_numbered(np.sort(triangles, axis=1), int(cells.max()) + 1), return_index=True)
    return cells, triangles[np.sort(first)]


def _numbered(triples: Int[Array, "N 3"], base: int) -> Int[Array, " N"]:
    """One number for three: sorting rows as such takes many times as long."""
    return (triples[:, 0] * base + triples[:, 1]) * base + triples[:, 2]


def _corners(mesh: Mesh, cells: Int[Array, " P"], cell: float) -> Float[Array, "C 3"]:
    """For each cell the point with the least squared distance to the planes of its faces, weighted by their areas."""
    count = int(cells.max()) + 1
    inside = np.bincount(cells, minlength=count)
    mean = np.column_stack([np.bincount(cells, mesh.points[:, k], count) / inside for k in range(3)])
    normals = _normals(mesh)
    squares = normals[:, :, None] * normals[:, None, :]
    left, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for corner in range(3):
        at = cells[mesh.faces[:, corner]]
        distance = np.einsum("ij,ij->i", normals, mesh.points[mesh.faces[:, corner]] - mean[at])
        np.add.at(left, at, squares)
        np.add.at(right, at, normals * distance[:, None])
    u, s, vt = np.linalg.svd(left)
    inverse = np.where(s > _FLAT * s[:, :1], 1 / np.maximum(s, 1e-300), 0.0)
    shift = np.einsum("nji,nj,nkj,nk->ni", vt, inverse, u, right)
    # Planes that are nearly parallel meet far away: a corner stays near its cell.
    length = np.linalg.norm(shift, axis=1, keepdims=True)
    return mean + shift * np.minimum(1.0, cell / np.maximum(length, 1e-300))


def _normals(mesh: Mesh) -> Float[Array, "F 3"]:
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)
