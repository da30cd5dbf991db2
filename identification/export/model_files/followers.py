# pyright: reportAttributeAccessIssue=false
"""The joints of a URDF that mimic others, put back into a robot that holds them fixed: for formats with equalities."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from phantom_dyn.loops.chain import ClosedChain
from phantom_dyn.model.loading import parse_model
from phantom_dyn.model.robot import Robot

Array = np.ndarray


def with_followers(robot: Robot, given: Robot, file: Path) -> Robot:
    """The robot as a chain whose mimicking joints follow the ones that they mimic; the same object if none does.

    A closed chain is left as it is, and so are joints that mimic one that is held fixed.

    Args:
        robot: The robot with other links, friction, rotors or gravity.
        given: As its file states it.
        file: The robot's URDF.
    """
    mimics = _mimics(file) if file.suffix == ".urdf" and robot.chain is None else {}
    names = list(given.model.names)[1:]
    free = {joint: law for joint, law in mimics.items() if joint in given.locked and law[0] in names}
    if not free:
        return robot
    whole = parse_model(file, "urdf")
    held = [whole.getJointId(name) for name in given.locked if name not in free]
    model = pin.buildReducedModel(whole, held, pin.neutral(whole)) if held else whole
    tree = list(model.names)[1:]
    for body, name in enumerate(names, start=1):
        change = robot.model.inertias[body].toDynamicParameters() - given.model.inertias[body].toDynamicParameters()
        if change.any():
            own = model.getJointId(name)
            moved = model.inertias[own].toDynamicParameters() + change
            model.inertias[own] = pin.Inertia.FromDynamicParameters(moved)
    rows = [tree.index(name) for name in names]
    armature = np.zeros(model.nv)
    armature[rows] = robot.model.armature
    model.armature, model.gravity = armature, robot.model.gravity
    passive = tuple(k for k, name in enumerate(tree) if name in free)
    linear_map, offset = np.zeros((len(tree), len(names))), np.zeros(len(tree))
    linear_map[rows, np.arange(len(names))] = 1.0
    for k in passive:
        leader, factor, zero = free[tree[k]]
        linear_map[k, names.index(leader)], offset[k] = factor, zero
    chain = ClosedChain(
        active=tuple(rows),
        passive=passive,
        passive_names=tuple(tree[k] for k in passive),
        unknowns=(),
        linear_map=linear_map,
        offset=offset,
        anchors=(),
        start=offset,
        viscous_friction=model.damping[list(passive)],
        coulomb_friction=model.upperDryFrictionLimit[list(passive)],
    )
    locked = tuple(name for name in given.locked if name not in free)
    return replace(robot, model=model, chain=chain, locked=locked)


def _mimics(file: Path) -> dict[str, tuple[str, float, float]]:
    """Joints of a URDF that mimic another: its name, the factor, and the position where it is at zero."""
    out = {}
    for joint in ElementTree.parse(file).getroot().findall("joint"):
        mimic = joint.find("mimic")
        if mimic is not None:
            law = (float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0")))
            out[joint.get("name", "")] = (mimic.get("joint", ""), *law)
    return out
