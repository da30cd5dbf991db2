# pyright: reportAttributeAccessIssue=false
"""Postures of the robot over a recording: the one of the report's picture, and those that its slider shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from identification.diagnosis.result import Diagnosis
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot

SHOWN = 41
"""Postures of the slider, the middle one among them: a robot of seven joints takes 15 kB of the page for them."""
_SOLVED = 2000  # rows for which loops are closed: neighbours are near enough to stay on one branch


@dataclass(frozen=True)
class Postures:
    """Where the joints are at some instants of a recording.

    Attributes:
        t: Instants [s], shape ``(K,)``; several recordings follow each other.
        rotation: Of each joint's frame in the world, shape ``(K, njoints, 3, 3)``.
        place: Origin of each joint's frame [m], shape ``(K, njoints, 3)``.
        middle: Number of the instant in the middle of the recording.
        q: Positions of the joints at that instant [rad or m], shape ``(nv,)``; NaN without samples.
    """

    t: Float[Array, " K"]
    rotation: Float[Array, "K n 3 3"]
    place: Float[Array, "K n 3"]
    middle: int
    q: Float[Array, " nv"]

    def moved_from_the_middle(self) -> tuple[Float[Array, "K n 3 3"], Float[Array, "K n 3"]]:
        """Rotation and shift that carry what each joint bears from the middle posture to the others."""
        turned = self.rotation @ np.swapaxes(self.rotation[self.middle], 1, 2)
        return turned, self.place - np.einsum("knij,nj->kni", turned, self.place[self.middle])


def postures(robot: Robot, diagnosis: Diagnosis) -> Postures:
    """Postures at even steps through the recording; the middle one alone where no others can be had.

    Without samples it is the neutral posture. Others cannot be had where loops do not close along the recording.
    """
    q, t = diagnosis.evidence.q, diagnosis.evidence.t
    finite = np.flatnonzero(np.isfinite(q).all(axis=1)) if q.size else np.zeros(0, dtype=int)
    if not len(finite):
        return _placed(robot, np.zeros(1), pin.neutral(robot.model)[None, :], 0, np.full(robot.nv, np.nan))
    half = finite[len(finite) // 2]
    middle = robot.configuration(q[half][None, :])
    rows = finite[np.unique(np.linspace(0, len(finite) - 1, _SOLVED).round().astype(int))]
    try:
        every = robot.configuration(q[rows])
    except ChainError:
        return _placed(robot, t[[half]], middle, 0, q[half])
    shown = np.unique(np.linspace(0, len(rows) - 1, SHOWN).round().astype(int))
    at = int(np.argmin(np.abs(rows[shown] - half)))
    times, configurations = t[rows[shown]].copy(), every[shown].copy()
    times[at], configurations[at] = t[half], middle[0]
    return _placed(robot, times, configurations, at, q[half])


def _placed(
    robot: Robot, t: Float[Array, " K"], configurations: Float[Array, "K nq"], middle: int, q: Float[Array, " nv"]
) -> Postures:
    model = robot.model
    data = model.createData()
    rotation, place = np.zeros((len(t), model.njoints, 3, 3)), np.zeros((len(t), model.njoints, 3))
    for k, configuration in enumerate(configurations):
        pin.forwardKinematics(model, data, configuration)
        for joint, pose in enumerate(data.oMi):
            rotation[k, joint], place[k, joint] = pose.rotation, pose.translation
    return Postures(t, rotation, place, middle, q)
