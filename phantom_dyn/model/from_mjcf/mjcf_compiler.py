# pyright: reportAttributeAccessIssue=false
"""A MJCF file as MuJoCo compiles it: defaults, frames, includes and inertias of geoms are MuJoCo's own.

Names are given to bodies and joints that have none. What has no part in the dynamics (pictures, sensors, keyframes,
meshes that are only seen) is taken away before the file is compiled, so that it may be missing.
"""

from __future__ import annotations

import stat
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

from phantom_dyn.errors import RobotError, shortened
from phantom_dyn.model.robot_xml import Element

if TYPE_CHECKING:
    import mujoco

_MOST_COPIES = 1000
"""Bodies that <replicate> may make: the longest robots have some hundred."""
_LARGEST_PART = 64 * 2**20
"""Bytes of a file that an MJCF includes."""
_DEEPEST = 20
"""Files that include one another."""
_SOFT = ("composite", "flexcomp", "flex")
"""Elements of soft bodies."""
_UNSEEN = ("keys", "sensors", "skins", "pairs", "excludes", "cameras", "lights", "tuples", "numerics", "texts")
"""Elements of a file that move nothing."""


def compiled_mjcf(path: Path, root: Element) -> mujoco.MjModel:
    """MuJoCo's model of a file; bodies and joints without a name have one.

    Args:
        path: The file.
        root: Root element of the file.

    Raises:
        RobotError: If MuJoCo refuses it, or it holds soft bodies, thousands of copies or files that are none.
    """
    _require_rigid(path, root)
    with unheard_warnings():
        spec = _named(path)
        try:
            _take_away(spec, (geom for geom in spec.geoms if _shaped(geom) and not _weighs(spec, geom)))
            return spec.compile()
        except Exception as error:  # the bindings raise ValueError, and others for files that are missing
            first = error
        # Meshes of what never moves may be missing, too.
        spec = _named(path)
        if not any(_shaped(geom) and _never_moves(geom.parent) for geom in spec.geoms):
            raise _refused(path, first) from first
        try:
            _take_away(spec, (g for g in spec.geoms if _shaped(g) and (_never_moves(g.parent) or not _weighs(spec, g))))
            return spec.compile()
        except Exception as error:
            raise _refused(path, error) from error


def _shaped(geom: Any) -> bool:
    """True for a geom whose shape comes from a mesh or a table of heights."""
    return bool(geom.meshname or geom.hfieldname)


def mjcf_with_shapes(path: Path) -> mujoco.MjModel:
    """As `compiled_mjcf`, with all its shapes: their meshes have to be there.

    Raises:
        RobotError: If MuJoCo refuses it.
    """
    with unheard_warnings():
        spec = _named(path)
        try:
            _take_away(spec, (), keep_meshes=True)
            return spec.compile()
        except Exception as error:
            raise _refused(path, error) from error


def whole_mjcf(path: Path) -> str:
    """The text of a file with all that it includes, copies and leaves without a name written out.

    Raises:
        RobotError: If MuJoCo refuses it.
    """
    with unheard_warnings():
        spec = _named(path)
        try:
            spec.compile()
            return spec.to_xml()
        except Exception as error:
            raise _refused(path, error) from error


@contextmanager
def unheard_warnings() -> Iterator[None]:
    """Keep MuJoCo's warnings from the terminal, and from the MUJOCO_LOG.TXT that it writes into the working folder.

    What they warn of, a simulation that runs away, shows in what comes out of it.
    """
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        # The compiler warns in Python, of words that a later version will not know.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        mujoco.set_mju_user_warning(before)


def _named(path: Path) -> mujoco.MjSpec:
    """The file as MuJoCo parses it, every body and joint with a name."""
    import mujoco

    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except Exception as error:
        raise _refused(path, error) from error
    _give_names(spec.bodies, "body")
    _give_names(spec.joints, "joint")
    return spec


def _give_names(elements: Iterable[Any], what: str) -> None:
    elements = list(elements)
    taken = {element.name for element in elements}
    for element in [one for one in elements if not one.name]:
        owner = element.parent.name if element.parent is not None else ""
        stem = f"{owner}_{what}" if what == "joint" or owner not in ("", "world") else what
        name, number = stem, 1
        while name in taken:
            number += 1
            name = f"{stem}_{number}"
        taken.add(name)
        element.name = name


