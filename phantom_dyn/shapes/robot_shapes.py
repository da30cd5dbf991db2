# pyright: reportAttributeAccessIssue=false
"""The shape of a robot as triangles: its simplified visual meshes, or capsules along its links.

Visual shapes are read from a URDF with yourdfpy and trimesh, from an MJCF with MuJoCo and coal. Loading and simplifying
meshes takes a second, so the result is written to the user's cache. The name of a cached file is a hash of the robot's
file, its meshes, this code and the versions of the libraries that read meshes, so that it is never out of date. If it
cannot be read, the shapes are computed again.
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

# Values of MuJoCo's mjtGeom.
_SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = 2, 3, 4, 5, 6, 7
# Last group of geoms that MuJoCo's viewer shows when it starts.
_LAST_VISIBLE_GROUP = 2


def shapes_of_mjcf(path: Path, use: Literal["visual", "collision"]) -> tuple[pin.Model, pin.GeometryModel]:
    """Pinocchio's model of an MJCF and its shapes, without planes and height fields.

    Args:
        path: The file.
        use: Whether to return the visual shapes or the collision shapes.

    Raises:
        RobotError: If MuJoCo refuses the file, for example because a mesh is missing.
    """
    compiled = mjcf_with_shapes(path)
    model, shapes = tree_of_mjcf(compiled), pin.GeometryModel()
    for k in range(compiled.ngeom):
        collides = bool(compiled.geom_contype[k] or compiled.geom_conaffinity[k])
        wanted = collides if use == "collision" else int(compiled.geom_group[k]) <= _LAST_VISIBLE_GROUP
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


# For each shape: the joint of the file's model that moves the shape, its pose in the frame of this joint, triangles.
_Shapes = list[tuple[int, pin.SE3, Mesh]]


def visuals(robot: Robot) -> list[tuple[int, Mesh]]:
    """Visual shapes of the robot's file, each with the index of its joint; triangles are in the frame of this joint.

    The list is empty if the file has no visual shapes. It is also empty if one mesh cannot be read, because a picture
    of half a robot would mislead.
    """
    try:
        path = find_robot(robot.source)
        full, shapes = _of_urdf(path) if path.suffix == ".urdf" else _of_mjcf(path)
    except Exception:  # mesh readers raise many types of errors, and a diagnosis must not fail because of a picture
        return []
    names = list(robot.model.names)
    out = []
    for joint, place, mesh in shapes:
        # A joint that is held fixed is not in the robot's model: its link moves with the parent joint.
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
        # Parts of a link are joined, because a link may have dozens of parts, each of which would keep a smallest
        # number of faces.
        parts.setdefault(link, []).append(moved(mesh, place[:3, :3], place[:3, 3]))
    frames = {link: full.frames[full.getFrameId(link, pin.BODY)] for link in parts}
    return full, [(frames[link].parentJoint, frames[link].placement, joined(one)) for link, one in parts.items()]


def mesh_finder(file: Path) -> Callable[[str], str]:
    """A function that returns the path of a mesh file for its name in a URDF, see `package_folders`."""

    def found(fname: str) -> str:
        scheme, separator, rest = fname.partition("://")
        if separator and scheme in ("package", "model"):
            tried = [folder / rest for folder in package_folders(file)]
        else:
            tried = [file.parent / (rest if separator else fname)]
        existing = next((path for path in tried if path.is_file()), None)
        if existing is None:
            raise RobotError(f"{file.name}: the mesh {fname} is not there.")
        return str(existing)

    return found


def package_folders(file: Path) -> list[Path]:
    """Folders in which ``package://`` is looked up: those above the file, and those in the variables of ROS."""
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
"""Default number of triangles of a whole robot, which keeps a drawing in a report small."""
# Radius of a capsule as a share of the robot's reach.
_CAPSULE_RADIUS = 0.018
# A link shorter than this [m] has no capsule, because it has no direction.
_SHORTEST_LINK = 1e-3
# Radius [m] of the capsules of a robot without length.
_RADIUS_WITHOUT_LENGTH = 0.05
KEPT = 50
"""Number of cached files; each has about a tenth of a megabyte."""
# Formats whose meshes are one file; others may refer to further files, which the hash would not contain.
_SINGLE_FILES = (".dae", ".obj", ".stl")
_READERS = ("trimesh", "yourdfpy")
_NAMES = ("points", "faces", "last_points", "last_faces")


