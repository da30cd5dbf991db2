# pyright: reportAttributeAccessIssue=false
"""The shape of a robot as triangles: its visual meshes reduced to a budget of faces, or capsules along its links.

Visual shapes are read from a URDF with yourdfpy and trimesh, from an MJCF with MuJoCo and coal. Loading and reducing
meshes takes a second, so reduced ones are kept from run to run in the user's cache. The name of a file there is a hash
of all that its content follows from: the robot's file, its meshes, the libraries that read and reduce them. So it is
never out of date; what cannot be read, or written, is computed again.
"""

from __future__ import annotations

import hashlib
import os
import secrets
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal
from xml.etree import ElementTree
from zipfile import BadZipFile

import coal
import numpy as np
import pinocchio as pin
import platformdirs

from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.errors import RobotError
from phantom_dyn.model.from_mjcf.mjcf_compiler import mjcf_with_shapes
from phantom_dyn.model.from_mjcf.mjcf_tree import pose_of, tree_of_mjcf
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.shapes.meshes import Mesh, ball, box, capsule, cylinder, face_budgets, joined, moved, reduced, surface

if TYPE_CHECKING:
    import mujoco

_SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = 2, 3, 4, 5, 6, 7
"""Of mjtGeom."""
_SEEN = 2
"""Groups that MuJoCo's viewer shows at first are 0 to this one."""


def shapes_of_mjcf(path: Path, use: Literal["visual", "collision"]) -> tuple[pin.Model, pin.GeometryModel]:
    """The whole model of a MJCF and its shapes; planes and tables of heights are left out.

    Args:
        path: The file.
        use: What is seen, or what touches.

    Raises:
        RobotError: If MuJoCo refuses the file, as where a mesh is missing.
    """
    compiled = mjcf_with_shapes(path)
    model, shapes = tree_of_mjcf(compiled), pin.GeometryModel()
    for k in range(compiled.ngeom):
        touches = bool(compiled.geom_contype[k] or compiled.geom_conaffinity[k])
        wanted = touches if use == "collision" else int(compiled.geom_group[k]) <= _SEEN
        geometry = _geometry(compiled, k) if wanted else None
        if geometry is None:
            continue
        body = compiled.body(int(compiled.geom_bodyid[k])).name
        frame = 0 if body == "world" else model.getFrameId(body, pin.FrameType.BODY)
        owner = model.frames[frame]
        place = owner.placement * pose_of(compiled.geom_pos[k], compiled.geom_quat[k])
        name = compiled.geom(k).name or f"{body}_{k}"
        shapes.addGeometryObject(pin.GeometryObject(name, owner.parentJoint, frame, place, geometry))
    return model, shapes


def _geometry(compiled: mujoco.MjModel, k: int) -> coal.CollisionGeometry | None:
    kind, (x, y, z) = int(compiled.geom_type[k]), compiled.geom_size[k].tolist()
    if kind == _SPHERE:
        return coal.Sphere(x)
    if kind == _CAPSULE:
        return coal.Capsule(x, 2 * y)
    if kind == _CYLINDER:
        return coal.Cylinder(x, 2 * y)
    if kind == _BOX:
        return coal.Box(2 * x, 2 * y, 2 * z)
    if kind == _ELLIPSOID:
        return coal.Ellipsoid(x, y, z)
    return _mesh(compiled, int(compiled.geom_dataid[k])) if kind == _MESH else None


def _mesh(compiled: mujoco.MjModel, mesh: int) -> coal.CollisionGeometry:
    first, count = int(compiled.mesh_vertadr[mesh]), int(compiled.mesh_vertnum[mesh])
    start, faces = int(compiled.mesh_faceadr[mesh]), int(compiled.mesh_facenum[mesh])
    out = coal.BVHModelOBBRSS()
    out.beginModel(faces, count)
    out.addVertices(np.array(compiled.mesh_vert[first : first + count], dtype=float))
    out.addTriangles(np.array(compiled.mesh_face[start : start + faces], dtype=np.uint32))
    out.endModel()
    return out


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


