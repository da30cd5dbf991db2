"""Robots as people have them, drawn around typical values: what their files say, and what they truly are.

The file is drawn first; the true robot is the file with every mass, inertia, centre of mass, friction and rotor
inertia off by the stated tolerances.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .dynamics import Chain

Array = np.ndarray
Rng = np.random.Generator
HALF = np.pi / 2
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
INERTIA, FRICTION, ROTOR = 0.05, 0.05, 0.10  # the tolerances of a robot.yaml that states none, one sigma


@dataclass(frozen=True)
class Joint:
    """One joint and its link, as a data sheet says them.

    Attributes:
        name: Of the joint.
        axis: In the joint's frame.
        xyz: Origin in the frame before [m].
        rpy: Orientation there: fixed axes, roll first [rad].
        mass: Of the link [kg].
        center: Of its mass in the joint's frame [m].
        size: Box that the link's inertia is taken from [m].
        home: Middle of its motions [rad or m].
        swing: Largest way from there [rad or m].
        speed: Usual top speed [rad/s or m/s].
        coulomb: Coulomb torque [N m or N].
        viscous: Viscous coefficient.
        rotor: Rotor inertia on the joint's side.
        linear: A linear axis.
    """

    name: str
    axis: tuple[float, float, float]
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    mass: float
    center: tuple[float, float, float]
    size: tuple[float, float, float]
    home: float
    swing: float
    speed: float
    coulomb: float
    viscous: float
    rotor: float
    linear: bool = False


@dataclass(frozen=True)
class Kind:
    """A kind of robot.

    Attributes:
        name: For answers and the robot file.
        joints: From the base outwards.
        counts: Encoder steps a revolution or metre; those above `FINE` need not be stated.
        rates: Usual rates of its logs [Hz].
        mjcf: The file is MJCF, else URDF.
        fingers: The last link carries two fingers that the configuration locks.
        feedforward: The controller knows the model; else it holds gravity at most.
    """

    name: str
    joints: tuple[Joint, ...]
    counts: float
    rates: tuple[float, ...]
    mjcf: bool = False
    fingers: bool = False
    feedforward: bool = True


@dataclass(frozen=True)
class Robot:
    """A robot and its file: every array has one entry a joint.

    Attributes:
        kind: What it is.
        given: Chain as the file says it.
        true: Chain as it is.
        coulomb: Coulomb torques in the file; ``true_coulomb`` as they are.
        viscous: Coefficients in the file; ``true_viscous`` as they are.
        rotor: Rotor inertias in file and configuration; ``true_rotor`` as they are.
        static: What must be overcome to start, over the true Coulomb torque, less one.
        slide: Speed within which that is lost.
    """

    kind: Kind
    given: Chain
    true: Chain
    coulomb: Array
    viscous: Array
    rotor: Array
    true_coulomb: Array
    true_viscous: Array
    true_rotor: Array
    static: Array
    slide: Array

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.kind.joints)

    def each(self, what: str) -> Array:
        """One property of all joints."""
        return np.array([getattr(joint, what) for joint in self.kind.joints], dtype=float)


def turned(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation of a URDF's ``rpy``, shape ``(3, 3)``."""
    (cr, sr), (cp, sp), (cy, sy) = ((np.cos(x), np.sin(x)) for x in (roll, pitch, yaw))
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return about_z @ about_y @ about_x


def _ur(_: Rng) -> Kind:
    def j(name: str, axis: tuple, xyz: tuple, pitch: float, m: float, c: tuple, box: tuple, *more: Any) -> Joint:
        return Joint(f"{name}_joint", axis, xyz, (0, pitch, 0), m, c, box, *more)

    small = (0.1, 0.1, 0.1)
    return Kind(
        "ur",
        (
            j("shoulder_pan", Z, (0, 0, 0.0892), 0, 3.7, (0, 0, 0), (0.14, 0.14, 0.16), 0.0, 1.6, 1.2, 7.0, 8.0, 1.9),
            j("shoulder_lift", Y, (0, 0.1358, 0), HALF, 8.4, (0, 0, 0.22), (0.12, 0.12, 0.5), -1.2, 0.7, 1.0, 8, 9, 2),
            j("elbow", Y, (0, -0.1197, 0.425), 0, 2.3, (0, 0, 0.25), (0.1, 0.1, 0.42), 1.4, 0.9, 1.2, 4.5, 5, 0.9),
            j("wrist_1", Y, (0, 0, 0.3923), HALF, 1.22, (0, 0.06, 0), small, -0.8, 1.4, 1.5, 1.0, 0.9, 0.17),
            j("wrist_2", Z, (0, 0.093, 0), 0, 1.22, (0, 0, 0.06), small, 0.9, 1.4, 1.5, 0.9, 0.9, 0.17),
            j("wrist_3", Y, (0, 0, 0.0947), 0, 0.6, (0, 0.05, 0.02), (0.09, 0.12, 0.07), 0, 2, 1.8, 0.8, 0.7, 0.16),
        ),
        2.0**20,
        (125.0, 500.0),
    )