@dataclass(frozen=True)
class Shapes:
    """Triangles of a robot, in the frame of the joint that moves them.

    Attributes:
        links: One mesh for each joint of Pinocchio's model, the first for the fixed base; a mesh may be empty.
        from_meshes: True if they are the visual shapes of the robot's file, False for capsules.
    """

    links: tuple[Mesh, ...]
    from_meshes: bool


def robot_shapes(robot: Robot, faces: int = FACES) -> Shapes:
    """Visual shapes of the robot's file with at most ``faces`` triangles in all, or capsules if it has none.

    If one mesh is missing or cannot be read, the whole robot is drawn with capsules, because a picture of half a robot
    would mislead. Simplified meshes are written to the cache.
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
    """Capsules from each joint to its child joints; from the last joint, to its tip or beyond its centre of mass."""
    ends = [_ends(model, joint) for joint in range(model.njoints)]
    reach = np.zeros(model.njoints)
    for joint in range(1, model.njoints):
        reach[joint] = reach[model.parents[joint]] + np.linalg.norm(model.jointPlacements[joint].translation)
    longest = max(far + float(np.linalg.norm(end)) for far, link in zip(reach, ends, strict=True) for end in link)
    radius = _CAPSULE_RADIUS * longest if longest > _SHORTEST_LINK else _RADIUS_WITHOUT_LENGTH
    links = []
    for joint, link in enumerate(ends):
        solids = [capsule(np.zeros(3), end, radius) for end in link if np.linalg.norm(end) > _SHORTEST_LINK]
        # A linear joint without length needs no ball: `joint_solid` draws it as a bar.
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
    """Shape that marks a joint: a cylinder along a revolute axis, a bar along a linear axis.

    Args:
        model: Pinocchio's model.
        joint: Index of the joint, from 1.
        size: Size of the robot [m].

    Returns:
        Triangles in the frame of the joint.
    """
    axis, linear = joint_axis(model, joint)
    return box(axis, 0.16 * size, 0.06 * size) if linear else cylinder(axis, 0.11 * size, 0.036 * size)


def _ends(model: pin.Model, joint: int) -> list[Float[Array, "3"]]:
    """End points of the link that a joint moves, in the joint's frame."""
    children = [k for k in range(1, model.njoints) if model.parents[k] == joint]
    if children or joint == 0:
        return [np.array(model.jointPlacements[k].translation) for k in children]
    frames = [np.array(f.placement.translation) for f in model.frames if f.parentJoint == joint]
    far = max(frames, key=lambda end: float(np.linalg.norm(end)), default=np.zeros(3))
    # Many files have no frame beyond the last joint. Then the link ends at twice the distance of its centre of mass.
    centre = 2 * np.array(model.inertias[joint].lever)
    return [far if np.linalg.norm(far) >= np.linalg.norm(centre) else centre]


def place_of(robot: Robot, faces: int) -> Path | None:
    """Path of the cached shapes of a robot with at most ``faces`` triangles, whether the file exists or not.

    None if the shapes may depend on unknown files: the robot is not a URDF, or a mesh is missing or of another format.
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
        if any(mesh.suffix.lower() not in _SINGLE_FILES for mesh in meshes):
            return None
        code = sorted(Path(__file__).parent.glob("*.py"))
        parts = [content, *(one.read_bytes() for one in (*code, *meshes))]
        made_by = (faces, list(robot.model.names), [version(name) for name in _READERS])
    except (OSError, RobotError, ElementTree.ParseError, ModuleNotFoundError):
        return None
    digests = [hashlib.sha256(part).hexdigest() for part in (repr(made_by).encode(), *parts)]
    return folder / f"{hashlib.sha256(' '.join(digests).encode()).hexdigest()}.npz"


def kept(place: Path | None) -> tuple[Mesh, ...] | None:
    """Meshes from the cache, where `keep` has written them; None if there are none, or they cannot be read."""
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
    """Write meshes to the cache, and delete its oldest files; errors are ignored."""
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
        # A file that is written under another name and renamed is never read half written by another process.
        temporary.replace(place)
        for old in sorted(place.parent.iterdir(), key=lambda one: one.stat().st_mtime)[:-KEPT]:
            old.unlink()
