"""The friction contacts of a true robot as one set of bristles, each with the row of speeds that it slips at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bristles import Bristles, joined
from .departures import Departures
from .robots import Robot

LEAST = 1e-9  # dry friction of a contact that has none [N m]: the bristle law divides by it
COUPLED_BEND = 1e-4  # displacement in which a coupling's dry friction builds up [rad]


@dataclass(frozen=True)
class Fine:
    """What the true friction has beyond its Coulomb and viscous part, small enough to be part of a null.

    Attributes:
        bend: Displacement in which friction builds up [rad or m], shape ``(n,)``.
        excess: (Ts - Tc) / Tc, shape ``(n,)``.
        stribeck: Speed at which that fades [rad/s or m/s], shape ``(n,)``.
        loop: Time constant of the current loops [s], shape ``(n,)``.
    """

    bend: np.ndarray
    excess: np.ndarray
    stribeck: np.ndarray
    loop: np.ndarray

    def times(self, friction: np.ndarray, loop: np.ndarray) -> Fine:
        """The same with friction and current loops so much smaller at every joint; speeds stay."""
        return Fine(self.bend * friction, self.excess * friction, self.stribeck, self.loop * loop)


@dataclass(frozen=True)
class Contacts:
    """Bristles and their rows over link and motor speeds, shape ``(m, n + loose)``."""

    bristles: Bristles
    rows: np.ndarray


def _set(bend: np.ndarray, dry: np.ndarray, wet: np.ndarray, static: np.ndarray, speed: np.ndarray) -> Bristles:
    dry = np.maximum(dry, LEAST)
    stiffness = dry.mean(axis=1) / bend
    # A bristle's own damping: what stops it within some milliseconds.
    return Bristles(stiffness, 2e-3 * stiffness, wet, dry, np.maximum(static, 0.0), speed)


def contacts(robot: Robot, of: Departures, fine: Fine, motor: np.ndarray) -> Contacts:
    """Joint friction on the motors, a soft bristle, a transmission's hysteresis and a coupling, where there are any.

    Args:
        motor: Index of every joint's motor among the speeds, shape ``(n,)``.
    """
    n, size = len(robot.parts), len(robot.parts) + len(of.loose)
    dry, wet = robot.array("dry"), robot.array("wet")
    static = dry * fine.excess + of.static
    speed = np.where(of.static > 0.0, of.stribeck, fine.stribeck)
    out = _set(fine.bend, dry[:, None] + of.dry, wet[:, None] + of.wet, static, speed)
    rows = [np.eye(size)[motor[j]] for j in range(n)]
    for j in np.flatnonzero(of.soft[:, 0]):
        level, bend = of.soft[j]
        one = np.full((1, 2), level)
        out = joined(out, _set(np.array([bend]), one, 0.0 * one, np.zeros(1), np.ones(1)))
        rows.append(np.eye(size)[motor[j]])
    for j in np.flatnonzero(of.hysteresis):
        # Its initial stiffness is a fifth of the spring's: a loop, and not a second spring.
        level, bend = of.hysteresis[j], 5.0 * of.hysteresis[j] / of.stiffness[j]
        one = np.full((1, 2), level)
        out = joined(out, _set(np.array([bend]), one, 0.0 * one, np.zeros(1), np.ones(1)))
        rows.append(np.eye(size)[motor[j]] - np.eye(size)[j])
    if of.coupling is not None:
        c = of.coupling
        one = np.ones((1, 2))
        out = joined(out, _set(np.array([COUPLED_BEND]), c.dry * one, c.wet * one, np.zeros(1), np.ones(1)))
        row = np.eye(size)[motor[c.i]] + c.ratio * np.eye(size)[motor[c.j]]
        rows.append(row)
    return Contacts(out, np.array(rows))
