"""Joints that follow others by a formula, as equalities of an MJCF: of one joint directly, of several by a tendon."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from identification.export.model_files.urdf_file import attribute_text
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_xml import Element

FOLLOWS = "{}_follows"
"""Name of the equality of a joint that follows others, and of its tendon."""
_SOFTNESS = {"solref": "0.004 1", "solimp": "0.99 0.9999 0.001"}
"""Gears and rods are stiff: this is the stiffest equality that MuJoCo's usual step allows (two steps of 2 ms)."""


def add_followers(root: Element, robot: Robot) -> None:
    """Add an equality for each joint of a robot that follows others by a formula.

    MuJoCo measures both sides from the reference positions of the file, which are zero without ``ref``.

    Args:
        root: Root element of an MJCF with the robot's joints; changed.
        robot: A closed chain, or a plain robot, for which nothing is added.
    """
    chain = robot.chain
    if chain is None:
        return
    names = list(robot.model.names)[1:]
    free = [*(names[k] for k in chain.active), *(names[k] for k in chain.unknowns)]
    following = [k for k in chain.passive if k not in chain.unknowns]
    if not following:
        return
    group = ElementTree.SubElement(root, "equality")
    tendons: Element | None = None
    for k in following:
        factors = {joint: float(x) for joint, x in zip(free, chain.linear_map[k], strict=True) if x != 0}
        offset = float(chain.offset[k])
        name = FOLLOWS.format(names[k])
        if len(factors) <= 1:
            leader, slope = next(iter(factors.items()), ("", 0.0))
            own = {"name": name, "joint1": names[k], "polycoef": attribute_text([offset, slope, 0, 0, 0])}
            ElementTree.SubElement(group, "joint", own | ({"joint2": leader} if leader else {}) | _SOFTNESS)
            continue
        tendons = ElementTree.SubElement(root, "tendon") if tendons is None else tendons
        tendon = ElementTree.SubElement(tendons, "fixed", name=name)
        for joint, share in ((names[k], 1.0), *((joint, -factor) for joint, factor in factors.items())):
            ElementTree.SubElement(tendon, "joint", joint=joint, coef=repr(float(np.float64(share))))
        own = {"name": name, "tendon1": name, "polycoef": attribute_text([offset, 0, 0, 0, 0])}
        ElementTree.SubElement(group, "tendon", own | _SOFTNESS)
