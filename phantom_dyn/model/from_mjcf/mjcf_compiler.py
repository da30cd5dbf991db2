# pyright: reportAttributeAccessIssue=false
"""Compiles a MJCF file with MuJoCo, which resolves defaults, frames, includes and inertias of geoms.

Bodies and joints without a name get one. Elements that do not change the dynamics (pictures, sensors, keyframes, meshes
that are only drawn) are removed before the compilation, so that the files of such meshes and pictures may be missing.
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

# Largest number of bodies that <replicate> may make; the largest robots have some hundred.
_MOST_COPIES = 1000
# Largest size of an included file [bytes].
_LARGEST_PART = 64 * 2**20
# Largest depth of files that include other files.
_DEEPEST = 20
# Elements of soft bodies.
_SOFT = ("composite", "flexcomp", "flex")
# Elements of a file that do not change its dynamics.
_NOT_DYNAMIC = ("keys", "sensors", "skins", "pairs", "excludes", "cameras", "lights", "tuples", "numerics", "texts")


def compiled_mjcf(path: Path, root: Element) -> mujoco.MjModel:
    """MuJoCo's model of a file, in which all bodies and joints have names.

    Args:
        path: Path of the file.
        root: Root element of the file.

    Raises:
        RobotError: If MuJoCo refuses the file, or it has soft bodies, too many copies or unusable included files.
    """
    _require_rigid(path, root)
    try:
        with _parsed(path) as spec:
            _take_away(spec, [geom for geom in spec.geoms if _shaped(geom) and not _weighs(spec, geom)])
            return spec.compile()
    except RobotError:
        # Meshes of bodies that never move may be missing, too.
        with _parsed(path) as spec:
            shaped = [geom for geom in spec.geoms if _shaped(geom)]
            _take_away(spec, [geom for geom in shaped if _never_moves(geom.parent) or not _weighs(spec, geom)])
            return spec.compile()


def _shaped(geom: Any) -> bool:
    """True for a geom whose shape is a mesh or a height field."""
    return bool(geom.meshname or geom.hfieldname)


def mjcf_with_shapes(path: Path) -> mujoco.MjModel:
    """MuJoCo's model of a file with all shapes; the files of all meshes must exist.

    Raises:
        RobotError: If MuJoCo refuses the file.
    """
    with _parsed(path) as spec:
        _take_away(spec, [], keep_meshes=True)
        return spec.compile()


def whole_mjcf(path: Path) -> str:
    """Text of a file in which includes and copies are written out and all bodies and joints have names.

    Raises:
        RobotError: If MuJoCo refuses the file.
    """
    with _parsed(path) as spec:
        spec.compile()
        return spec.to_xml()


@contextmanager
def silenced_warnings() -> Iterator[None]:
    """Suppress MuJoCo's warnings, which would appear in the terminal and in MUJOCO_LOG.TXT of the working folder.

    They warn of simulations that diverge, which is visible from their results anyway.
    """
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        # The compiler issues Python warnings about deprecated words.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def _parsed(path: Path) -> Iterator[mujoco.MjSpec]:
    """The parsed file, in which all bodies and joints have names; the errors of MuJoCo become a `RobotError`."""
    import mujoco

    with silenced_warnings():
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            _give_names(spec.bodies, "body")
            _give_names(spec.joints, "joint")
            yield spec
        except Exception as error:  # the bindings raise ValueError, and other errors for missing files
            reason = " ".join(str(error).split()).removeprefix("Error:").strip().rstrip(".")
            raise RobotError(
                f"{path} is not a robot that MuJoCo can read ({shortened(reason, 300)}): correct the file."
            ) from error


def _give_names(elements: Iterable[Any], what: str) -> None:
    """Give each body or joint without a name a name that no other has."""
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
    """True if the inertia of its body includes the inertia of a geom."""
    import mujoco

    rule = spec.compiler.inertiafromgeom
    stated = geom.parent.explicitinertial
    if rule == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE:
        return False
    if rule == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_AUTO and stated:
        return False
    first, last = spec.compiler.inertiagrouprange
    # The mass is NaN if the file does not state it; only NaN differs from itself.
    has_mass = geom.mass > 0 if geom.mass == geom.mass else geom.density > 0
    return bool(first <= geom.group <= last and has_mass and geom.parent.name != "world")


def _never_moves(body: Any) -> bool:
    """True if neither this body nor a body that carries it has a joint."""
    while body is not None and body.name != "world":
        if list(body.joints):
            return False
        body = body.parent
    return True


def _take_away(spec: mujoco.MjSpec, geoms: list[Any], *, keep_meshes: bool = False) -> None:
    """Remove geoms, elements that do not change the dynamics, and meshes and pictures that are not used any more."""
    for geom in geoms:
        spec.delete(geom)
    for group in _NOT_DYNAMIC:
        for element in list(getattr(spec, group)):
            spec.delete(element)
    for element in (*spec.geoms, *spec.sites, *spec.tendons):
        element.material = ""
    used = {geom.meshname for geom in spec.geoms} | {geom.hfieldname for geom in spec.geoms}
    kept = [(mesh, mesh.name or Path(mesh.file).stem) for mesh in (*spec.meshes, *spec.hfields)]
    unused = [] if keep_meshes else [mesh for mesh, name in kept if name not in used]
    for element in [*spec.materials, *spec.textures, *unused]:
        spec.delete(element)
    # MuJoCo would merge bodies without joints into their parents, but their names are needed.
    if hasattr(spec.compiler, "fusestatic"):
        spec.compiler.fusestatic = False


def _require_rigid(path: Path, root: Element) -> None:
    """Refuse soft bodies, too many copies and unusable included files before MuJoCo spends time and memory on them."""
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
    """Elements of a file and of the files that it includes; ``above`` are the files that include this one."""
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
