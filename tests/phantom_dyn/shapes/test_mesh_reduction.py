from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phantom_dyn.shapes.meshes import Mesh, box, face_budgets, reduced, surface


def grid_sphere(n: int = 60) -> Mesh:
    """A sphere of radius one with about 2 n^2 faces."""
    polar, turn = np.meshgrid(np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, 2 * n), indexing="ij")
    points = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    k = np.arange(2 * n * n).reshape(n, 2 * n)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    return Mesh(points.reshape(-1, 3), np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))


def fine_cube(n: int = 20) -> Mesh:
    """The surface of a cube of side one, each face of 2 n^2 triangles with corners of their own."""
    u, w = np.meshgrid(np.linspace(-0.5, 0.5, n + 1), np.linspace(-0.5, 0.5, n + 1), indexing="ij")
    k = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = k[:-1, :-1].ravel(), k[1:, :-1].ravel(), k[1:, 1:].ravel(), k[:-1, 1:].ravel()
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    sides = []
    for axis in range(3):
        for sign in (-0.5, 0.5):
            flat = np.insert(np.column_stack([u.ravel(), w.ravel()]), axis, sign, axis=1)
            sides.append(flat)
    points = np.concatenate(sides)
    return Mesh(points, np.concatenate([faces + (n + 1) ** 2 * s for s in range(6)]))


def test_a_reduced_mesh_keeps_to_its_budget_and_uses_most_of_it():
    assert 200 <= len(reduced(grid_sphere(), 300).faces) <= 300


def test_a_reduced_sphere_is_still_the_sphere():
    small = reduced(grid_sphere(), 300)
    assert np.linalg.norm(small.points, axis=1) == pytest.approx(1.0, abs=0.05)
    assert surface(small) == pytest.approx(4 * np.pi, rel=0.06)


def test_a_reduced_cube_keeps_its_corners_and_its_planes():
    small = reduced(fine_cube(), 150)
    assert np.abs(small.points).max(axis=1) == pytest.approx(0.5, abs=1e-9)
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    nearest = np.linalg.norm(small.points[None] - corners[:, None], axis=2).min(axis=1)
    assert nearest == pytest.approx(0.0, abs=1e-6)


def test_no_triangle_of_a_reduced_mesh_is_there_twice():
    faces = np.sort(reduced(fine_cube(), 100).faces, axis=1)
    assert len(np.unique(faces, axis=0)) == len(faces)


def test_a_mesh_within_its_budget_stays_as_it_is():
    mesh = box(np.array([0.0, 0, 1]), 1, 1)
    assert reduced(mesh, 12) is mesh


def test_loose_triangles_are_reduced_too(rng):
    points = rng.standard_normal((3000, 3))
    loose = Mesh(points, np.arange(3000).reshape(-1, 3))
    assert 0 < len(reduced(loose, 100).faces) <= 100


@given(
    parts=st.lists(st.tuples(st.floats(0, 10), st.integers(1, 5000)), min_size=1, max_size=40),
    faces=st.integers(100, 5000),
)
def test_budgets_stay_below_the_sum_and_below_what_each_part_has(parts, faces):
    areas, counts = [list(column) for column in zip(*parts, strict=True)]
    given_ = face_budgets(areas, counts, faces)
    assert sum(given_) <= faces
    assert all(0 < g <= count for g, count in zip(given_, counts, strict=True))


def test_what_small_parts_do_not_need_goes_to_the_others():
    assert face_budgets([1.0, 1.0], [12, 5000], 1000)[1] > 950
