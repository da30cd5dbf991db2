# pyright: reportAttributeAccessIssue=false
"""Finds the bodies that fixed or locked joints attach to a moving link, such as a hand, a camera or a tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class Attached:
    """A body on a fixed or locked joint, together with all bodies that further such joints attach to it.

    Attributes:
        names: Names of the links with mass, from this joint outwards.
        mass: Mass [kg].
        center: Centre of mass in the frame of the moving joint that carries the body [m].
        inertia: Inertia about the centre of mass, in the axes of the moving joint [kg m^2].
    """

    names: tuple[str, ...]
    mass: float
    center: Float[Array, " 3"]
    inertia: Float[Array, "3 3"]


def attached_bodies(model: pin.Model) -> tuple[tuple[Attached, ...], ...]:
    """Attached bodies of each moving body, each together with the bodies that it carries.

    Args:
        model: Model with frames of the fixed joints.

    Returns:
        A tuple of bodies for each joint in Pinocchio's order, which begins with the world.
    """
    fixed: list[list[int]] = [[] for _ in range(model.njoints)]
    for k, frame in enumerate(model.frames):
        if frame.type == pin.FrameType.FIXED_JOINT:
            fixed[frame.parentJoint].append(k)
    return tuple(_attached_to(model, own) for own in fixed)


def _attached_to(model: pin.Model, fixed: list[int]) -> tuple[Attached, ...]:
    """Attached bodies of one moving body, from the indices of its frames of fixed joints."""
    frames = model.frames
    # By names of links, because a joint without own mass would repeat the body of the joint behind it.
    out: dict[tuple[str, ...], Attached] = {}
    for root in fixed:
        behind = [k for k in fixed if _hangs_on(model, k, root) and frames[k].inertia.mass > 0]
        if not behind:
            continue
        whole = pin.Inertia.Zero()
        for k in behind:
            whole += frames[k].placement.act(frames[k].inertia)
        names = tuple(_link_of(model, k) for k in behind)
        out.setdefault(names, Attached(names, float(whole.mass), np.array(whole.lever), np.array(whole.inertia)))
    return tuple(out.values())


def _hangs_on(model: pin.Model, frame: int, root: int) -> bool:
    """True if ``frame`` is ``root``, or if ``root`` carries it."""
    while frame > root:
        parent = model.frames[frame].parentFrame
        # A locked joint is its own parent frame; the frame before it is that of the link that carries it.
        frame = parent if parent < frame else frame - 1
    return frame == root


def _link_of(model: pin.Model, joint: int) -> str:
    """Name of the link on a fixed joint, or of the joint if it has no link."""
    frames = model.frames
    has_link = joint + 1 < len(frames) and frames[joint + 1].type == pin.FrameType.BODY
    return frames[joint + has_link].name