def _weighs(spec: mujoco.MjSpec, geom: Any) -> bool:
    """True if a geom counts in the inertia of its body."""
    import mujoco

    rule = spec.compiler.inertiafromgeom
    stated = geom.parent.explicitinertial
    if rule == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE:
        return False
    if rule == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO and stated:
        return False
    first, last = spec.compiler.inertiagrouprange
    has_mass = geom.mass > 0 if geom.mass == geom.mass else geom.density > 0
    return bool(first <= geom.group <= last and has_mass and geom.parent.name != "world")


def _never_moves(body: Any) -> bool:
    while body is not None and body.name != "world":
        if list(body.joints):
            return False
        body = body.parent
    return True


def _take_away(spec: mujoco.MjSpec, geoms: Iterable[Any], *, keep_meshes: bool = False) -> None:
    """Remove geoms, all that moves nothing, and the meshes and pictures that are then without a use."""
    for geom in list(geoms):
        spec.delete(geom)
    for group in _UNSEEN:
        for element in list(getattr(spec, group)):
            spec.delete(element)
    for element in (*spec.geoms, *spec.sites, *spec.tendons):
        element.material = ""
    used = {geom.meshname for geom in spec.geoms} | {geom.hfieldname for geom in spec.geoms}
    kept = [(mesh, mesh.name or Path(mesh.file).stem) for mesh in (*spec.meshes, *spec.hfields)]
    unused = [] if keep_meshes else [mesh for mesh, name in kept if name not in used]
    for element in [*spec.materials, *spec.textures, *unused]:
        spec.delete(element)
    # Friends of a body lose nothing by being written one by one, and their names are needed.
    if hasattr(spec.compiler, "fusestatic"):
        spec.compiler.fusestatic = False


def _refused(path: Path, error: Exception) -> RobotError:
    reason = " ".join(str(error).split()).removeprefix("Error:").strip().rstrip(".")
    return RobotError(f"{path} is not a robot that MuJoCo can read ({shortened(reason, 300)}): correct the file.")


def _require_rigid(path: Path, root: Element) -> None:
    """Refuse soft bodies, endless copies, and included files that are none; MuJoCo would take time and memory first."""
    copies = 1
    for element in _whole(path, root, ()):
        if element.tag in _SOFT:
            raise RobotError(f"{path} uses <{element.tag}>, a soft body, and only rigid ones are taken: leave it out.")
        if element.tag == "replicate":
            count = element.get("count", "1")
            copies *= int(count) if count.isascii() and count.isdigit() and len(count) < 9 else 10**9
            if copies > _MOST_COPIES:
                raise RobotError(f"{path}: <replicate> makes more than {_MOST_COPIES} copies: write fewer.")
        if element.tag == "plugin":
            raise RobotError(f"{path} uses <plugin>, whose code is not read: leave it out.")


def _whole(path: Path, root: Element, above: tuple[Path, ...]) -> Iterator[Element]:
    """Elements of a file and of those that it includes."""
    if path in above or len(above) > _DEEPEST:
        raise RobotError(f"{path} includes itself: take the <include> out.")
    for element in root.iter():
        yield element
        if element.tag == "include" or (element.tag == "model" and element.get("file")):
            name = element.get("file", "")
            part = path.parent / name
            try:
                found = part.stat()
            except (OSError, ValueError):
                raise RobotError(f"{path} needs the file {shortened(name)!r}, which is not there.") from None
            if not stat.S_ISREG(found.st_mode) or found.st_size > _LARGEST_PART:
                raise RobotError(f"{path} needs {shortened(name)!r}, which is no file, or too large: give a MJCF file.")
            try:
                inner = ElementTree.parse(part).getroot()
            except (ElementTree.ParseError, ValueError, LookupError) as problem:
                raise RobotError(f"{part} is not valid XML, or is cut off ({problem}): give a whole file.") from problem
            yield from _whole(part, inner, (*above, path))