def _panda(_: Rng) -> Kind:
    def j(i: int, xyz: tuple, roll: float, m: float, c: tuple, box: tuple, *more: Any) -> Joint:
        return Joint(f"panda_joint{i}", Z, xyz, (roll, 0, 0), m, c, box, *more)

    return Kind(
        "panda",
        (
            j(1, (0, 0, 0.333), 0, 3.0, (0, -0.03, -0.07), (0.12, 0.2, 0.28), 0, 1.2, 1.2, 1.1, 1.0, 0.6),
            j(2, (0, 0, 0), -HALF, 3.0, (0, -0.07, 0.03), (0.12, 0.28, 0.2), -0.4, 0.7, 1.0, 1.2, 1.2, 0.6),
            j(3, (0, -0.316, 0), HALF, 3.2, (0.03, 0.03, -0.06), (0.14, 0.15, 0.24), 0, 0.9, 1.2, 0.9, 0.9, 0.5),
            j(4, (0.0825, 0, 0), HALF, 3.2, (-0.05, 0.1, 0.03), (0.14, 0.25, 0.15), -1.9, 0.6, 1.1, 1.0, 0.9, 0.5),
            j(5, (-0.0825, 0.384, 0), -HALF, 2.3, (0, 0.04, -0.11), (0.1, 0.12, 0.3), 0, 1.2, 1.5, 0.5, 0.4, 0.2),
            j(6, (0, 0, 0), HALF, 1.7, (0.06, -0.01, -0.01), (0.15, 0.12, 0.12), 1.7, 0.8, 1.4, 0.4, 0.4, 0.2),
            j(7, (0.088, 0, 0), HALF, 1.5, (0.01, 0.01, 0.1), (0.15, 0.12, 0.12), 0.8, 1.3, 1.6, 0.35, 0.3, 0.15),
        ),
        2.0**21,
        (100.0, 1000.0),
        fingers=True,
    )


def _scara(_: Rng) -> Kind:
    none, box = (0.0, 0.0, 0.0), (0.3, 0.12, 0.12)
    return Kind(
        "scara",
        (
            Joint("axis_1", Z, (0, 0, 0.3), none, 8.0, (0.16, 0, 0), box, 0.3, 1.4, 2.2, 3.0, 2.0, 0.5),
            Joint("axis_2", Z, (0.325, 0, 0.05), none, 5.0, (0.12, 0, 0.05), box, 0.5, 1.6, 2.5, 1.6, 0.9, 0.2),
            Joint("axis_z", Z, (0.275, 0, 0), none, 1.3, (0, 0, -0.1), (0.05, 0.05, 0.4), 0, 0.09, 0.3, 9, 30, 5, True),
            Joint("axis_4", Z, (0, 0, -0.2), none, 0.9, (0.06, 0, 0), (0.2, 0.1, 0.05), 0, 2.5, 3.0, 0.25, 0.1, 0.02),
        ),
        2.0**20,
        (200.0, 500.0),
    )


def _gantry(rng: Rng) -> Kind:
    none, box = (0.0, 0.0, 0.0), (0.3, 0.3, 0.3)
    axes = (
        Joint("x", X, (0, 0, 1.0), none, 22.0, (0, 0, 0), box, 0, 0.4, 0.5, 30.0, 60.0, 8.0, True),
        Joint("y", Y, (0, 0, 0.1), none, 9.0, (0, 0, 0), box, 0, 0.3, 0.5, 18.0, 40.0, 4.0, True),
        Joint("z", Z, (0, 0, 0.1), none, 4.0, (0, 0, -0.1), box, 0, 0.15, 0.3, 9.0, 25.0, 2.0, True),
    )
    return Kind("gantry", axes if rng.random() < 0.6 else (axes[0], axes[2]), 1.0e6, (100.0, 250.0, 1000.0))


def _leg(_: Rng) -> Kind:
    none = (0.0, 0.0, 0.0)
    thin, box = (0.04, 0.04, 0.22), (0.1, 0.1, 0.1)
    return Kind(
        "leg",
        (
            Joint("hip_roll", X, (0.18, 0.05, 0.6), none, 0.7, (0, 0.01, 0), box, 0.1, 0.5, 3, 0.25, 0.08, 0.006),
            Joint(
                "hip_pitch",
                Y,
                (0, 0.08, 0),
                none,
                1.1,
                (0, -0.02, -0.03),
                (0.06, 0.09, 0.2),
                0.8,
                0.7,
                4,
                0.25,
                0.08,
                6e-3,
            ),
            Joint("knee", Y, (0, 0, -0.213), none, 0.25, (0, 0, -0.12), thin, -1.6, 0.7, 5, 0.25, 0.08, 0.012),
        ),
        2.0**16,
        (200.0, 500.0, 1000.0),
    )