FACES = 2000
"""Triangles of a whole robot by default: a drawing in a report stays small."""
_WIDTH = 0.018
"""Radius of a capsule, relative to the reach of the robot."""
_SHORT = 1e-3
"""Length [m] below which a link has no direction to draw a capsule along."""
_POINT = 0.05
"""Radius [m] of a robot that has no length at all."""
KEPT = 50
"""Files that are kept, of a tenth of a megabyte each: the last ones written."""
_WHOLE = (".dae", ".obj", ".stl")
"""Endings of meshes that are one file; others may name further files, which no hash would see."""
_READERS = ("trimesh", "yourdfpy")
_NAMES = ("points", "faces", "last_points", "last_faces")


@dataclass(frozen=True)
class Shapes:
    """Triangles of a robot, each in the frame of the joint that moves them.

    Attributes:
        links: One mesh per joint of Pinocchio's model, the first that of the fixed base; empty where there is none.
        from_meshes: True if they are the visual shapes of the robot's file, False for capsules.
    """

    links: tuple[Mesh, ...]
    from_meshes: bool


def robot_shapes(robot: Robot, faces: int = FACES) -> Shapes:
    """Visual shapes of the robot's file with at most ``faces`` triangles in all; capsules where there are none.

    A mesh file that is missing, or that cannot be read, takes capsules for the whole robot: half a robot misleads.
    Reduced meshes are kept for the next time.
    """
    place = place_of(robot, faces)
    links = kept(place)
    if links is not None:
        return Shapes(links, True)
    shapes = _reduced_shapes(robot, faces)
    if shapes.from_meshes:
        keep(place, shapes.links)
    return shapes


def _reduced_shapes(robot: Robot, faces: int) -> Shapes:
    parts = visuals(robot)
    from_meshes = bool(parts)
    if not parts:
        parts = [(joint, mesh) for joint, mesh in enumerate(capsules(robot.model)) if len(mesh.faces)]
    budgets = face_budgets([surface(mesh) for _, mesh in parts], [len(mesh.faces) for _, mesh in parts], faces)
    links: list[list[Mesh]] = [[] for _ in range(robot.model.njoints)]
    for (joint, mesh), budget in zip(parts, budgets, strict=True):
        links[joint].append(reduced(mesh, budget))
    return Shapes(tuple(joined(meshes) for meshes in links), from_meshes)


def capsules(model: pin.Model) -> tuple[Mesh, ...]:
    """A capsule from each joint to those that it carries, and to the tip or centre of mass of the last ones."""
    ends = [_ends(model, joint) for joint in range(model.njoints)]
    reach = np.zeros(model.njoints)
    for joint in range(1, model.njoints):
        reach[joint] = reach[model.parents[joint]] + np.linalg.norm(model.jointPlacements[joint].translation)
    longest = max(far + float(np.linalg.norm(end)) for far, link in zip(reach, ends, strict=True) for end in link)
    radius = _WIDTH * longest if longest > _SHORT else _POINT
    links = []
    for joint, link in enumerate(ends):
        solids = [capsule(np.zeros(3), end, radius) for end in link if np.linalg.norm(end) > _SHORT]
        # A linear joint without length is its own carriage, see `joint_solid`.
        if joint and not solids and not joint_axis(model, joint)[1]:
            solids = [ball(np.zeros(3), radius)]
        links.append(joined(solids))
    return tuple(links)


def joint_axis(model: pin.Model, joint: int) -> tuple[Float[Array, "3"], bool]:
    """Axis of a joint in its own frame, and whether it is linear."""
    twist = np.asarray(model.joints[joint].createData().S, dtype=float).reshape(6)
    linear = bool(np.linalg.norm(twist[:3]) > 0)
    return (twist[:3] if linear else twist[3:]), linear


