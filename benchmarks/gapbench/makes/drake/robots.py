"""Robots of this make, drawn new in every case, and the wrong model of each that is given to the diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi

import numpy as np

TWO_SIGMA = 2.0


@dataclass(frozen=True)
class Tolerance:
    """Stated accuracy of the model: one relative sigma each."""

    inertia: float = 0.05
    friction: float = 0.05
    rotor_inertia: float = 0.10


@dataclass(frozen=True)
class Part:
    """A moving link with the joint that carries it and that joint's drive.

    Attributes:
        joint: Name of the joint.
        linear: A slide [m] in place of a hinge [rad].
        axis: In the joint's frame, shape ``(3,)``.
        place: Joint in the frame of the part before it [m], shape ``(3,)``.
        mass: [kg].
        center: Of mass, in the joint's frame [m], shape ``(3,)``.
        inertia: About the centre of mass: xx, yy, zz [kg m^2].
        rotor: Rotor inertia on the joint side [kg m^2 or kg].
        dry: Coulomb friction [N m or N].
        wet: Viscous coefficient [N m s/rad or N s/m].
        counts: Encoder counts per turn; of a slide per metre.
        reach: Half of the travel used [rad or m].
        home: Middle of that travel.
        speed: Largest speed of the motions.
    """

    joint: str
    linear: bool
    axis: tuple[float, float, float]
    place: tuple[float, float, float]
    mass: float
    center: tuple[float, float, float]
    inertia: tuple[float, float, float]
    reach: float
    home: float
    speed: float
    counts: int = 65536
    rotor: float = 0.0
    dry: float = 0.0
    wet: float = 0.0


@dataclass(frozen=True)
class Robot:
    """A chain of parts; ``payload`` is a point mass and its place in the last joint's frame, ``carried`` another."""

    kind: str
    parts: tuple[Part, ...]
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    payload: tuple[float, tuple[float, float, float]] | None = None
    carried: tuple[float, tuple[float, float, float]] | None = None

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(part.joint for part in self.parts)

    def array(self, name: str) -> np.ndarray:
        """One number of every part, shape ``(n,)``."""
        return np.array([getattr(part, name) for part in self.parts])

    def with_part(self, i: int, part: Part) -> Robot:
        return replace(self, parts=(*self.parts[:i], part, *self.parts[i + 1 :]))


X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
Vec = tuple[float, float, float]


def _beam(mass: float, along: Vec, length: float, width: float) -> tuple[float, float, float]:
    """Inertia of a box about its middle, ``length`` along one axis and ``width`` across."""
    across = np.full(3, width)
    sides = np.where(np.array(along) > 0.5, length, across)
    squares = sides**2
    return tuple(mass / 12.0 * (squares.sum() - squares))


def _link(
    rng: np.random.Generator, joint: str, axis: Vec, place: Vec, *, mass: float, along: Vec, length: float
) -> Part:
    """A beam from its joint, its centre somewhat off the middle and off the line."""
    off = rng.normal(0.0, 0.02, 3) * length
    center = tuple(np.array(along) * length * rng.uniform(0.35, 0.6) + off)
    width = length * rng.uniform(0.15, 0.35)
    inertia = _beam(mass, along, length, width)
    reach, speed = rng.uniform(0.6, 1.3), rng.uniform(1.2, 3.0)
    counts = int(2 ** rng.integers(14, 19))
    return Part(joint, False, axis, place, mass, center, inertia, reach, 0.0, speed, counts)


def _slide(rng: np.random.Generator, part: Part, reach: tuple[float, float]) -> Part:
    """The same part on a slide, with a scale of half a micrometre or better."""
    travel = rng.uniform(*reach)
    counts = int(rng.choice((2_000_000, 5_000_000)))
    return replace(part, linear=True, reach=travel, speed=travel * rng.uniform(2.0, 3.5), counts=counts)


def _arm2(rng: np.random.Generator) -> tuple[Part, ...]:
    a, b = rng.uniform(0.25, 0.6), rng.uniform(0.2, 0.5)
    upper = _link(rng, "lift", Y, (0.0, 0.0, 0.4), mass=rng.uniform(1.5, 6.0), along=X, length=a)
    fore = _link(rng, "bend", Y, (a, 0.0, 0.0), mass=rng.uniform(0.6, 3.0), along=X, length=b)
    return upper, fore


def _arm3(rng: np.random.Generator) -> tuple[Part, ...]:
    h, a, b = rng.uniform(0.15, 0.35), rng.uniform(0.25, 0.5), rng.uniform(0.2, 0.45)
    waist = _link(rng, "waist", Z, (0.0, 0.0, 0.1), mass=rng.uniform(2.0, 6.0), along=Z, length=h)
    upper = _link(rng, "shoulder", Y, (0.05, 0.0, h), mass=rng.uniform(1.5, 5.0), along=X, length=a)
    fore = _link(rng, "elbow", Y, (a, 0.0, 0.0), mass=rng.uniform(0.6, 2.5), along=X, length=b)
    return waist, replace(upper, home=-0.4), replace(fore, home=0.7)


def _scara(rng: np.random.Generator) -> tuple[Part, ...]:
    a, b = rng.uniform(0.25, 0.45), rng.uniform(0.2, 0.4)
    inner = _link(rng, "inner", Z, (0.0, 0.0, 0.3), mass=rng.uniform(3.0, 8.0), along=X, length=a)
    outer = _link(rng, "outer", Z, (a, 0.0, 0.0), mass=rng.uniform(1.5, 4.0), along=X, length=b)
    quill = _link(rng, "quill", Z, (b, 0.0, 0.0), mass=rng.uniform(0.6, 2.0), along=Z, length=0.3)
    return inner, replace(outer, home=0.5), _slide(rng, quill, (0.06, 0.12))


