# pyright: reportAttributeAccessIssue=false
"""Reduced meshes of robots, kept from run to run in the user's cache: to load and reduce them takes a second.

A file is named after all that its content follows from: the robot's file, its meshes, what reads and what reduces them.
So it is never out of date; what cannot be read, or written, is made anew. Nothing but speed depends on it.
"""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from xml.etree import ElementTree
from zipfile import BadZipFile

import numpy as np
import platformdirs

from phantom_dyn.errors import RobotError
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import find_robot
from phantom_dyn.shapes.meshes import Mesh
from phantom_dyn.shapes.visuals import mesh_finder

KEPT = 50
"""Files that are kept, of a tenth of a megabyte each: the last ones written."""
_WHOLE = (".dae", ".obj", ".stl")
"""Endings of meshes that are one file; others may name further files, which no hash would see."""
_READERS = ("trimesh", "yourdfpy")
_NAMES = ("points", "faces", "last_points", "last_faces")


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