def _so101(rng: Rng) -> Kind:
    none, box = (0.0, 0.0, 0.0), (0.05, 0.04, 0.1)
    sheet = (
        ("shoulder_pan", Z, (0, 0, 0.06), 0.12, (0.0, 0, 0.02), 0.0, 1.2, 1.4),
        ("shoulder_lift", Y, (0.03, 0, 0.05), 0.13, (0, 0, 0.06), 0.1, 0.8, 1.2),
        ("elbow_flex", Y, (0.02, 0, 0.113), 0.12, (0.06, 0, 0.01), 0.2, 0.9, 1.4),
        ("wrist_flex", Y, (0.135, 0, 0), 0.10, (0.04, 0, 0), 0.3, 1.0, 1.6),
        ("wrist_roll", X, (0.06, 0, 0), 0.14, (0.04, 0.01, 0.0), 0.0, 1.4, 1.8),
        ("gripper", Y, (0.03, 0.02, 0), 0.03, (0.04, 0, 0), 0.4, 0.6, 2.0),
    )
    joints = tuple(
        Joint(name, axis, xyz, none, m, c, box, home, swing, speed, 0.06, 0.1, 0.028)
        for name, axis, xyz, m, c, home, swing, speed in sheet[: 5 + int(rng.integers(2))]
    )
    return Kind("so101", joints, 4096.0, (100.0, 200.0), mjcf=True, feedforward=False)


def _pan_tilt(_: Rng) -> Kind:
    none, box = (0.0, 0.0, 0.0), (0.12, 0.1, 0.15)
    return Kind(
        "pan_tilt",
        (
            Joint("pan", Z, (0, 0, 0.1), none, 0.6, (0.01, 0, 0.03), box, 0, 1.5, 1.8, 0.12, 0.05, 0.004),
            Joint("tilt", Y, (0, 0, 0.09), none, 1.3, (0.06, 0.0, 0.02), box, 0.0, 0.7, 1.5, 0.10, 0.05, 0.004),
        ),
        2.0**15,
        (100.0, 250.0, 500.0),
    )


KINDS: tuple[Callable[[Rng], Kind], ...] = (_ur, _panda, _scara, _gantry, _leg, _so101, _pan_tilt)
FINE = 2.0**18  # encoder steps a revolution beyond which nobody states them


def _off(rng: Rng, sigma: float, size: int) -> Array:
    """Factors around one, normal, cut off at two sigma."""
    return 1.0 + sigma * np.clip(rng.standard_normal(size), -2.0, 2.0)


def chain_of(joints: tuple[Joint, ...]) -> Chain:
    """The links as their boxes say."""
    boxes = np.array([joint.size for joint in joints]) ** 2
    mass = np.array([joint.mass for joint in joints])
    squares = boxes.sum(axis=1, keepdims=True) - boxes
    return Chain(
        linear=np.array([joint.linear for joint in joints]),
        axis=np.array([joint.axis for joint in joints], dtype=float),
        turn=np.array([turned(*joint.rpy) for joint in joints]),
        place=np.array([joint.xyz for joint in joints], dtype=float),
        mass=mass,
        center=np.array([joint.center for joint in joints], dtype=float),
        inertia=np.array([np.diag(m / 12.0 * box) for m, box in zip(mass, squares, strict=True)]),
        gravity=np.array([0.0, 0.0, -9.81]),
    )


def _spread(joint: Joint, rng: Rng) -> Joint:
    """A joint of another maker: masses, friction and rotor differ by tens of percent, lengths by a few."""
    mass, coulomb, viscous, rotor = np.exp(rng.normal(0.0, (0.15, 0.3, 0.3, 0.25)))
    length = float(np.exp(rng.normal(0.0, 0.05)))
    return replace(
        joint,
        mass=round(joint.mass * mass, 4),
        xyz=tuple(round(x * length, 5) for x in joint.xyz),
        center=tuple(round(x + rng.normal(0.0, 0.004), 5) for x in joint.center),
        coulomb=round(joint.coulomb * coulomb, 5),
        viscous=round(joint.viscous * viscous, 5),
        rotor=round(joint.rotor * rotor, 6),
    )


def draw_robot(rng: Rng, which: int, *, configured: bool) -> Robot:
    """A robot of a kind; without a configuration a URDF cannot state a rotor, and the robot then has none."""
    kind = KINDS[which % len(KINDS)](rng)
    joints = tuple(_spread(joint, rng) for joint in kind.joints)
    if not configured and not kind.mjcf:
        joints = tuple(replace(joint, rotor=0.0) for joint in joints)
    kind, given, n = replace(kind, joints=joints), chain_of(joints), len(joints)
    true = replace(
        given,
        mass=given.mass * _off(rng, INERTIA, n),
        center=given.center * _off(rng, INERTIA, n)[:, None],
        inertia=given.inertia * _off(rng, INERTIA, n)[:, None, None],
    )
    coulomb, viscous, rotor = (np.array([getattr(j, x) for j in joints]) for x in ("coulomb", "viscous", "rotor"))
    return Robot(
        kind=kind,
        given=given,
        true=true,
        coulomb=coulomb,
        viscous=viscous,
        rotor=rotor,
        true_coulomb=coulomb * _off(rng, FRICTION, n),
        true_viscous=viscous * _off(rng, FRICTION, n),
        true_rotor=rotor * _off(rng, ROTOR, n),
        static=np.abs(np.clip(rng.normal(0.0, 0.03, n), -0.06, 0.06)),
        slide=np.array([j.speed for j in joints]) * rng.uniform(0.01, 0.04, n),
    )
