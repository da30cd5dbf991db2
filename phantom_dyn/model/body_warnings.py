# pyright: reportAttributeAccessIssue=false
"""Warnings about bodies that have no mass, no inertia or a far too large inertia in the robot's file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from phantom_dyn.errors import listed
from phantom_dyn.loops.chain import ClosedChain
from phantom_dyn.model.inertia import impossible_because
from phantom_dyn.model.robot_xml import Body, RobotXml

# Radius of gyration above which an inertia counts as a placeholder: in metres, and in lengths of the robot.
_FAR_M, _FAR_LENGTHS = 1.0, 3.0
# A body is too thin if a ball with its mass and inertia has less than this density [kg/m^3], a fifth of that of air.
# The limit for such a body is fewer lengths of the robot, without the height at which the base is mounted.
_THIN, _THIN_LENGTHS = 0.25, 1.5
# Share of a moving body, in mass and in inertia, below which a link that is fixed in it does not matter: a fifth of the
# tolerance that a model has unless another is stated.
_NEGLIGIBLE = 0.01


def body_warnings(model: pin.Model, facts: RobotXml, chain: ClosedChain | None, path: Path) -> tuple[str, ...]:
    """Warnings about moving bodies without mass, or with an inertia that looks like a placeholder.

    Args:
        model: Model of the joints that are not held fixed, with the rotors.
        facts: Content of the file.
        chain: Loops of the robot, whose passive joints may carry rods without mass.
        path: Path of the file.
    """
    idle = [] if chain is not None else _without_inertia(model)
    return (
        *_idle_links(model, idle, path),
        *_weightless_links(model, facts, {*idle, *(() if chain is None else chain.passive_names)}, path),
        *_too_large_inertias(model, facts, path),
    )


def is_negligible(model: pin.Model, body: Body) -> bool:
    """True if a link is a very small part of a body that moves and can exist.

    Only the whole body that a joint moves has an influence on torques.

    Args:
        model: Model with all joints of the file.
        body: A link of the file.
    """
    frame = model.getFrameId(body.name.removeprefix("link "), pin.FrameType.BODY)
    if frame >= model.nframes:
        return False
    whole = model.inertias[model.frames[frame].parentJoint]
    if impossible_because(whole.mass, whole.inertia) or abs(body.mass) > _NEGLIGIBLE * whole.mass:
        return False
    own, all_of_it = np.linalg.eigvalsh(body.central_inertia), np.linalg.eigvalsh(whole.inertia)
    return bool(np.abs(own).max() <= _NEGLIGIBLE * all_of_it[0])


def _link_names(model: pin.Model, joint: int) -> list[str]:
    """Name of the link on a joint, without the links that fixed joints attach to it; empty if the file has none."""
    own = model.getFrameId(model.names[joint], pin.FrameType.JOINT)
    return [one.name for one in model.frames if one.type == pin.FrameType.BODY and one.parentFrame == own]


def _idle_links(model: pin.Model, idle: list[str], path: Path) -> tuple[str, ...]:
    """A warning about joints that need no torque in the model; empty if there are none."""
    # The checks of recordings refuse a model without any mass.
    if not idle or len(idle) == model.njoints - 1:
        return ()
    links = [link for name in idle for link in _link_names(model, model.getJointId(name))]
    return (
        f"{path}: nothing that {' and '.join(idle)} moves has mass or inertia, so that no motion of it needs a torque "
        f"by the model: give {listed(links) if links else 'the links'} {'its' if len(links) == 1 else 'their'} "
        "<inertial>.",
    )


def _without_inertia(model: pin.Model) -> list[str]:
    """Joints of a tree that move neither mass nor inertia, for example because a file lacks an <inertial>."""
    bodies = [inertia.toDynamicParameters().any() for inertia in model.inertias]
    out = [joint for joint in range(1, model.njoints) if not any(bodies[k] for k in model.subtrees[joint])]
    return [model.names[joint] for joint in out if not model.armature[model.joints[joint].idx_v]]


def _joins_axes(model: pin.Model, joint: int) -> bool:
    """True for a body of length zero between two axes, such as those of a ball joint written as three hinges."""
    lengths = [
        float(np.linalg.norm(model.jointPlacements[child].translation))
        for child in range(joint + 1, model.njoints)
        if model.parents[child] == joint
    ]
    return bool(lengths) and max(lengths) == 0


def _weightless_links(model: pin.Model, facts: RobotXml, passed: set[str], path: Path) -> tuple[str, ...]:
    """Warnings about links that have no mass, even together with all bodies that are fixed to them.

    Args:
        model: Model of the joints that are not held fixed.
        facts: Content of the file.
        passed: Names of joints whose links need no warning.
        path: Path of the file.
    """
    if not any(inertia.toDynamicParameters().any() for inertia in model.inertias):
        return ()
    stated = {body.name for body in facts.bodies}
    lacking: dict[str, list[str]] = {}
    for joint in range(1, model.njoints):
        if model.inertias[joint].mass > 0 or model.names[joint] in passed or _joins_axes(model, joint):
            continue
        for link in _link_names(model, joint):
            why = "a mass of 0" if f"link {link}" in stated else "no <inertial>"
            lacking.setdefault(why, []).append(f"{link} (moved by {model.names[joint]})")
    return tuple(
        f"{path}: {listed(links)} {'has' if len(links) == 1 else 'have'} {why}, so that gravity and acceleration of "
        f"{'it' if len(links) == 1 else 'them'} cost no force in the model: write mass and inertia into <inertial>, "
        "unless the real part weighs next to nothing."
        for why, links in lacking.items()
    )


def _too_large_inertias(model: pin.Model, facts: RobotXml, path: Path) -> tuple[str, ...]:
    """A warning about bodies whose radius of gyration is far larger than the robot, which suggests a placeholder."""
    lengths = [float(np.linalg.norm(place.translation)) for place in model.jointPlacements]
    lever = max(float(np.linalg.norm(inertia.lever)) for inertia in model.inertias)
    far = max(_FAR_M, _FAR_LENGTHS * (sum(lengths) + lever))
    far_if_thin = _THIN_LENGTHS * (sum(lengths[2:]) + lever)
    found, nearest = [], np.inf
    for body in facts.bodies:
        if not body.moves or body.mass <= 0:
            continue
        top = float(np.linalg.eigvalsh(body.central_inertia)[-1])
        radius = float(np.sqrt(max(top, 0.0) / body.mass))
        # The square of a ball's radius of gyration is two fifths of the square of its radius.
        thin = body.mass < _THIN * 4 / 3 * np.pi * (np.sqrt(2.5) * radius) ** 3
        if radius > far or (thin and radius > far_if_thin):
            found.append(f"{body.name} ({body.mass:.3g} kg, {top:.3g} kg m^2)")
            nearest = min(nearest, radius)
    if not found:
        return ()
    return (
        f"{path}: the inertia of {', '.join(found)} is that of the same mass at {nearest:.2g} m or more from its "
        "centre, far outside of the robot: it looks like a placeholder; correct its <inertial>.",
    )
