"""Poses that a tracker would measure on a robot whose geometry differs from its URDF, without Pinocchio.

Forward kinematics and weights are written again from the URDF with NumPy: a robot is the text of its file with other
``origin`` elements, joints whose encoders read too much, and joints that give way under the weight of the links.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from xml.etree import ElementTree

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class TrueRobot:
    """A robot as it is.

    Attributes:
        text: Its URDF.
        zeros: By joint, what its encoder reads too much [rad].
        compliance: By joint, deflection under torque [rad/(N m)].
    """

    text: str
    zeros: Mapping[str, float] = field(default_factory=dict)
    compliance: Mapping[str, float] = field(default_factory=dict)


def moved_joint(text: str, joint: str, shift: Sequence[float] = (0, 0, 0), turn: Sequence[float] = (0, 0, 0)) -> str:
    """A URDF whose joint sits elsewhere on its parent: shifted and turned (a rotation vector) in its own axes."""
    root = ElementTree.fromstring(text)
    origin = next(j for j in root.findall("joint") if j.get("name") == joint).find("origin")
    place = _pose(origin)
    xyz, R = place[:3, 3] + place[:3, :3] @ np.array(shift), place[:3, :3] @ rotation(np.array(turn, dtype=float))
    origin.set("xyz", " ".join(map(repr, map(float, xyz))))
    origin.set("rpy", " ".join(map(repr, (float(x) for x in _rpy(R)))))
    return ElementTree.tostring(root, encoding="unicode")


def rotation(vector: Array) -> Array:
    """Rotation by the length of a vector about it (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle == 0:
        return np.eye(3)
    x, y, z = vector / angle
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


def link_poses(text: str, q: Mapping[str, float]) -> dict[str, Array]:
    """Pose of every link in the root, each ``(4, 4)``."""
    return _placed(_joints(text), q)


def measured(
    robot: TrueRobot,
    frame: str,
    readings: Mapping[str, Array],
    *,
    tracker: Array | None = None,
    target: Array | None = None,
) -> tuple[Array, Array]:
    """Positions ``(n, 3)`` and orientations ``(n, 3, 3)`` of a target, without noise.

    Args:
        robot: The true one.
        frame: Link that carries the target.
        readings: By joint, what its encoder says, ``(n,)``.
        tracker: Pose of the root in the tracker's axes; None: the same.
        target: Pose of the target on the frame; None: the same.
    """
    joints, masses = _joints(robot.text), masses_of(robot.text)
    n = len(next(iter(readings.values())))
    out = np.empty((n, 4, 4))
    for k in range(n):
        q = {name: float(values[k]) - robot.zeros.get(name, 0.0) for name, values in readings.items()}
        motor = dict(q)
        for _ in range(3 if robot.compliance else 0):  # the load changes a little with the deflection
            for name, compliance in robot.compliance.items():
                q[name] = motor[name] - compliance * _weight_torque(joints, masses, q, name)
        out[k] = _placed(joints, q)[frame]
    out = (np.eye(4) if tracker is None else tracker) @ out @ (np.eye(4) if target is None else target)
    return out[:, :3, 3], out[:, :3, :3]


def quaternions(turns: Array) -> Array:
    """x, y, z, w of rotations."""
    out = np.empty((len(turns), 4))
    for k, R in enumerate(turns):
        values, vectors = np.linalg.eigh(
            np.array(
                [
                    [R[0, 0] - R[1, 1] - R[2, 2], R[1, 0] + R[0, 1], R[2, 0] + R[0, 2], R[2, 1] - R[1, 2]],
                    [R[1, 0] + R[0, 1], R[1, 1] - R[0, 0] - R[2, 2], R[2, 1] + R[1, 2], R[0, 2] - R[2, 0]],
                    [R[2, 0] + R[0, 2], R[2, 1] + R[1, 2], R[2, 2] - R[0, 0] - R[1, 1], R[1, 0] - R[0, 1]],
                    [R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1], R[0, 0] + R[1, 1] + R[2, 2]],
                ]
            )
        )
        out[k] = vectors[:, np.argmax(values)]
    return out


def pose(shift: Sequence[float], turn: Sequence[float]) -> Array:
    """A pose from a shift and a rotation vector."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation(np.array(turn, dtype=float)), shift
    return out


def _weight_torque(joints: list, masses: list, q: Mapping[str, float], name: str) -> float:
    """Torque that holds the weights at a joint: slope of the potential energy, by central differences."""
    step = 1e-5
    up, down = dict(q) | {name: q[name] + step}, dict(q) | {name: q[name] - step}
    return (_energy(joints, masses, up) - _energy(joints, masses, down)) / (2 * step)


def _energy(joints: list, masses: list, q: Mapping[str, float]) -> float:
    places = _placed(joints, q)
    return sum(9.81 * mass * float((places[link] @ np.append(centre, 1.0))[2]) for link, mass, centre in masses)


def _placed(joints: list, q: Mapping[str, float]) -> dict[str, Array]:
    out = {joints[0][1]: np.eye(4)} if joints else {}
    for name, parent, child, origin, axis, kind in joints:
        place = out[parent] @ origin
        angle = q.get(name, 0.0)
        if kind in ("revolute", "continuous"):
            place[:3, :3] = place[:3, :3] @ rotation(axis * angle)
        elif kind == "prismatic":
            place[:3, 3] += place[:3, :3] @ axis * angle
        out[child] = place
    return out


@cache
def _joints(text: str) -> list:
    """Joints of a URDF from the root outwards: name, parent, child, origin, axis, kind."""
    todo = []
    for joint in ElementTree.fromstring(text).findall("joint"):
        stated = joint.find("axis")
        axis = np.array([float(x) for x in ("1 0 0" if stated is None else stated.get("xyz")).split()])
        parent, child = joint.find("parent").get("link"), joint.find("child").get("link")
        place = _pose(joint.find("origin"))
        todo.append((joint.get("name"), parent, child, place, axis / np.linalg.norm(axis), joint.get("type")))
    children = {one[2] for one in todo}
    known, out = {one[1] for one in todo} - children, []
    while len(out) < len(todo):
        out += [one for one in todo if one[1] in known and one[2] not in known]
        known |= {one[2] for one in out}
    return out


@cache
def masses_of(text: str) -> list:
    """Links with mass of a URDF: name, mass [kg], centre of mass [m]."""
    out = []
    for link in ElementTree.fromstring(text).findall("link"):
        inertial = link.find("inertial")
        if inertial is not None:
            mass = float(inertial.find("mass").get("value"))
            out.append((link.get("name"), mass, _pose(inertial.find("origin"))[:3, 3]))
    return out


def _pose(origin) -> Array:
    out = np.eye(4)
    if origin is not None:
        r, p, y = (float(x) for x in origin.get("rpy", "0 0 0").split())
        out[:3, :3] = rotation(np.array([0, 0, y])) @ rotation(np.array([0, p, 0])) @ rotation(np.array([r, 0, 0]))
        out[:3, 3] = [float(x) for x in origin.get("xyz", "0 0 0").split()]
    return out


def _rpy(R: Array) -> tuple[float, float, float]:
    return np.arctan2(R[2, 1], R[2, 2]), -np.arcsin(np.clip(R[2, 0], -1, 1)), np.arctan2(R[1, 0], R[0, 0])
