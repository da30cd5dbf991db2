"""The robots of the sealed cases as tables of links, drawn from a seed, and their two files for the diagnosis."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

Vector3 = tuple[float, float, float]
ROBOTS = ("pendulum", "planar2", "spatial3")
GRAVITY = 9.81


@dataclass(frozen=True)
class Link:
    """One moving link and the revolute joint that carries it; the link frame is the joint frame.

    Attributes:
        joint: Name of the joint.
        origin: Place of the joint in the frame of the link before [m].
        axis: Joint axis, the same in both frames.
        mass: [kg].
        center: Centre of mass in the joint frame [m].
        inertia: Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass [kg m2].
        viscous: Modelled viscous coefficient [N m s/rad].
        coulomb: Modelled Coulomb torque [N m].
        rotor_inertia: On the joint side [kg m2].
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


@dataclass(frozen=True)
class Table:
    """A robot: a chain of links on a fixed base."""

    name: str
    links: tuple[Link, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints from the base outwards."""
        return tuple(link.joint for link in self.links)


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
    rng: np.random.Generator, joint: str, origin: Vector3, axis: Vector3, mass: float, length: float, direction: Vector3
) -> Link:
    along = int(np.argmax(np.abs(direction)))
    share, side = rng.uniform(0.35, 0.65), rng.uniform(-0.03, 0.03, size=3)
    side[along] = 0.0
    center = tuple(float(x) for x in share * length * np.asarray(direction) + side)
    return Link(joint, origin, axis, mass, center, rod_inertia(mass, length, rng.uniform(0.02, 0.06), along))


def _with_drives(rng: np.random.Generator, table: Table) -> Table:
    """Modelled friction and rotor inertias of a few per cent of what the joint has to move."""
    links = []
    for first, link in enumerate(table.links):
        reach, inertia, weight = 0.0, 0.0, 0.0
        for later in table.links[first:]:
            step = np.zeros(3) if later is link else np.asarray(later.origin)
            reach += float(np.linalg.norm(step))
            arm = reach + float(np.linalg.norm(later.center))
            inertia += later.mass * arm**2
            weight += later.mass * arm * GRAVITY
        vertical = abs(link.axis[2]) > 0.5
        scale = 4.0 * inertia + (0.0 if vertical else 0.6 * weight)
        links.append(
            replace(
                link,
                viscous=scale * rng.uniform(0.01, 0.04),
                coulomb=scale * rng.uniform(0.02, 0.06),
                rotor_inertia=inertia * rng.uniform(0.03, 0.25),
            )
        )
    return Table(table.name, tuple(links))


def draw_table(rng: np.random.Generator, name: str) -> Table:
    """The model of a robot as its owner knows it: links of 0.3 to 5 kg and 0.15 to 0.45 m."""
    y, z, down, out = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)
    if name == "pendulum":
        mass, length = np.exp(rng.uniform(np.log(0.3), np.log(5.0))), rng.uniform(0.2, 0.45)
        links = [_drawn_link(rng, "j1", (0.0, 0.0, 0.0), y, mass, length, down)]
    elif name == "planar2":
        masses, lengths = np.sort(rng.uniform(0.4, 4.0, size=2))[::-1], rng.uniform(0.2, 0.4, size=2)
        links = [
            _drawn_link(rng, "j1", (0.0, 0.0, 0.0), y, masses[0], lengths[0], down),
            _drawn_link(rng, "j2", (0.0, 0.0, -lengths[0]), y, masses[1], lengths[1], down),
        ]
    elif name == "spatial3":
        masses, lengths = np.sort(rng.uniform(0.4, 5.0, size=3))[::-1], rng.uniform(0.15, 0.4, size=3)
        links = [
            _drawn_link(rng, "j1", (0.0, 0.0, 0.1), z, masses[0], lengths[0], z),
            _drawn_link(rng, "j2", (0.0, 0.0, lengths[0]), y, masses[1], lengths[1], out),
            _drawn_link(rng, "j3", (lengths[1], 0.0, 0.0), y, masses[2], lengths[2], out),
        ]
    else:
        raise ValueError(f"No robot {name!r}: the generator has {', '.join(ROBOTS)}.")
    return _with_drives(rng, Table(name, tuple(links)))


def _factor(rng: np.random.Generator, sigma: float) -> float:
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


def perturbed(rng: np.random.Generator, table: Table, tolerance: Tolerance) -> Table:
    """The true robot: every inertia, modelled friction and rotor inertia off by an independent draw."""
    links = []
    for link in table.links:
        mass, center, inertia = (_factor(rng, tolerance.inertia) for _ in range(3))
        links.append(
            replace(
                scaled_link(link, mass, center, inertia),
                viscous=link.viscous * _factor(rng, tolerance.friction),
                coulomb=link.coulomb * _factor(rng, tolerance.friction),
                rotor_inertia=link.rotor_inertia * _factor(rng, tolerance.rotor_inertia),
            )
        )
    return Table(table.name, tuple(links))


def _triple(values: tuple[float, ...]) -> str:
    return " ".join(f"{x:.9g}" for x in values)


def urdf_text(table: Table) -> str:
    """The robot as URDF, modelled friction in ``<dynamics>``."""
    lines = ['<?xml version="1.0"?>', f'<robot name="{table.name}">', '  <link name="base"/>']
    parent = "base"
    for number, link in enumerate(table.links, start=1):
        moments = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), link.inertia, strict=True)
        lines += [
            f'  <link name="link{number}">',
            "    <inertial>",
            f'      <origin xyz="{_triple(link.center)}" rpy="0 0 0"/>',
            f'      <mass value="{link.mass:.9g}"/>',
            "      <inertia " + " ".join(f'{name}="{x:.9g}"' for name, x in moments) + "/>",
            "    </inertial>",
            "  </link>",
            f'  <joint name="{link.joint}" type="revolute">',
            f'    <parent link="{parent}"/>',
            f'    <child link="link{number}"/>',
            f'    <origin xyz="{_triple(link.origin)}" rpy="0 0 0"/>',
            f'    <axis xyz="{_triple(link.axis)}"/>',
            '    <limit lower="-3.1" upper="3.1" effort="1000" velocity="30"/>',
            f'    <dynamics damping="{link.viscous:.9g}" friction="{link.coulomb:.9g}"/>',
            "  </joint>",
        ]
        parent = f"link{number}"
    return "\n".join([*lines, "</robot>", ""])


def robot_yaml(table: Table, *, torque_hold: str, encoder_counts: int, tolerance: Tolerance) -> str:
    """What the owner states beside the URDF."""
    lines = [
        f"gravity: [0, 0, -{GRAVITY}]",
        f"torque_hold: {torque_hold}",
        "torque_source: command",
        f"tolerance: {{inertia: {tolerance.inertia}, friction: {tolerance.friction}, "
        f"rotor_inertia: {tolerance.rotor_inertia}}}",
        "joints:",
    ]
    for link in table.links:
        lines.append(f"  {link.joint}: {{rotor_inertia: {link.rotor_inertia:.9g}, encoder_counts: {encoder_counts}}}")
    return "\n".join([*lines, ""])
