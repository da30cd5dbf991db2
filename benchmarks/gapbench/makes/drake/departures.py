"""What the true robot has and its model lacks: the numbers that effects and causes from outside set."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

STIFF = 0.0  # a stiffness of zero stands for a rigid transmission


@dataclass(frozen=True)
class Coupling:
    """Friction and inertia on the speed w = v_i + ratio v_j."""

    i: int
    j: int
    ratio: float
    dry: float
    wet: float
    inertia: float


@dataclass(frozen=True)
class Outside:
    """A cause that is no effect of the catalogue, on joint ``j``; all joints where that is negative."""

    name: str
    j: int
    numbers: dict[str, float]


@dataclass(frozen=True)
class Departures:
    """One entry a joint, shape ``(n,)``, unless said otherwise; SI units on the joint side.

    Attributes:
        dry: More Coulomb friction for positive and negative speed, shape ``(n, 2)``.
        wet: More viscous friction likewise, shape ``(n, 2)``.
        static: Ts - Tc of a Stribeck curve, with the speed `stribeck`.
        soft: Level and displacement of a second, soft bristle, shape ``(n, 2)``.
        load: Dry friction over the torque that the transmission passes on.
        gap: Full width of a play.
        stiffness: Of the transmission; zero is rigid.
        hysteresis: Torque level of a bristle beside the transmission's spring [N m].
        ripple: Rows of joint, order, amplitude, phase.
        limit: Largest torque, infinite where there is none.
        ratio, offset, delay, lag, rotor: Of the drive.
        spring: Stiffness and rest position, shape ``(n, 2)``.
        reading: Encoder: offset, amplitude, phase, order, step; shape ``(n, 5)``.
        coupling: Or None.
        outside: Or None.
    """

    dry: np.ndarray
    wet: np.ndarray
    static: np.ndarray
    stribeck: np.ndarray
    soft: np.ndarray
    load: np.ndarray
    gap: np.ndarray
    stiffness: np.ndarray
    hysteresis: np.ndarray
    limit: np.ndarray
    ratio: np.ndarray
    offset: np.ndarray
    delay: np.ndarray
    lag: np.ndarray
    rotor: np.ndarray
    spring: np.ndarray
    reading: np.ndarray
    ripple: tuple[tuple[int, float, float, float], ...] = ()
    coupling: Coupling | None = None
    outside: Outside | None = None

    def set(self, name: str, at: int | tuple[int, int], value: float) -> Departures:
        """The same with one number of an array set."""
        array = getattr(self, name).copy()
        array[at] = value
        return replace(self, **{name: array})

    @property
    def loose(self) -> np.ndarray:
        """Joints whose motor turns apart from the link, as indices."""
        return np.flatnonzero((self.stiffness > STIFF) | (self.gap > 0.0))


def none(n: int) -> Departures:
    """A robot that is as its model says."""
    zero, two = np.zeros(n), np.zeros((n, 2))
    return Departures(
        dry=two,
        wet=two,
        static=zero,
        stribeck=np.full(n, 0.05),
        soft=two,
        load=zero,
        gap=zero,
        stiffness=zero,
        hysteresis=zero,
        limit=np.full(n, np.inf),
        ratio=np.ones(n),
        offset=zero,
        delay=zero,
        lag=zero,
        rotor=zero,
        spring=two,
        reading=np.zeros((n, 5)),
    )
