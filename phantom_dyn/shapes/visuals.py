# pyright: reportAttributeAccessIssue=false
"""Visual shapes of a robot's file: of URDF through yourdfpy and trimesh, of MJCF through MuJoCo and coal."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Int
from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.shapes.meshes import Mesh, ball, box, capsule, cylinder, joined, moved
from phantom_dyn.shapes.mjcf_shapes import shapes_of_mjcf

# Joint of the whole model that moves a shape, where the shape stands in that joint's frame, and its triangles.
_Shapes = list[tuple[int, pin.SE3, Mesh]]


def visuals(robot: Robot) -> list[tuple[int, Mesh]]:
    """Visual shapes of the robot's file: index of the joint that moves each, triangles in that joint's frame.

    Empty where the file has none, and where a mesh is missing or cannot be read: half a robot misleads.
    """
    try:
        path = find_robot(robot.source)
        full, shapes = _of_urdf(path) if path.suffix == ".urdf" else _of_mjcf(path)
    except Exception:  # readers of meshes raise whatever a broken file makes them; a picture refuses no diagnosis
        return []
    names = list(robot.model.names)
    out = []
    for joint, place, mesh in shapes:
        # Joints that are held fixed are no joints of the robot: their links move with the joint before.
        while joint and full.names[joint] not in names:
            place, joint = full.jointPlacements[joint] * place, full.parents[joint]
        if len(mesh.faces):
            index = names.index(full.names[joint]) if joint else 0
            out.append((index, moved(mesh, place.rotation, place.translation)))
    return out


def _of_urdf(path: Path) -> tuple[pin.Model, _Shapes]:
    full = pin.buildModelFromUrdf(str(path))
    if b"<visual" not in path.read_bytes():
        return full, []
    import yourdfpy  # takes most of a second to load

    parts: dict[str, list[Mesh]] = {}
    scene = yourdfpy.URDF.load(str(path), filename_handler=mesh_finder(path)).scene
    for node in scene.graph.nodes_geometry:
        link = scene.graph.transforms.parents[node]
        place, name = scene.graph.get(node, frame_from=link)
        shape = scene.geometry[name]
        if not len(shape.faces):
            raise RobotError(f"{path.name}: the mesh of {link} holds no triangles.")
        mesh = Mesh(np.array(shape.vertices, dtype=float), np.array(shape.faces, dtype=int))
        # A file may hold a link in dozens of parts, and reduced one by one each of them keeps its least faces.
        parts.setdefault(link, []).append(moved(mesh, place[:3, :3], place[:3, 3]))
    frames = {link: full.frames[full.getFrameId(link, pin.BODY)] for link in parts}
    return full, [(frames[link].parentJoint, frames[link].placement, joined(one)) for link, one in parts.items()]


def mesh_finder(file: Path) -> Callable[[str], str]:
    """Path of a mesh that a URDF names, from the folders above the file and those that ROS's variables name."""

    def found(fname: str) -> str:
        scheme, there, rest = fname.partition("://")
        if there and scheme in ("package", "model"):
            tried = [folder / rest for folder in package_folders(file)]
        else:
            tried = [file.parent / (rest if there else fname)]
        here = next((path for path in tried if path.is_file()), None)
        if here is None:
            raise RobotError(f"{file.name}: the mesh {fname} is not there.")
        return str(here)

    return found


def package_folders(file: Path) -> list[Path]:
    """Where ``package://`` may lead: the folders above the file, and those that ROS's variables name."""
    named = [
        Path(folder) / below
        for variable, below in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share"))
        for folder in os.environ.get(variable, "").split(os.pathsep)
        if folder
    ]
    return [*file.resolve().parents, *named]


def _of_mjcf(path: Path) -> tuple[pin.Model, _Shapes]:
    full, shapes = shapes_of_mjcf(path, "visual")
    return full, [(one.parentJoint, one.placement, _triangles(one.geometry)) for one in shapes.geometryObjects]


def _triangles(geometry: coal.CollisionGeometry) -> Mesh:
    if isinstance(geometry, coal.BVHModelBase):
        return Mesh(np.array(geometry.vertices(), dtype=float), _faces(geometry))
    if isinstance(geometry, coal.Box):
        x, y, z = 2 * np.array(geometry.halfSide)
        return box(np.array([0.0, 0.0, 1.0]), z, x, y)
    if isinstance(geometry, coal.Cylinder):
        return cylinder(np.array([0.0, 0.0, 1.0]), 2 * geometry.halfLength, geometry.radius)
    if isinstance(geometry, coal.Capsule):
        half = np.array([0.0, 0.0, geometry.halfLength])
        return capsule(-half, half, geometry.radius)
    if isinstance(geometry, coal.Sphere):
        return ball(np.zeros(3), geometry.radius)
    return joined([])


def _faces(geometry: coal.BVHModelBase) -> Int[Array, "F 3"]:
    triangles = (geometry.tri_indices(k) for k in range(geometry.num_tris))
    return np.array([(t[0], t[1], t[2]) for t in triangles], dtype=int).reshape(-1, 3)
