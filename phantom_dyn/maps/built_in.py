"""What maps of the built-in devices know beyond their robot file: inverse kinematics, stiffness, a usual posture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from phantom_dyn.devices import cea, phantom

Array = np.ndarray


@dataclass(frozen=True)
class Device:
    """A built-in device.

    Attributes:
        branches: Candidates ``(B, N, 3)`` [rad] of tip positions ``(N, 3)`` [m], NaN where there is none.
        posture: Configuration [rad] that the branch is chosen by when nothing else is said.
        stiffness: Gives that of the joints [N m/rad], or None where nothing is published.
        stiffness_note: How the source is read, for captions.
    """

    branches: Callable[[Array], Array]
    posture: tuple[float, float, float]
    stiffness: Callable[[], Array] | None = None
    stiffness_note: str = ""


def phantom_branches(p: Array) -> Array:
    """The one assembly that the parallelogram allows."""
    return phantom.inverse_kinematics(p)[None]


def cea_branches(p: Array) -> Array:
    """Four candidates: the arm on either side of the axis of q1, with the elbow on either side.

    In the plane of the arm, q2 and q5 are absolute, so that ``(rho, -z) = d3 (cos q2, sin q2) + d4 (cos q5, sin q5)``.
    """
    d3, d4 = cea.LENGTHS.d3, cea.LENGTHS.d4
    out = []
    for side in (1.0, -1.0):
        rho, depth = side * np.hypot(p[:, 0], p[:, 1]), -p[:, 2]
        turn = np.arctan2(side * p[:, 1], side * p[:, 0])
        square = rho**2 + depth**2
        with np.errstate(invalid="ignore", divide="ignore"):
            apart = np.arccos((square - d3**2 - d4**2) / (2 * d3 * d4))
        for elbow in (apart, -apart):
            q2 = np.arctan2(depth, rho) - np.arctan2(d4 * np.sin(elbow), d3 + d4 * np.cos(elbow))
            out.append(np.stack([turn, q2, q2 + elbow], axis=-1))
    return np.stack(out)


DEVICES = {
    "phantom_1_5": Device(branches=phantom_branches, posture=(0.0, 0.0, 0.0)),
    "cea_branch": Device(
        branches=cea_branches,
        posture=(0.0, -np.pi / 4, np.pi / 4),
        stiffness=cea.joint_stiffness,
        stiffness_note="joint stiffness 1000 N m/rad: the source's 1 N m/rad, read in N m/mrad (as printed it gives a "
        "few N/m, against the published 2000 to 5000 N/m)",
    ),
}


def device(source: str, frame: str) -> Device | None:
    """Device of a built-in name with its own tip, or None."""
    return DEVICES.get(source) if frame == "tip" else None
