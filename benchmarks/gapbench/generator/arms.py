"""The robots that are not drawn link by link: the PHANToM as a closed chain, and two arms of example-robot-data."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from importlib import metadata
from pathlib import Path

import numpy as np

from ..makes import MissingPackage
from .robots import GRAVITY, Link, Pin, Table, Vector3

L1, L2, L3, L5, L6 = 0.215, 0.170, 0.0325, -0.0368, 0.0527  # [m]
ROTOR = 1.08e-6 * 11.6**2  # [kg m2]: motor of axes 2 and 3 through its gear; taken for axis 1 too
ARMS = {"six": "ur_description/urdf/ur5_robot.urdf", "panda": "panda_description/urdf/panda.urdf"}
POSTURES = {"six": (0.0, -1.1, 1.2, -0.4, 0.8, 0.0), "panda": (0.0, -0.4, 0.0, -1.8, 0.0, 1.7, 0.6)}


def phantom() -> Table:
    """The PHANToM 1.5: base, arm BE with forearm A, arm DF with the parallel link C, whose pin closes the loop.

    Segment inertias of BE and DF are those about the joint less the rotor's, moved to the centre of mass.
    """
    x, y, zero = (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 0.0)
    none = (0.0, 0.0, 0.0)
    links = (
        Link("theta1", zero, y, 0.6, (0.0, -0.03, 0.0), (8e-4, 11.87e-4 - ROTOR, 8e-4, *none), rotor_inertia=ROTOR),
        Link("theta2", zero, x, 0.2359, (0.0, 0.0, L5), (6.4421e-4, 6.8653e-4, 0.591e-4, *none), parent=0),
        Link("elbow", (0.0, 0.0, L1), x, 0.0202, (0.0, -L2 / 2, 0.0), (4.864e-5, 1.843e-7, 4.864e-5, *none), parent=1),
        Link("theta3", zero, x, 0.1906, (0.0, L6, 0.0), (3.6324e-5, 6.29e-5, 9.5249e-5, *none), parent=0),
        Link("crank", (0.0, -L3, 0.0), x, 0.0249, (0.0, 0.0, L1 / 2), (9.59e-5, 9.59e-5, 5.1e-7, *none), parent=3),
    )
    links = tuple(replace(one, rotor_inertia=ROTOR) if one.joint in ("theta2", "theta3") else one for one in links)
    passive = (
        ("elbow", (("theta3", 1.0), ("theta2", -1.0))),
        ("crank", (("theta2", 1.0), ("theta3", -1.0))),
    )
    pins = (Pin(4, (0.0, 0.0, L1), 2),)
    return Table("phantom", links, gravity=(0.0, -GRAVITY, 0.0), passive=passive, pins=pins)


def _numbers(element: ET.Element | None, name: str) -> Vector3:
    text = element.get(name) if element is not None else None
    return tuple(float(x) for x in text.split()) if text else (0.0, 0.0, 0.0)


def rotation(rpy: Vector3) -> np.ndarray:
    """Rotation matrix of roll, pitch, yaw: about fixed x, then y, then z."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _body(link: ET.Element) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre and inertia about the centre, in the frame of the link."""
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    mass, moments, origin = inertial.find("mass"), inertial.find("inertia"), inertial.find("origin")
    assert mass is not None
    assert moments is not None
    i = {name: float(moments.get(name, "0")) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
    tensor = np.array([[i["ixx"], i["ixy"], i["ixz"]], [i["ixy"], i["iyy"], i["iyz"]], [i["ixz"], i["iyz"], i["izz"]]])
    turn = rotation(_numbers(origin, "rpy"))
    return float(mass.get("value", "0")), np.array(_numbers(origin, "xyz")), turn @ tensor @ turn.T


def joined(
    one: tuple[float, np.ndarray, np.ndarray], other: tuple[float, np.ndarray, np.ndarray]
) -> tuple[float, np.ndarray, np.ndarray]:
    """Two rigid bodies as one: mass, common centre, inertia about it (parallel axes)."""
    mass = one[0] + other[0]
    if mass == 0.0:
        return one
    center = (one[0] * one[1] + other[0] * other[1]) / mass
    tensor = np.zeros((3, 3))
    for m, c, i in (one, other):
        r = c - center
        tensor += i + m * (r @ r * np.eye(3) - np.outer(r, r))
    return mass, center, tensor


def _source(name: str) -> ET.Element:
    try:
        files = metadata.distribution("example-robot-data")
    except metadata.PackageNotFoundError as error:
        raise MissingPackage(
            "Cases of the robots six and panda are left out: pip install 'gapbench[arms]' brings their files."
        ) from error
    path = Path(str(files.locate_file("cmeel.prefix/share/example-robot-data/robots"))) / ARMS[name]
    return ET.parse(path).getroot()


def _child(joint: ET.Element, tag: str) -> str:
    found = joint.find(tag)
    return found.get("link", "") if found is not None else ""


def _gathered(root: ET.Element, link: str) -> tuple[tuple[float, np.ndarray, np.ndarray], ET.Element | None]:
    """The link with all that is fixed to it (and fingers, held at zero), in its frame; and the joint that leads on."""
    element = next(e for e in root.findall("link") if e.get("name") == link)
    body, onward = _body(element), None
    for joint in root.findall("joint"):
        if _child(joint, "parent") != link:
            continue
        if joint.get("type") in ("revolute", "continuous"):
            onward = joint
            continue
        more, further = _gathered(root, _child(joint, "child"))
        onward = onward if further is None else further
        origin = joint.find("origin")
        turn = rotation(_numbers(origin, "rpy"))
        body = joined(body, (more[0], turn @ more[1] + np.array(_numbers(origin, "xyz")), turn @ more[2] @ turn.T))
    return body, onward


def arm(name: str) -> Table:
    """An arm of example-robot-data as its file says, fingers locked; friction and rotors are drawn later."""
    root = _source(name)
    children = {_child(j, "child") for j in root.findall("joint")}
    base = next(str(e.get("name")) for e in root.findall("link") if e.get("name") not in children)
    links: list[Link] = []
    _, joint = _gathered(root, base)
    while joint is not None:
        (mass, center, tensor), onward = _gathered(root, _child(joint, "child"))
        origin, axis = joint.find("origin"), joint.find("axis")
        moments = (*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2])
        links.append(
            Link(
                str(joint.get("name")),
                _numbers(origin, "xyz"),
                _numbers(axis, "xyz"),
                mass,
                tuple(map(float, center)),
                tuple(map(float, moments)),
                rotation=_numbers(origin, "rpy"),
                parent=len(links) - 1,
            )
        )
        joint = onward
    return Table(name, tuple(links), posture=POSTURES[name])
