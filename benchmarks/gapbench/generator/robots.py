"""The robots of the sealed cases as tables of links: the types, and the three that are drawn from a seed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

Vector3 = tuple[float, ...]
GRAVITY = 9.81
DOWN = (0.0, 0.0, -GRAVITY)


@dataclass(frozen=True)
class Link:
    """One moving link and the revolute joint that carries it; the link frame is the joint frame.

    Attributes:
        joint: Name of the joint.
        origin: Place of the joint in the frame of its parent [m].
        axis: Joint axis in the joint frame.
        mass: [kg].
        center: Centre of mass in the joint frame [m].
        inertia: Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass [kg m2].
        viscous: Modelled viscous coefficient [N m s/rad].
        coulomb: Modelled Coulomb torque [N m].
        rotor_inertia: On the joint side [kg m2].
        rotation: Roll, pitch, yaw of the joint frame in the frame of its parent [rad].
        parent: Index of the parent link; -1 is the base.
    """

    joint: str
    origin: Vector3
    axis: Vector3
    mass: float
    center: tuple[float, ...]
    inertia: tuple[float, ...]
    viscous: float = 0.0
    coulomb: float = 0.0
    rotor_inertia: float = 0.0
    rotation: Vector3 = (0.0, 0.0, 0.0)
    parent: int = -1


@dataclass(frozen=True)
class Pin:
    """A loop of a closed chain: a point of one link stays on a point of another, as MuJoCo's ``connect``."""

    first: int
    point: Vector3
    second: int