def _arm6(rng: np.random.Generator) -> tuple[Part, ...]:
    h, a, b, c = rng.uniform(0.1, 0.2), rng.uniform(0.3, 0.5), rng.uniform(0.25, 0.45), rng.uniform(0.08, 0.15)
    waist = _link(rng, "a1", Z, (0.0, 0.0, 0.1), mass=rng.uniform(3.0, 7.0), along=Z, length=h)
    upper = _link(rng, "a2", Y, (0.0, 0.08, h), mass=rng.uniform(4.0, 9.0), along=X, length=a)
    fore = _link(rng, "a3", Y, (a, -0.05, 0.0), mass=rng.uniform(2.0, 4.0), along=X, length=0.6 * b)
    roll = _link(rng, "a4", X, (0.6 * b, 0.0, 0.0), mass=rng.uniform(0.8, 2.0), along=X, length=0.4 * b)
    wrist = _link(rng, "a5", Y, (0.4 * b, 0.0, 0.0), mass=rng.uniform(0.6, 1.5), along=X, length=c)
    flange = _link(rng, "a6", X, (c, 0.0, 0.0), mass=rng.uniform(0.3, 1.0), along=Z, length=0.12)
    return waist, replace(upper, home=-0.6), replace(fore, home=0.9), roll, replace(wrist, home=0.4), flange


def _gantry(rng: np.random.Generator) -> tuple[Part, ...]:
    cart = _link(rng, "carriage", X, (0.0, 0.0, 1.0), mass=rng.uniform(3.0, 9.0), along=Y, length=0.2)
    rod = _link(rng, "swing", Y, (0.0, 0.1, 0.0), mass=rng.uniform(0.8, 3.0), along=Z, length=rng.uniform(0.3, 0.6))
    hanging = tuple(-x for x in rod.center)
    return _slide(rng, cart, (0.15, 0.4)), replace(rod, center=hanging)


def _pan_tilt(rng: np.random.Generator) -> tuple[Part, ...]:
    yoke = _link(rng, "pan", Z, (0.0, 0.0, 0.1), mass=rng.uniform(1.0, 4.0), along=Z, length=rng.uniform(0.12, 0.25))
    head = _link(rng, "tilt", Y, (0.0, 0.0, 0.2), mass=rng.uniform(0.8, 3.0), along=X, length=rng.uniform(0.15, 0.35))
    return yoke, head


DRAWS: dict[str, Callable[[np.random.Generator], tuple[Part, ...]]] = {
    "arm2": _arm2,
    "arm3": _arm3,
    "scara": _scara,
    "arm6": _arm6,
    "gantry": _gantry,
    "pan_tilt": _pan_tilt,
}
KINDS = tuple(DRAWS)


def drawn_robot(rng: np.random.Generator, kind: str) -> Robot:
    """Lengths, masses and encoders of a robot; rotors and friction follow once its torques are known."""
    return Robot(kind, DRAWS[kind](rng))


def with_drives(rng: np.random.Generator, robot: Robot, moved: np.ndarray, torque: np.ndarray) -> Robot:
    """Rotors in proportion to what they move, friction in proportion to the torque of the motion.

    Args:
        moved: Inertia about each joint [kg m^2 or kg], shape ``(n,)``.
        torque: Root mean square torque of the rigid parts [N m or N], shape ``(n,)``.
    """
    parts = []
    for part, inertia, level in zip(robot.parts, moved, torque, strict=True):
        rotor = inertia * np.exp(rng.uniform(np.log(0.08), np.log(0.8)))
        dry = level * np.exp(rng.uniform(np.log(0.05), np.log(0.25)))
        wet = level * rng.uniform(0.03, 0.15) / part.speed
        parts.append(replace(part, rotor=float(rotor), dry=float(dry), wet=float(wet)))
    return replace(robot, parts=tuple(parts))


def _factor(rng: np.random.Generator, sigma: float, even: bool) -> float:
    """One plus a draw of the tolerance: normal, cut at two sigma, or even over all of it."""
    if even:
        return 1.0 + float(rng.uniform(-TWO_SIGMA, TWO_SIGMA)) * sigma
    return 1.0 + float(np.clip(rng.normal(), -TWO_SIGMA, TWO_SIGMA)) * sigma


def true_robot(rng: np.random.Generator, given: Robot, tolerance: Tolerance, *, even: bool) -> Robot:
    """The robot that the given model describes wrongly, within the tolerance everywhere."""
    parts = []
    for part in given.parts:
        away = max(float(np.linalg.norm(part.center)), 0.02)
        push = rng.normal(size=3)
        push *= min(abs(_factor(rng, tolerance.inertia, even) - 1.0) * away / np.linalg.norm(push), away)
        turn = _factor(rng, tolerance.inertia, even)
        parts.append(
            replace(
                part,
                mass=part.mass * _factor(rng, tolerance.inertia, even),
                center=tuple(np.array(part.center) + push),
                inertia=tuple(turn * x for x in part.inertia),
                dry=part.dry * _factor(rng, tolerance.friction, even),
                wet=part.wet * _factor(rng, tolerance.friction, even),
                rotor=part.rotor * _factor(rng, tolerance.rotor_inertia, even),
            )
        )
    return replace(given, parts=tuple(parts))


def encoder_step(part: Part) -> float:
    """What one count is [rad or m]."""
    return 1.0 / part.counts if part.linear else 2.0 * pi / part.counts
