# pyright: reportAttributeAccessIssue=false
"""Copies the shapes of a URDF into an MJCF: boxes, cylinders, spheres, and meshes that MuJoCo can load.

Visual shapes are in group 2 and have no contacts. Collision shapes are in group 3 (in group 2 if a link has no visual
shape), and have contacts with objects of a scene but not with each other: convex hulls of neighbouring links overlap,
and contact forces between them would be wrong.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pinocchio as pin

from identification.export.model_files.reload import mujoco_problem
from identification.export.model_files.urdf_file import attribute_text, placement
from phantom_dyn.errors import RobotError, listed
from phantom_dyn.model.inertia import body_name
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_xml import Element, read_root
from phantom_dyn.shapes.robot_shapes import mesh_finder

_MESHES = (".obj", ".stl", ".msh")
"""Endings of the meshes that MuJoCo reads."""
_VISUAL = {"group": "2", "contype": "0", "conaffinity": "0"}
_COLLISION = {"group": "3", "contype": "1", "conaffinity": "0"}


@dataclass(frozen=True)
class Shape:
    """One shape of a link.

    Attributes:
        link: Name of the link.
        visual: True for a visual shape, False for a collision shape.
        geom: Attributes of the geom (type, size, colour) without its placement.
        place: Placement in the link's frame.
        mesh: File and scale of a mesh; None for a primitive.
    """

    link: str
    visual: bool
    geom: dict[str, str]
    place: pin.SE3
    mesh: tuple[Path, str] | None = None


def with_urdf_shapes(text: str, robot: Robot, file: Path, folder: Path | None) -> tuple[str, tuple[str, ...]]:
    """Adds the shapes of the robot's URDF to the text of an MJCF.

    Args:
        text: Text of the MJCF, without shapes.
        robot: The robot in the MJCF.
        file: The URDF.
        folder: Folder of the MJCF, to which paths of meshes are relative; None for absolute paths.

    Returns:
        The new text, and sentences on the shapes that are left out.
    """
    shapes, missing = _shapes(file)
    shapes = [shape for shape in shapes if robot.model.existFrame(shape.link, pin.BODY)]
    if not shapes and not missing:
        return text, ()
    root = ElementTree.fromstring(text)
    bodies = {str(body.get("name")): body for body in root.iter("body")}
    world = root.find("worldbody")
    assert world is not None
    trunk = world.find("body[freejoint]")
    ground = world if trunk is None else trunk
    assets: dict[tuple[Path, str], str] = {}
    shown = {shape.link for shape in shapes if shape.visual}
    for shape in shapes:
        frame = robot.model.frames[robot.model.getFrameId(shape.link, pin.BODY)]
        owner = bodies[body_name(robot, frame.parentJoint)] if frame.parentJoint else ground
        place = frame.placement * shape.place
        turn = pin.Quaternion(place.rotation).normalized()
        geom = {**(_VISUAL if shape.visual else _COLLISION), **shape.geom, "mass": "0"}
        if not shape.visual and shape.link not in shown:
            geom["group"] = _VISUAL["group"]
        if shape.mesh is not None:
            geom["mesh"] = assets.setdefault(shape.mesh, f"{shape.mesh[0].stem}_{len(assets)}")
        geom |= {"pos": attribute_text(place.translation), "quat": attribute_text([turn.w, turn.x, turn.y, turn.z])}
        ElementTree.SubElement(owner, "geom", geom)
    _add_assets(root, assets, folder)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n", _sentences(missing)


def _shapes(file: Path) -> tuple[list[Shape], dict[str, str]]:
    """Shapes of all links that MuJoCo can load, and the reason for each mesh that MuJoCo cannot load."""
    root, _ = read_root(file)
    find, out, missing = mesh_finder(file), [], {}
    colours = {str(one.get("name")): _colour(one) for one in root.findall("material")}
    problems: dict[tuple[Path, str], str] = {}
    for link in root.findall("link"):
        for element in (*link.findall("visual"), *link.findall("collision")):
            visual, kind = element.tag == "visual", element.find("geometry/*")
            if kind is None:
                continue
            geom, mesh = _primitive(kind), None
            if kind.tag == "mesh":
                name, scale = str(kind.get("filename")), kind.get("scale", "1 1 1")
                try:
                    mesh = (Path(find(name)).resolve(), scale)
                except RobotError:
                    missing[name] = "does not exist"
                    continue
                if mesh not in problems:
                    problems[mesh] = _load_problem(*mesh)
                if problems[mesh]:
                    missing[name] = problems[mesh]
                    continue
                geom = {"type": "mesh"}
            if geom is None:
                continue
            material = element.find("material")
            rgba = None if material is None else _colour(material) or colours.get(str(material.get("name")))
            geom |= {"rgba": rgba} if visual and rgba else {}
            out.append(Shape(str(link.get("name")), visual, geom, placement(element.find("origin")), mesh))
    return out, missing


def _primitive(kind: Element) -> dict[str, str] | None:
    """Type and size of a geom; None if the shape is a mesh or unknown."""
    if kind.tag == "box":
        return {"type": "box", "size": attribute_text([0.5 * side for side in _numbers(kind.get("size", ""))])}
    if kind.tag == "sphere":
        return {"type": "sphere", "size": attribute_text(_numbers(kind.get("radius", "")))}
    if kind.tag == "cylinder":
        (radius,), (length,) = _numbers(kind.get("radius", "")), _numbers(kind.get("length", ""))
        return {"type": "cylinder", "size": attribute_text([radius, 0.5 * length])}
    return None


def _load_problem(mesh: Path, scale: str) -> str:
    """The reason why MuJoCo cannot load a mesh; empty if MuJoCo can, or is not installed."""
    if mesh.suffix.lower() not in _MESHES:
        return f"ends in {mesh.suffix or 'nothing'}"
    if mujoco_problem():
        return ""
    import mujoco

    root = ElementTree.Element("mujoco")
    _add_assets(root, {(mesh, scale): "mesh"}, None)
    world = ElementTree.SubElement(root, "worldbody")
    ElementTree.SubElement(world, "geom", {**_VISUAL, "type": "mesh", "mesh": "mesh", "mass": "0"})
    try:
        mujoco.MjModel.from_xml_string(ElementTree.tostring(root, encoding="unicode"))
    except ValueError as error:
        return f"is refused ({' '.join(str(error).split())[:120]})"
    return ""


def _add_assets(root: Element, meshes: dict[tuple[Path, str], str], folder: Path | None) -> None:
    """Adds an ``<asset>`` that names each mesh, given by file and scale."""
    if not meshes:
        return
    assets = ElementTree.SubElement(root, "asset")
    for (path, scale), name in meshes.items():
        place = str(path) if folder is None else os.path.relpath(path, folder.resolve())
        ElementTree.SubElement(assets, "mesh", name=name, file=place, scale=scale)


_VERBS = (("ends", "end"), ("does", "do"), ("is", "are"))
"""Verbs with which the reasons begin: singular for one mesh, plural for several."""


def _sentences(missing: dict[str, str]) -> tuple[str, ...]:
    """One sentence for each reason, with the names of the meshes that are left out for this reason."""
    out = []
    for reason in dict.fromkeys(missing.values()):
        names = [Path(name).name for name, why in missing.items() if why == reason]
        shown = listed(names) if len(names) <= 3 else f"{', '.join(names[:3])} and {len(names) - 3} more"
        verb, plural = next(pair for pair in _VERBS if reason.startswith(pair[0]))
        single = len(names) == 1
        why = f"it {reason}" if single else f"they {plural}{reason.removeprefix(verb)}"
        hint = f": convert {'it' if single else 'them'} to .obj or .stl" if verb == "ends" else ""
        out.append(f"It is without {shown} of the URDF, which MuJoCo cannot load, as {why}{hint}.")
    return tuple(out)


def _colour(material: Element) -> str | None:
    """The ``rgba`` of a URDF material; None if the material has no colour of its own."""
    colour = material.find("color")
    return None if colour is None else colour.get("rgba")


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split()]
