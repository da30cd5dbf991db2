"""Simple solids as triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

Array = np.ndarray

SIDES = 14


@dataclass(frozen=True)
class Mesh:
    """Triangles.

    Attributes:
        points: Corners [m], ``(P, 3)``.
        faces: Indices of three corners each, ``(F, 3)``.
    """

    points: Float[Array, "P 3"]
    faces: Int[Array, "F 3"]


def joined(meshes: Sequence[Mesh]) -> Mesh:
    """All the triangles in one mesh."""
    if not meshes:
        return Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int))
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    return Mesh(np.concatenate([mesh.points for mesh in meshes]), np.concatenate(faces))


def moved(mesh: Mesh, rotation: Float[Array, "3 3"], translation: Float[Array, "3"]) -> Mesh:
    """The mesh turned, then shifted."""
    return Mesh(mesh.points @ np.asarray(rotation).T + np.asarray(translation), mesh.faces)


def capsule(start: Float[Array, "3"], end: Float[Array, "3"], radius: float) -> Mesh:
    """A cylinder with round ends from one point to another, hollow nowhere."""
    axis = end - start
    length = float(np.linalg.norm(axis))
    round_ = np.array([0.0, 0.5, 0.87])  # sine of 0, 30 and 60 degrees
    heights = np.concatenate([-round_[::-1] * radius, length + round_ * radius])
    radii = np.sqrt(1 - np.concatenate([round_[::-1], round_]) ** 2) * radius
    mesh = _turned(heights, radii, -radius, length + radius)
    return moved(mesh, _frame(axis), start)


def ball(centre: Float[Array, "3"], radius: float) -> Mesh:
    """A sphere."""
    return capsule(centre, centre + 1e-9, radius)


def cylinder(axis: Float[Array, "3"], length: float, radius: float) -> Mesh:
    """A cylinder along an axis, its middle in the origin."""
    mesh = _turned(np.array([-length / 2, length / 2]), np.full(2, radius), -length / 2, length / 2)
    return moved(mesh, _frame(axis), np.zeros(3))


def box(axis: Float[Array, "3"], length: float, width: float, depth: float | None = None) -> Mesh:
    """A box along an axis, its middle in the origin; as deep as wide unless said otherwise."""
    z, x, y = length, width, width if depth is None else depth
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))])
    return moved(Mesh(signs * np.array([x, y, z]) / 2, faces), _frame(axis), np.zeros(3))


def _turned(heights: Float[Array, " R"], radii: Float[Array, " R"], bottom: float, top: float) -> Mesh:
    """A solid of revolution about z: rings of corners, closed by a point at either end."""
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
    """A rotation whose z is the axis; for the z axis itself, the identity."""
    length = np.linalg.norm(axis)
    z = axis / length if length > 1e-8 else np.array([0, 0, 1.0])
    helper = np.array([1.0, 0, 0]) if abs(z[0]) < 0.9 else np.array([0, 1.0, 0])
    x = helper - z * (helper @ z)
    x = x / np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
