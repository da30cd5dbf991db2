"""Shapes kept from run to run. Oracle: the shapes that are made without a cache."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from phantom_dyn.model.loading import load_robot
from phantom_dyn.shapes import robot_shapes as made
from phantom_dyn.shapes.meshes import Mesh, box
from phantom_dyn.shapes.robot_shapes import KEPT, Shapes, keep, robot_shapes


@pytest.fixture
def no_reader(monkeypatch) -> None:
    """Meshes that are read after this are none."""
    monkeypatch.setattr(made, "visuals", lambda _: [])


def same(found: Shapes, wanted: Shapes) -> bool:
    pairs = list(zip(found.links, wanted.links, strict=True))
    equal = all(
        np.array_equal(one.points, other.points) and np.array_equal(one.faces, other.faces) for one, other in pairs
    )
    return equal and found.from_meshes == wanted.from_meshes


def test_the_second_time_the_same_shapes_come_from_the_cache(arm, request):
    first = robot_shapes(load_robot(arm))
    request.getfixturevalue("no_reader")
    assert same(robot_shapes(load_robot(arm)), first)


@pytest.mark.parametrize("other", ["mesh", "robot", "held", "faces"])
def test_what_is_kept_is_not_taken_for_something_else(arm, request, other):
    robot_shapes(load_robot(arm))
    mesh = arm.parents[1] / "meshes" / "t.stl"
    if other == "mesh":
        mesh.write_text(mesh.read_text().replace("vertex 0 0 1", "vertex 0 0 3"))
    elif other == "robot":
        arm.write_text(arm.read_text().replace("2 2 2", "3 3 3"))
    elif other == "held":
        (arm.parent / "robot.yaml").write_text("lock: [grip]")
    request.getfixturevalue("no_reader")
    assert not robot_shapes(load_robot(arm), 100 if other == "faces" else 2000).from_meshes


def test_a_mesh_that_is_gone_gives_capsules_though_its_shape_is_kept(arm):
    robot_shapes(load_robot(arm))
    (arm.parents[1] / "meshes" / "t.stl").unlink()
    assert not robot_shapes(load_robot(arm)).from_meshes


@pytest.mark.parametrize("length", [0, 10, 700])
def test_half_a_file_is_made_anew(arm, cache, length):
    first = robot_shapes(load_robot(arm))
    (file,) = cache.iterdir()
    whole = file.read_bytes()
    file.write_bytes(whole[:length])
    assert same(robot_shapes(load_robot(arm)), first)
    assert len(file.read_bytes()) == len(whole)


def test_a_cache_that_cannot_be_written_to_stops_nothing(arm, tmp_path):
    (tmp_path / "cache").write_text("no folder")
    assert robot_shapes(load_robot(arm)).from_meshes


def test_meshes_that_name_further_files_are_not_kept(arm, cache):
    (arm.parents[1] / "meshes" / "t.stl").rename(arm.parents[1] / "meshes" / "t.gltf")
    arm.write_text(arm.read_text().replace("t.stl", "t.gltf"))
    robot_shapes(load_robot(arm))
    assert not cache.exists()


def test_capsules_are_not_kept(arm, cache):
    (arm.parents[1] / "meshes" / "t.stl").write_text("no mesh")
    robot_shapes(load_robot(arm))
    assert not cache.exists()


def test_the_oldest_files_go(cache):
    cube: Mesh = box(np.array([0.0, 0.0, 1.0]), 1.0, 1.0)
    for k in range(KEPT + 2):
        keep(cache / f"{k}.npz", [cube])
        os.utime(cache / f"{k}.npz", (k, k))
    assert {Path(one).name for one in cache.iterdir()} == {f"{k}.npz" for k in range(2, KEPT + 2)}