@dataclass(frozen=True)
class Table:
    """A robot: a tree of links on a fixed base, depth first, closed by pins where it is a closed chain.

    Attributes:
        name: Of the robot.
        links: Depth first.
        gravity: In the base frame [m/s2].
        passive: Per passive joint its name and the coefficients of the active joints it follows.
        pins: What closes the loops when the robot moves.
        posture: Middle of the motion, one angle per active joint [rad]; empty means zero.
    """

    name: str
    links: tuple[Link, ...]
    gravity: Vector3 = DOWN
    passive: tuple[tuple[str, tuple[tuple[str, float], ...]], ...] = ()
    pins: tuple[Pin, ...] = ()
    posture: tuple[float, ...] = ()

    @property
    def active(self) -> tuple[int, ...]:
        """Indices of the links whose joint has a drive."""
        passive = {name for name, _ in self.passive}
        return tuple(i for i, link in enumerate(self.links) if link.joint not in passive)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the active joints from the base outwards."""
        return tuple(self.links[i].joint for i in self.active)

    @property
    def driven(self) -> tuple[Link, ...]:
        """The links whose joint has a drive."""
        return tuple(self.links[i] for i in self.active)

    def selection(self) -> np.ndarray:
        """Tree velocities per active velocities, ``(len(links), len(active))``."""
        names, follows = self.joints, dict(self.passive)
        out = np.zeros((len(self.links), len(names)))
        for i, link in enumerate(self.links):
            for name, coefficient in follows.get(link.joint, ((link.joint, 1.0),)):
                out[i, names.index(name)] = coefficient
        return out

    def with_link(self, i: int, link: Link) -> Table:
        """The robot with one link replaced."""
        return replace(self, links=(*self.links[:i], link, *self.links[i + 1 :]))


@dataclass(frozen=True)
class Tolerance:
    """Relative one-sigma trust in the model; draws are truncated at two sigma."""

    inertia: float = 0.05
    friction: float = 0.05
    rotor_inertia: float = 0.10


def rod_inertia(mass: float, length: float, radius: float, along: int) -> tuple[float, ...]:
    """Inertia of a solid cylinder about its centre, axis ``along`` (0 x, 1 y, 2 z), as Ixx .. Iyz [kg m2]."""
    across = mass * (3.0 * radius**2 + length**2) / 12.0
    moments = [across, across, across]
    moments[along] = 0.5 * mass * radius**2
    return (*moments, 0.0, 0.0, 0.0)


def _drawn_link(
    rng: np.random.Generator, origin: Vector3, axis: Vector3, mass: float, length: float, direction: Vector3
) -> Link:
    along = int(np.argmax(np.abs(direction)))
    share, side = rng.uniform(0.35, 0.65), rng.uniform(-0.03, 0.03, size=3)
    side[along] = 0.0
    center = tuple(float(x) for x in share * length * np.asarray(direction) + side)
    return Link("", origin, axis, mass, center, rod_inertia(mass, length, rng.uniform(0.02, 0.06), along))


def drawn_chain(rng: np.random.Generator, name: str) -> Table:
    """Pendulum, planar or spatial arm: links of 0.3 to 5 kg and 0.15 to 0.45 m, still without friction and rotors."""
    y, z, down, out = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
    zero = (0.0, 0.0, 0.0)
    if name == "pendulum":
        mass, length = float(np.exp(rng.uniform(np.log(0.3), np.log(5.0)))), rng.uniform(0.2, 0.45)
        links = [_drawn_link(rng, zero, y, mass, length, down)]
    elif name == "planar2":
        m, n = np.sort(rng.uniform(0.4, 4.0, size=2))[::-1], rng.uniform(0.2, 0.4, size=2)
        links = [
            _drawn_link(rng, zero, y, float(m[0]), n[0], down),
            _drawn_link(rng, (0.0, 0.0, float(-n[0])), y, float(m[1]), n[1], down),
        ]
    else:
        m, n = np.sort(rng.uniform(0.4, 5.0, size=3))[::-1], rng.uniform(0.15, 0.4, size=3)
        links = [
            _drawn_link(rng, (0.0, 0.0, 0.1), z, float(m[0]), n[0], z),
            _drawn_link(rng, (0.0, 0.0, float(n[0])), y, float(m[1]), n[1], out),
            _drawn_link(rng, (float(n[1]), 0.0, 0.0), y, float(m[2]), n[2], out),
        ]
    named = tuple(replace(link, joint=f"j{i + 1}", parent=i - 1) for i, link in enumerate(links))
    return Table(name, named)


def _factor(rng: np.random.Generator, sigma: float, full: bool) -> float:
    if full:
        return 1.0 + sigma * rng.uniform(-2.0, 2.0)
    draw = rng.normal()
    while abs(draw) > 2.0:
        draw = rng.normal()
    return 1.0 + sigma * draw


def scaled_link(link: Link, mass: float, center: float, inertia: float) -> Link:
    """The link with its mass, centre and inertia about the centre multiplied by three factors."""
    return replace(
        link,
        mass=link.mass * mass,
        center=tuple(center * x for x in link.center),
        inertia=tuple(inertia * x for x in link.inertia),
    )


def moved_center(link: Link, by: tuple[float, ...]) -> Link:
    """The link with its centre moved in three directions, in parts of its distance from the joint."""
    distance = float(np.linalg.norm(link.center))
    return replace(link, center=tuple(x + distance * part for x, part in zip(link.center, by, strict=True)))


def perturbed(rng: np.random.Generator, table: Table, tolerance: Tolerance, *, full: bool = False) -> Table:
    """The true robot: every inertia, modelled friction and rotor inertia off by an independent draw.

    A centre of mass is off in three directions alike, in parts of its distance from the joint: a part mounted aside or
    a cable does not know along which axis the file puts the centre. ``full`` draws evenly over two tolerances in place
    of normally.
    """
    links = []
    for link in table.links:
        mass, inertia, *center = (_factor(rng, tolerance.inertia, full) for _ in range(5))
        links.append(
            replace(
                moved_center(scaled_link(link, mass, 1.0, inertia), tuple(x - 1.0 for x in center)),
                viscous=link.viscous * _factor(rng, tolerance.friction, full),
                coulomb=link.coulomb * _factor(rng, tolerance.friction, full),
                rotor_inertia=link.rotor_inertia * _factor(rng, tolerance.rotor_inertia, full),
            )
        )
    return replace(table, links=tuple(links))
