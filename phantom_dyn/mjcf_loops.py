# pyright: reportAttributeAccessIssue=false
"""Loops that a MJCF file closes with ``<connect>`` and ``<weld>``, set up in Pinocchio's model.

They are read from the file and placed on the frames of the bodies, because `buildModelAndConstraintsFromMJCF` of
Pinocchio 4.1 misplaces an anchor on a body whose joint has a ``pos``, and closes loops that ``active="false"`` opens.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from phantom_dyn.errors import RobotError
from phantom_dyn.loops.build import frame_index
from phantom_dyn.naming import known_names
from phantom_dyn.robot_config import FrameLoop, PointLoop
from phantom_dyn.robot_xml import MjcfLoop

Array = np.ndarray


def add_loop_frames(model: pin.Model, loops: tuple[MjcfLoop, ...], path: Path) -> dict[str, PointLoop | FrameLoop]:
    """The loops as robot.yaml would state them, by label; their frames are added to the model.

    Args:
        model: The whole model of the file; changed.
        loops: What `mjcf_loops` found.
        path: The file, for messages.

    Raises:
        RobotError: If a body or site of a loop is not in the model.
    """
    names = dict.fromkeys(frame.name for frame in model.frames)
    home = _home(model)
    data = model.createData()
    pin.framesForwardKinematics(model, data, home)
    start = {
        model.names[j]: float(home[joint.idx_q])
        for j, joint in enumerate(model.joints)
        if j and joint.nq == 1 and home[joint.idx_q] != 0
    }
    out: dict[str, PointLoop | FrameLoop] = {}
    for index, loop in enumerate(loops):
        for name in (loop.frame_a, loop.frame_b):
            if name not in names:
                known = known_names(name, names, "bodies and sites")
                raise RobotError(f"{path}: {loop.label} names {name!r}, which the model does not have, {known}")
        a, b = frame_index(model, loop.frame_a), frame_index(model, loop.frame_b)
        ends = [f"{loop.label} {index}{side}" for side in "ab"]
        for name, frame, placement in zip(ends, (a, b), _placements(data, loop, a, b), strict=True):
            parent = model.frames[frame]
            full = parent.placement * placement
            model.addFrame(pin.Frame(name, parent.parentJoint, frame, full, pin.FrameType.OP_FRAME), False)
        stated = FrameLoop if loop.kind == "frame" else PointLoop
        label = loop.label if loop.label not in out else f"{loop.label} ({index})"
        out[label] = stated(frame_a=ends[0], frame_b=ends[1], start=start)
    return out


def _home(model: pin.Model) -> Array:
    """Configuration in which the file draws the robot; it differs from zero where joints have a ``ref``."""
    drawn = {entry.key(): entry.data() for entry in model.referenceConfigurations}
    return drawn.get("qpos0", pin.neutral(model))


def _placements(data: pin.Data, loop: MjcfLoop, a: int, b: int) -> tuple[pin.SE3, pin.SE3]:
    """Places of the two ends on their bodies or sites, as MuJoCo defines them."""
    anchor = pin.SE3(np.eye(3), np.array(loop.anchor))
    b_in_a = data.oMf[a].actInv(data.oMf[b])
    if loop.on_sites:
        return pin.SE3.Identity(), pin.SE3.Identity()
    if loop.anchor_on_first:
        return anchor, b_in_a.actInv(anchor)
    if loop.relative is None:
        return b_in_a * anchor, anchor
    w, x, y, z = np.array(loop.relative[3:]) / np.linalg.norm(loop.relative[3:])
    return pin.SE3(pin.Quaternion(w, x, y, z).matrix(), np.array(loop.relative[:3])), anchor
