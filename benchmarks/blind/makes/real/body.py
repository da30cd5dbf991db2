# pyright: reportAttributeAccessIssue=false
# Pinocchio's names come from a compiled module, which has no stubs.
"""Computes with Pinocchio the torques of a robot's links, and their change if inertial parameters change."""

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
    """A robot with revolute or prismatic joints.

    Attributes:
        model: Pinocchio's model, with only the joints of the log.
        dry: Coulomb friction that the file states for each joint [N m or N], shape ``(n,)``.
        viscous: Coefficients of viscous friction that the file states [N m s/rad or N s/m], shape ``(n,)``.
        source: Source of the torque columns: ``command``, ``current`` or ``sensor``.
    """

    model: pin.Model
    dry: Array
    viscous: Array
    source: str

    @property
    def linear(self) -> Array:
        """True for prismatic joints, shape ``(n,)``."""
        return np.array(["P" in joint.shortname() for joint in list(self.model.joints)[1:]])

    @property
    def weighs(self) -> bool:
        """Whether gravity acts on any joint."""
        return bool(np.linalg.norm(self.model.gravity.linear) > 0.0)


def body(urdf: str, yaml: str, joints: Sequence[str]) -> Body:
    """The robot of a URDF and a ``robot.yaml`` with the given joints; all other joints are fixed at zero.

    Raises:
        ValueError: If the joints are not in the order of the file.
    """
    # Pinocchio represents the position of a continuous joint by a sine and a cosine.
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
    """The URDF with limits for every continuous joint, as a revolute joint must have limits."""
    root = ET.fromstring(urdf)
    for joint in root.findall("joint"):
        if joint.get("type") == "continuous" and joint.find("limit") is None:
            ET.SubElement(joint, "limit", lower="-1e9", upper="1e9", effort="1e9", velocity="1e9")
    return ET.tostring(root, encoding="unicode")


def torques(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """Torques of the rigid bodies along a motion [N m or N], shape ``(M, n)``."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])


def regressor(model: pin.Model, q: Array, v: Array, a: Array) -> Array:
    """Torques per unit of each link's ten parameters, in Pinocchio's order, shape ``(M, n, 10 n)``."""
    data = model.createData()
    rows = [pin.computeJointTorqueRegressor(model, data, *row).copy() for row in zip(q, v, a, strict=True)]
    return np.reshape(rows, (len(q), model.nv, -1))  # for one joint, Pinocchio returns one row


def with_body(model: pin.Model, link: int, mass: float, center: Array) -> pin.Model:
    """The robot with a point mass [kg] on a link, at a position in the frame of the link's joint [m]."""
    out = model.copy()
    out.inertias[link + 1] = out.inertias[link + 1] + pin.Inertia(
        mass, np.asarray(center, dtype=float), np.zeros((3, 3))
    )
    return out


def with_link(model: pin.Model, link: int, factor: float, shift: Array) -> pin.Model:
    """The robot with mass and inertia of one link multiplied by a factor, and its centre of mass shifted [m]."""
    out, old = model.copy(), model.inertias[link + 1]
    out.inertias[link + 1] = pin.Inertia(factor * old.mass, old.lever + shift, factor * old.inertia)
    return out


def tilted(model: pin.Model, r: Array) -> pin.Model:
    """The robot with gravity rotated by the rotation vector ``r`` [rad] in the base frame."""
    out = model.copy()
    out.gravity.linear = pin.exp3(np.asarray(r, dtype=float)) @ model.gravity.linear
    return out


def tolerated(model: pin.Model, share: float) -> Array:
    """Changes of the links' parameters by one standard deviation, ``(10 n, 5 n)``, rows in the order of `regressor`.

    Each link has five changes: of its mass, of its inertia about the centre of mass, and of this centre in three
    directions. The standard deviation is ``share`` of the given value, or of the centre's distance from the joint.
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
