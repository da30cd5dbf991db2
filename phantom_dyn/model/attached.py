# pyright: reportAttributeAccessIssue=false
"""Bodies that hang on a link by fixed or locked joints: a hand, a camera, a tool that the model carries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class Attached:
    """A body on a fixed or locked joint with all that hangs on it in the same way.

    Attributes:
        names: Names of the links, that of the joint first; those without mass are left out.
        mass: In kg.
        center: Centre of mass in the frame of the moving joint that carries it [m].
        inertia: About the centre of mass, in the axes of that joint [kg m^2].
    """

    names: tuple[str, ...]
    mass: float
    center: Float[Array, " 3"]
    inertia: Float[Array, "3 3"]


def attached_bodies(model: pin.Model) -> tuple[tuple[Attached, ...], ...]:
    """Parts on each body behind fixed or locked joints, each with all that it carries; none twice.

    Args:
        model: Its frames say what was fixed where.

    Returns:
        By Pinocchio's index of the joint that moves the body, that of the world first.
    """
    fixed: list[list[int]] = [[] for _ in range(model.njoints)]
    for k, frame in enumerate(model.frames):
        if frame.type == pin.FrameType.FIXED_JOINT:
            fixed[frame.parentJoint].append(k)
    return tuple(_attached_to(model, own) for own in fixed)


def _attached_to(model: pin.Model, fixed: list[int]) -> tuple[Attached, ...]:
    """Parts on one body, whose frames of fixed joints are known."""
    frames = model.frames
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
    """True if a frame is another one, or is behind it."""
    while frame > root:
        parent = model.frames[frame].parentFrame
        # A joint that was locked names itself as its parent: it stands behind the link that it hangs on.
        frame = parent if parent < frame else frame - 1
    return frame == root


def _link_of(model: pin.Model, joint: int) -> str:
    """Name of the link behind a fixed joint, or of the joint where it has none."""
    frames = model.frames
    has_link = joint + 1 < len(frames) and frames[joint + 1].type == pin.FrameType.BODY
    return frames[joint + has_link].name
