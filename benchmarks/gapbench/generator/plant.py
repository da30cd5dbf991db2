# pyright: reportAttributeAccessIssue=false
"""The true machine: a table of links with whatever is wrong with it, compiled for MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from .robots import Link, Table

INNER_STEP = 2.5e-4
CONTACT_TIME = 1e-3  # [s]: time constant with which a gap closes, critically damped
SPRING_DAMPING = 0.02  # of critical, for the motor against a compliant transmission


@dataclass(frozen=True)
class JointFriction:
    """Friction of one joint that the model lacks; the torque opposes motion.

    ``v > 0``: -(positive + c_positive v), ``v < 0``: negative - c_negative v, plus a part
    -extra exp(-(v/speed)^2) sign(v) that fades with speed.
    """

    positive: float = 0.0
    negative: float = 0.0
    c_positive: float = 0.0
    c_negative: float = 0.0
    extra: float = 0.0
    speed: float = 1.0


@dataclass(frozen=True)
class Coupling:
    """Friction and inertia of what turns with ``v_first + ratio v_second``."""

    first: int
    second: int
    ratio: float
    torque: float
    coefficient: float
    inertia: float


@dataclass(frozen=True)
class Encoder:
    """What is wrong with an encoder: reading = q + offset + amplitude sin(order q + phase), rounded to ``step``."""

    offset: float = 0.0
    amplitude: float = 0.0
    phase: float = 0.0
    order: float = 1.0
    step: float = 0.0


@dataclass(frozen=True)
class Channel:
    """What lies between the logged torque and the joint: delay, then lag [s], then the clip, then the ratio."""

    delay: float = 0.0
    lag: float = 0.0
    limit: float = np.inf
    ratio: float = 1.0


@dataclass(frozen=True)
class Outside:
    """A cause outside the catalogue; ``joint`` is a link's index, -1 for all."""

    name: str
    joint: int
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Plant:
    """What moves: the links, and what the links do not say, by index of the link.

    Attributes:
        table: True links, payload included.
        friction: What the model lacks.
        springs: Stiffness [N m/rad] and rest position [rad].
        offset: Constant torque [N m].
        channels: Of the drives.
        compliance: Stiffness of the transmission [N m/rad].
        gaps: Full width of the backlash [rad].
        bristles: Dahl friction: level [N m] and displacement over which it builds up [rad].
        load_ratio: Friction per transmitted torque.
        cogging: Order, amplitude [N m], phase.
        couplings: Of two joints.
        encoders: Of the drives.
        outside: A cause outside the catalogue.
    """

    table: Table
    friction: Mapping[int, JointFriction] = field(default_factory=dict)
    springs: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    offset: Mapping[int, float] = field(default_factory=dict)
    channels: Mapping[int, Channel] = field(default_factory=dict)
    compliance: Mapping[int, float] = field(default_factory=dict)
    gaps: Mapping[int, float] = field(default_factory=dict)
    bristles: Mapping[int, tuple[float, float]] = field(default_factory=dict)
    load_ratio: Mapping[int, float] = field(default_factory=dict)
    cogging: Mapping[int, tuple[float, float, float]] = field(default_factory=dict)
    couplings: tuple[Coupling, ...] = ()
    encoders: Mapping[int, Encoder] = field(default_factory=dict)
    outside: Outside | None = None

    @property
    def motors(self) -> tuple[int, ...]:
        """Links that are driven through a transmission with a state of its own, in order."""
        return tuple(i for i in self.table.active if i in self.gaps or i in self.compliance)

    def drive(self, i: int) -> int:
        """Index in MuJoCo's velocities of what the drive of link ``i`` turns: its motor, or the joint itself."""
        return len(self.table.links) + self.motors.index(i) if i in self.motors else i


def with_point_mass(link: Link, mass: float, center: np.ndarray) -> Link:
    """The link with a point mass fixed at ``center`` of its joint frame (parallel axes, about the common centre)."""
    total, old = link.mass + mass, np.asarray(link.center)
    common = (link.mass * old + mass * np.asarray(center)) / total
    xx, yy, zz, xy, xz, yz = link.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    for m, place in ((link.mass, old), (mass, np.asarray(center))):
        r = place - common
        inertia = inertia + m * (r @ r * np.eye(3) - np.outer(r, r))
    flat = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    return replace(link, mass=total, center=tuple(map(float, common)), inertia=tuple(map(float, flat)))


def _numbers(values) -> str:
    return " ".join(f"{float(x):.15g}" for x in values)


