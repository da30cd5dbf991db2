# pyright: reportAttributeAccessIssue=false
# Pinocchio's names come from a compiled module, which has no stubs.
"""Torques of the links of a robot, by Pinocchio, and what small changes of their inertias do to them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import yaml as yaml_reader

Array = np.ndarray


@dataclass(frozen=True)
class Body:
    """A robot of links that hinge or slide.

    Attributes:
        model: Of Pinocchio, with the joints of the log alone.
        dry: Coulomb torque that the file states for each joint, shape ``(n,)``; ``viscous`` its coefficient.
        source: What the torque columns are: ``command``, ``current`` or ``sensor``.
    """

    model: pin.Model
    dry: Array
    viscous: Array
    source: str

    @property
    def linear(self) -> Array:
        """Whether each joint slides, shape ``(n,)``."""
        return np.array(["P" in joint.shortname() for joint in list(self.model.joints)[1:]])

    @property
    def weighs(self) -> bool:
        """Whether gravity acts on any joint."""
        return bool(np.linalg.norm(self.model.gravity.linear) > 0.0)


def body(urdf: str, yaml: str, joints: Sequence[str]) -> Body:
    """The robot of a URDF and a ``robot.yaml``, with the given joints; every other joint is held at zero.

    Raises:
        ValueError: If the joints come in another order than those of the file.
    """
    # A joint without limits would have a sine and a cosine for its position.
    model = pin.buildModelFromXML(re.sub(r'type="continuous"', 'type="revolute"', _limited(urdf)))
    others = [model.getJointId(name) for name in list(model.names)[1:] if name not in joints]
    if others:
        model = pin.buildReducedModel(model, others, pin.neutral(model))
    if list(model.names)[1:] != list(joints):
        raise ValueError(f"The file has the joints {list(model.names)[1:]}, wanted {list(joints)} in this order.")
    said = yaml_reader.safe_load(yaml) or {}
    model.gravity.linear = np.array(said.get("gravity", (0.0, 0.0, -9.81)), dtype=float)
    friction = {x.get("name"): x.find("dynamics") for x in ET.fromstring(urdf).findall("joint")}
    dry, viscous = (
        np.array([float(d.get(what, 0.0)) if (d := friction.get(x)) is not None else 0.0 for x in joints])
        for what in ("friction", "damping")
    )
    return Body(model, dry, viscous, said.get("torque_source", "command"))


def _limited(urdf: str) -> str:
    """The file with limits at every joint without end, which a hinge has to have."""
    root = ET.fromstring(urdf)
    for joint in root.findall("joint"):
        if joint.get("type") == "continuous" and joint.find("limit") is None:
            ET.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
    return ET.tostring(root, encoding="unicode")


def torques(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """What the motion needs [N m or N], shape ``(M, n)``."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])


def regressor(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """Torques per unit of each link's ten parameters, in Pinocchio's order, shape ``(M, n, 10 n)``."""
    data = model.createData()
    rows = [pin.computeJointTorqueRegressor(model, data, *row).copy() for row in zip(q, v, a, strict=True)]
    return np.reshape(rows, (len(q), model.nv, -1))  # of one joint it comes as one row


def with_body(model: pin.Model, link: int, mass: float, center: Array) -> pin.Model:
    """The robot with a point mass on a link, its place in the frame of that link's joint [m]."""
    out = model.copy()
    out.inertias[link + 1] = out.inertias[link + 1] + pin.Inertia(
        mass, np.asarray(center, dtype=float), np.zeros((3, 3))
    )
    return out


def with_link(model: pin.Model, link: int, factor: float, shift: Array) -> pin.Model:
    """The robot with one link's mass and inertia multiplied, and its centre moved [m]."""
    out, old = model.copy(), model.inertias[link + 1]
    out.inertias[link + 1] = pin.Inertia(factor * old.mass, old.lever + shift, factor * old.inertia)
    return out


def tilted(model: pin.Model, r: Array) -> pin.Model:
    """The robot with gravity turned by the rotation vector ``r`` in the base frame."""
    out = model.copy()
    out.gravity.linear = pin.exp3(np.asarray(r, dtype=float)) @ model.gravity.linear
    return out


def tolerated(model: pin.Model, share: float) -> Array:
    """Changes of the links' parameters by one sigma, shape ``(10 n, 5 n)``, rows in the order of `regressor`.

    Of each link: its mass, its inertia about the centre, and the centre in three directions.
    """
    n, columns = model.nv, []
    for k in range(n):
        old = model.inertias[k + 1]
        far = share * np.linalg.norm(old.lever)
        changed = [
            pin.Inertia(old.mass * (1.0 + share), old.lever, old.inertia),
            pin.Inertia(old.mass, old.lever, old.inertia * (1.0 + share)),
            *(pin.Inertia(old.mass, old.lever + far * way, old.inertia) for way in np.eye(3)),
        ]
        for one in changed:
            column = np.zeros(10 * n)
            column[10 * k : 10 * k + 10] = one.toDynamicParameters() - old.toDynamicParameters()
            columns.append(column)
    return np.stack(columns, axis=1)
