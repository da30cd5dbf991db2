# pyright: reportAttributeAccessIssue=false
"""A mass that is known, carried along a motion: it parts what scales everything from what adds to one body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.known_changes.change import KnownPayload
from identification.known_changes.loaded import with_payload
from phantom_dyn.effects.payload import payload_body
from phantom_dyn.robot import Robot

SHARES = (0.5, 0.2, 0.1, 0.05)
"""Masses that are tried, of the mass that the link has which carries them, to one digit."""


@dataclass(frozen=True)
class KnownMass:
    """A point mass [kg] at the payload frame, or with its centre [m] in the frame of the last moving joint."""

    mass: float
    center: tuple[float, float, float]
    frame: str | None


def known_mass(robot: Robot, share: float) -> KnownMass:
    """A share of the mass of the link that carries it, at the payload frame, else at twice the way to its centre."""
    body = payload_body(robot)
    inertia = robot.model.inertias[body]
    mass = _one_digit(share * max(float(inertia.mass), 0.02))
    frame = robot.payload_frame or "tip"
    if robot.model.existFrame(frame) and robot.model.frames[robot.model.getFrameId(frame)].parentJoint == body:
        return KnownMass(mass, (0.0, 0.0, 0.0), frame)
    x, y, z = (round(2.0 * float(c), 3) for c in inertia.lever)
    return KnownMass(mass, (x, y, z), None)


def carried(robot: Robot, mass: KnownMass) -> Robot:
    """The robot with the mass on it."""
    return with_payload(robot, KnownPayload(mass.mass, mass.center))


def _one_digit(x: float) -> float:
    return float(f"{np.maximum(x, 1e-3):.0e}")