def _joint(plant: Plant, i: int, *, motor: bool, rigid: bool) -> str:
    """Attributes of the hinge of link ``i``, or of its motor; friction and rotor sit where the encoder is."""
    link, extra = plant.table.links[i], plant.friction.get(i, JointFriction())
    if rigid:
        return f'armature="{link.rotor_inertia:.15g}"'
    # Impedance next to one and a time constant of two steps: sliding friction is the exact torque, sticking holds.
    law = f'solreffriction="{2.0 * INNER_STEP:.6g} 1" solimpfriction="0.9999 0.9999 0.001 0.5 2" '
    if motor or i not in plant.motors:
        damping = link.viscous + extra.c_positive
        # Damping is taken at the velocity half a step ago; this inertia makes it the mean over the step.
        law += f'armature="{link.rotor_inertia + 0.5 * INNER_STEP * damping:.15g}" damping="{damping:.15g}" '
        law += f'frictionloss="{link.coulomb + 0.5 * (extra.positive + extra.negative):.15g}" '
    if not motor:
        stiffness, rest = plant.springs.get(i, (0.0, 0.0))
        law += f'stiffness="{stiffness:.15g}" springref="{rest:.15g}"'
    return law


def _tree(plant: Plant, parent: int, rigid: bool) -> list[str]:
    lines = []
    for i, link in enumerate(plant.table.links):
        if link.parent == parent:
            lines += [
                f'<body name="b{i}" pos="{_numbers(link.origin)}" euler="{_numbers(link.rotation)}">',
                f'<inertial pos="{_numbers(link.center)}" mass="{link.mass:.15g}"',
                f'fullinertia="{_numbers(link.inertia)}"/>',
                f'<joint name="l{i}" axis="{_numbers(link.axis)}" {_joint(plant, i, motor=False, rigid=rigid)}/>',
                *_tree(plant, i, rigid),
                "</body>",
            ]
    return lines


def _motor(plant: Plant, i: int) -> list[str]:
    """The rotor of link ``i`` as a body of its own: its inertia is all that moves with it."""
    return [
        '<body><inertial pos="0 0 0" mass="1e-3" diaginertia="1e-12 1e-12 1e-12"/>',
        f'<joint name="m{i}" axis="0 0 1" {_joint(plant, i, motor=True, rigid=False)}/></body>',
    ]


def _transmissions(plant: Plant) -> list[str]:
    """Springs and gaps between motors and links, and couplings of two joints, as tendons over joint angles."""
    out = []
    for i in plant.motors:
        k, rotor = plant.compliance.get(i, 0.0), plant.table.links[i].rotor_inertia
        law = f'stiffness="{k:.15g}" damping="{2.0 * SPRING_DAMPING * np.sqrt(k * rotor):.15g}" springlength="0 0"'
        if i in plant.gaps:
            half = 0.5 * plant.gaps[i]
            law = f'limited="true" range="{-half:.15g} {half:.15g}" solreflimit="{CONTACT_TIME} 1"'
            law += ' solimplimit="0.95 0.99 0.0005"'
        out += [f'<fixed {law}><joint joint="m{i}" coef="1"/><joint joint="l{i}" coef="-1"/></fixed>']
    stick = f'solreffriction="{2.0 * INNER_STEP:.6g} 1" solimpfriction="0.9999 0.9999 0.001 0.5 2"'
    for c in plant.couplings:
        out += [
            f'<fixed frictionloss="{c.torque:.15g}" damping="{c.coefficient:.15g}" armature="{c.inertia:.15g}"',
            f"{stick}>",
            f'<joint joint="l{c.first}" coef="1"/><joint joint="l{c.second}" coef="{c.ratio:.15g}"/></fixed>',
        ]
    return out


def mjcf_text(plant: Plant, *, rigid: bool) -> str:
    """The machine as MJCF; ``rigid`` is the open tree without friction and springs (for inverse dynamics)."""
    lines = [
        '<mujoco><compiler angle="radian" eulerseq="XYZ" inertiafromgeom="false"/>',
        f'<option gravity="{_numbers(plant.table.gravity)}" timestep="{INNER_STEP}" integrator="Euler"',
        'iterations="30" tolerance="1e-12">',
        '<flag contact="disable" eulerdamp="disable"/></option><worldbody>',
        *_tree(plant, -1, rigid),
    ]
    if not rigid:
        for i in plant.motors:
            lines += _motor(plant, i)
    lines += ["</worldbody>"]
    tendons = [] if rigid else _transmissions(plant)
    if tendons:
        lines += ["<tendon>", *tendons, "</tendon>"]
    if plant.table.pins and not rigid:
        stiff = f'solref="{2.0 * INNER_STEP:.6g} 1" solimp="0.9999 0.9999 0.001 0.5 2"'
        lines += ["<equality>"]
        lines += [
            f'<connect body1="b{p.first}" body2="b{p.second}" anchor="{_numbers(p.point)}" {stiff}/>'
            for p in plant.table.pins
        ]
        lines += ["</equality>"]
    return "\n".join([*lines, "</mujoco>"])


def compiled(plant: Plant, *, rigid: bool = False) -> mujoco.MjModel:
    """The MuJoCo model of the machine."""
    return mujoco.MjModel.from_xml_string(mjcf_text(plant, rigid=rigid))
