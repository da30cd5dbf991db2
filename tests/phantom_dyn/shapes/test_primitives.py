from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from phantom_dyn.shapes.meshes import Mesh, ball, box, capsule, cylinder, joined, moved

Z = np.array([0.0, 0.0, 1.0])
SOLIDS = {
    "capsule": capsule(np.zeros(3), np.array([0.3, -0.2, 1.0]), 0.1),
    "ball": ball(np.ones(3), 0.2),
    "cylinder": cylinder(np.array([1.0, 1.0, 0.0]), 2.0, 0.5),
    "box": box(Z, 3.0, 1.0, 2.0),
}


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("name", SOLIDS)
def test_a_solid_is_closed_and_all_its_faces_look_outward(name):
    faces = SOLIDS[name].faces
    edges = Counter((int(f[k]), int(f[(k + 1) % 3])) for f in faces for k in range(3))
    assert set(edges.values()) == {1}
    assert all((b, a) in edges for a, b in edges)
    assert volume(SOLIDS[name]) > 0


@pytest.mark.parametrize(
    ("name", "exact"),
    [
        ("capsule", np.pi * 0.01 * np.sqrt(1.13) + 4 / 3 * np.pi * 0.001),
        ("ball", 4 / 3 * np.pi * 0.008),
        ("cylinder", np.pi * 0.25 * 2),
    ],
)
def test_a_round_solid_has_nearly_the_volume_of_its_closed_form(name, exact):
    assert volume(SOLIDS[name]) == pytest.approx(exact, rel=0.15)
    assert volume(SOLIDS[name]) < exact


def test_a_box_has_its_sides_along_its_axes():
    assert np.ptp(SOLIDS["box"].points, axis=0) == pytest.approx([1.0, 2.0, 3.0])


def test_moving_turns_before_it_shifts():
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    mesh = Mesh(np.array([[1.0, 0, 0]]), np.zeros((0, 3), dtype=int))
    assert moved(mesh, turn, np.array([0, 0, 5.0])).points == pytest.approx(np.array([[0, 1, 5.0]]))


def test_joining_keeps_every_triangle():
    both = joined([SOLIDS["box"], SOLIDS["ball"]])
    assert volume(both) == pytest.approx(volume(SOLIDS["box"]) + volume(SOLIDS["ball"]))


def test_nothing_joined_is_an_empty_mesh():
    assert joined([]).faces.shape == (0, 3)