def joint_solid(model: pin.Model, joint: int, size: float) -> Mesh:
    """Shape that marks a joint: a drum along the axis of a revolute one, a bar along that of a linear one.

    Args:
        model: Pinocchio's model.
        joint: Its index, from 1 on.
        size: Size of the robot [m].

    Returns:
        Triangles in the frame of the joint.
    """
    axis, linear = joint_axis(model, joint)
    return box(axis, 0.16 * size, 0.06 * size) if linear else cylinder(axis, 0.11 * size, 0.036 * size)


def _ends(model: pin.Model, joint: int) -> list[Float[Array, "3"]]:
    """Where the link of a joint leads, in the joint's frame."""
    children = [k for k in range(1, model.njoints) if model.parents[k] == joint]
    if children or joint == 0:
        return [np.array(model.jointPlacements[k].translation) for k in children]
    frames = [np.array(f.placement.translation) for f in model.frames if f.parentJoint == joint]
    far = max(frames, key=lambda end: float(np.linalg.norm(end)), default=np.zeros(3))
    # Many files end with the last joint: the mass then says where the link goes.
    centre = 2 * np.array(model.inertias[joint].lever)
    return [far if np.linalg.norm(far) >= np.linalg.norm(centre) else centre]


def place_of(robot: Robot, faces: int) -> Path | None:
    """Where the shapes of a robot with a budget of faces are kept, whether they are there or not.

    None where the files that they follow from are not all known: a model that is no URDF, a mesh that is missing.
    """
    from importlib.metadata import version

    folder = platformdirs.user_cache_path("phantom-dyn") / "shapes"
    try:
        file = find_robot(robot.source)
        if file.suffix != ".urdf" or not folder.is_absolute():
            return None
        content, find = file.read_bytes(), mesh_finder(file)
        named = [mesh for visual in ElementTree.fromstring(content).iter("visual") for mesh in visual.iter("mesh")]
        meshes = [Path(find(mesh.get("filename", ""))) for mesh in named]
        if any(mesh.suffix.lower() not in _WHOLE for mesh in meshes):
            return None
        code = sorted(Path(__file__).parent.glob("*.py"))
        parts = [content, *(one.read_bytes() for one in (*code, *meshes))]
        made_by = (faces, list(robot.model.names), [version(name) for name in _READERS])
    except (OSError, RobotError, ElementTree.ParseError, ModuleNotFoundError):
        return None
    digests = [hashlib.sha256(part).hexdigest() for part in (repr(made_by).encode(), *parts)]
    return folder / f"{hashlib.sha256(' '.join(digests).encode()).hexdigest()}.npz"


def kept(place: Path | None) -> tuple[Mesh, ...] | None:
    """Meshes that `keep` has written; None where there are none that can be read."""
    if place is None:
        return None
    try:
        with place.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
            points, faces, last_points, last_faces = (file[name] for name in _NAMES)
    except (OSError, ValueError, KeyError, EOFError, BadZipFile):
        return None
    pairs = zip(np.split(points, last_points), np.split(faces, last_faces), strict=True)
    return tuple(Mesh(*pair) for pair in pairs)


def keep(place: Path | None, meshes: Sequence[Mesh]) -> None:
    """Write meshes where `kept` finds them; a cache that cannot be written to is left as it is."""
    if place is None:
        return
    points, faces = ([getattr(mesh, name) for mesh in meshes] for name in _NAMES[:2])
    lasts = (np.cumsum([len(one) for one in parts])[:-1] for parts in (points, faces))
    arrays = dict(zip(_NAMES, (np.concatenate(points), np.concatenate(faces), *lasts), strict=True))
    temporary = place.with_suffix(f".{secrets.token_hex(4)}.tmp")
    with suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        # Another run sees the whole file or none.
        temporary.replace(place)
        for old in sorted(place.parent.iterdir(), key=lambda one: one.stat().st_mtime)[:-KEPT]:
            old.unlink()
