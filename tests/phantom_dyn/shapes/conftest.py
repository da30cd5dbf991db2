"""A robot with a mesh, and a cache of its own for every test."""

from pathlib import Path

import platformdirs
import pytest

TETRAHEDRON = """solid t
facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 0 1 0\nvertex 1 0 0\nendloop\nendfacet
facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 0 1\nendloop\nendfacet
facet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 0 0 1\nvertex 0 1 0\nendloop\nendfacet
facet normal 0 0 0\nouter loop\nvertex 1 0 0\nvertex 0 1 0\nvertex 0 0 1\nendloop\nendfacet
endsolid t
"""
ARM = """<robot name="arm">
<link name="base"><visual><geometry><box size="0.2 0.4 0.6"/></geometry></visual></link>
<link name="upper"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><origin xyz="0 0 0.5"/><geometry><mesh filename="{mesh}" scale="2 2 2"/></geometry></visual></link>
<link name="hand"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<visual><geometry><sphere radius="0.1"/></geometry></visual></link>
<joint name="pan" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="grip" type="prismatic"><parent link="upper"/><child link="hand"/><origin xyz="0 0 3"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture
def arm(tmp_path) -> Path:
    """A robot whose mesh lies in a package beside it."""
    (tmp_path / "arm_package" / "meshes").mkdir(parents=True)
    (tmp_path / "arm_package" / "meshes" / "t.stl").write_text(TETRAHEDRON)
    file = tmp_path / "arm_package" / "urdf" / "arm.urdf"
    file.parent.mkdir()
    file.write_text(ARM.format(mesh="package://arm_package/meshes/t.stl"))
    return file


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch) -> Path:
    """Where shapes are kept: not in the cache of whoever runs the tests."""
    monkeypatch.setattr(platformdirs, "user_cache_path", lambda name: tmp_path / "cache" / name)
    return tmp_path / "cache" / "phantom-dyn" / "shapes"
