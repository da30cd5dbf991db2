"""Numbers of a quadruped, a biped and an arm on moving bases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray
Place = tuple[float, float, float]
X, Y, Z = "1 0 0", "0 1 0", "0 0 1"


@dataclass(frozen=True)
class Part:
    """A link and the joint that moves it.

    Attributes:
        name: Name of the link; the joint's name has the suffix ``_joint``.
        before: Index of the parent link, -1 for the trunk.
        place: Position of the joint on the parent link [m].
        axis: Axis of the joint.
    """

    name: str
    before: int
    place: Place
    axis: str


@dataclass(frozen=True)
class End:
    """A ball at the end of a limb, whose contacts a sensor detects.

    Attributes:
        name: Name of its frame.
        part: Index of its link.
        place: Position on the link [m].
        radius: Radius [m].
    """

    name: str
    part: int
    place: Place
    radius: float


@dataclass(frozen=True)
class Numbers:
    """Numbers that differ between a robot and its model.

    Attributes:
        mass: Masses of the links [kg], ``(n,)``; all others have the same order.
        center: Centres of mass [m], ``(n, 3)``.
        radius: Radii of gyration about the centres [m], ``(n, 3)``.
        armature: Rotor inertia on the joint side [kg m^2].
        damping: Viscous friction [N m s/rad].
        friction: Coulomb friction [N m].
    """

    mass: Array
    center: Array
    radius: Array
    armature: Array
    damping: Array
    friction: Array


@dataclass(frozen=True)
class Robot:
    """A robot whose base is not bolted down.

    Attributes:
        name: Name of the robot.
        parts: Links and joints.
        ends: Ends that may touch the ground.
        numbers: Numbers of the model.
        trunk: Mass [kg] and moments of inertia [kg m^2] of the base.
        imu_at: Position of the inertial sensor on the base [m].
        imu_turned: Roll, pitch and yaw of the sensor [rad].
        height: Height of the base above the ground while it stands [m].
        kp: Position gains while it stands [N m/rad], ``(n,)``.
        kd: Velocity gains [N m s/rad].
        slow: Joints that hardly turn while it walks.
        carries: Links that may carry a payload.
    """

    name: str
    parts: tuple[Part, ...]
    ends: tuple[End, ...]
    numbers: Numbers
    trunk: tuple[float, Place]
    imu_at: Place
    imu_turned: Place
    height: float
    kp: Array
    kd: Array
    slow: tuple[int, ...]
    carries: tuple[int, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(f"{part.name}_joint" for part in self.parts)

    @property
    def weight(self) -> float:
        """Weight of the whole robot [N]."""
        return 9.81 * (self.trunk[0] + float(self.numbers.mass.sum()))


def quadruped() -> Robot:
    """Twelve joints and 15 kg, with rounded numbers of common quadrupeds."""
    legs = ("FL", "FR", "RL", "RR")
    parts, ends, center = [], [], []
    for k, leg in enumerate(legs):
        x, y = (1.0 if leg[0] == "F" else -1.0), (1.0 if leg[1] == "L" else -1.0)
        parts += [
            Part(f"{leg}_hip", -1, (0.19 * x, 0.047 * y, 0.0), X),
            Part(f"{leg}_thigh", 3 * k, (0.0, 0.095 * y, 0.0), Y),
            Part(f"{leg}_calf", 3 * k + 1, (0.0, 0.0, -0.213), Y),
        ]
        ends.append(End(f"{leg}_foot", 3 * k + 2, (0.0, 0.0, -0.213), 0.022))
        center += [(-0.005 * x, 0.002 * y, 0.0), (-0.004, -0.022 * y, -0.033), (0.005, 0.0, -0.13)]
    radius = np.tile([(0.027, 0.031, 0.024), (0.071, 0.067, 0.035), (0.079, 0.08, 0.013)], (4, 1))
    numbers = Numbers(
        np.tile([0.68, 1.15, 0.24], 4),
        np.array(center),
        radius,
        np.tile([0.01, 0.01, 0.02], 4),
        np.full(12, 0.05),
        np.tile([0.2, 0.2, 0.3], 4),
    )
    return Robot(
        "quadruped",
        tuple(parts),
        tuple(ends),
        numbers,
        trunk=(7.0, (0.025, 0.098, 0.107)),
        imu_at=(-0.04, 0.02, 0.06),
        imu_turned=(0.0, 0.0, 0.3),
        height=0.34,
        kp=np.full(12, 150.0),
        kd=np.full(12, 5.0),
        slow=(0, 3, 6, 9),
        carries=(2, 5, 8, 11),
    )


def biped() -> Robot:
    """Ten joints and 24 kg: each leg has yaw, roll and pitch of the hip, knee and ankle, heel and toe."""
    parts, ends, center = [], [], []
    for k, leg in enumerate(("L", "R")):
        y = 1.0 if leg == "L" else -1.0
        parts += [
            Part(f"{leg}_yaw", -1, (0.0, 0.1 * y, -0.05), Z),
            Part(f"{leg}_roll", 5 * k, (0.0, 0.0, -0.05), X),
            Part(f"{leg}_thigh", 5 * k + 1, (0.0, 0.0, -0.03), Y),
            Part(f"{leg}_shank", 5 * k + 2, (0.0, 0.0, -0.3), Y),
            Part(f"{leg}_ankle", 5 * k + 3, (0.0, 0.0, -0.3), Y),
        ]
        ends += [
            End(f"{leg}_heel", 5 * k + 4, (-0.05, 0.0, -0.03), 0.02),
            End(f"{leg}_toe", 5 * k + 4, (0.12, 0.0, -0.03), 0.02),
        ]
        center += [(0.0, 0.005 * y, -0.03), (0.01, 0.0, -0.01), (0.0, 0.01 * y, -0.11), (0.008, 0.0, -0.13)]
        center += [(0.03, 0.0, -0.02)]
    radius = np.tile(
        [(0.03, 0.03, 0.03), (0.03, 0.03, 0.03), (0.09, 0.09, 0.04), (0.09, 0.09, 0.03), (0.02, 0.06, 0.06)], (2, 1)
    )
    numbers = Numbers(
        np.tile([0.8, 1.0, 2.4, 1.6, 0.5], 2),
        np.array(center),
        radius,
        np.tile([0.02, 0.02, 0.04, 0.04, 0.01], 2),
        np.tile([0.1, 0.1, 0.15, 0.15, 0.05], 2),
        np.tile([0.3, 0.3, 0.5, 0.5, 0.2], 2),
    )
    return Robot(
        "biped",
        tuple(parts),
        tuple(ends),
        numbers,
        trunk=(11.0, (0.25, 0.2, 0.1)),
        imu_at=(-0.03, 0.01, 0.12),
        imu_turned=(0.0, 0.1, -1.5),
        height=0.72,
        kp=np.tile([80.0, 150.0, 200.0, 200.0, 50.0], 2),
        kd=np.tile([2.5, 5.0, 6.0, 6.0, 1.0], 2),
        slow=(0, 1, 5, 6),
        carries=(3, 8),
    )


def arm() -> Robot:
    """Six joints and 15 kg; the arm of 7 kg hangs from the base and touches nothing."""
    places = [(0.0, 0.0, -0.06), (0.0, 0.05, -0.05), (0.0, 0.0, -0.3), (0.0, 0.0, -0.25), (0.0, 0.0, -0.08)]
    axes = (Z, Y, Y, X, Y, Z)
    parts = [Part(f"link{k + 1}", k - 1, place, axes[k]) for k, place in enumerate([*places, (0.0, 0.0, -0.07)])]
    center = [(0.0, 0.01, -0.03), (0.0, 0.03, -0.14), (0.01, -0.01, -0.1), (0.0, 0.0, -0.04), (0.005, 0.0, -0.03)]
    numbers = Numbers(
        np.array([1.6, 2.2, 1.5, 0.7, 0.5, 0.4]),
        np.array([*center, (0.01, 0.005, -0.05)]),
        np.array([(0.04,) * 3, (0.1, 0.1, 0.04), (0.08, 0.08, 0.03), (0.03,) * 3, (0.03,) * 3, (0.03, 0.03, 0.02)]),
        np.array([0.06, 0.06, 0.05, 0.015, 0.01, 0.01]),
        np.array([0.3, 0.3, 0.2, 0.08, 0.05, 0.05]),
        np.array([0.8, 0.8, 0.6, 0.25, 0.2, 0.2]),
    )
    return Robot(
        "arm",
        tuple(parts),
        # Without contacts in the log, contacts are detected, and a wrong torque looks like a contact.
        (End("hand", 5, (0.0, 0.0, -0.1), 0.02),),
        numbers,
        trunk=(8.0, (0.12, 0.1, 0.1)),
        imu_at=(0.08, -0.05, 0.03),
        imu_turned=(3.14159265, 0.0, 0.0),
        height=0.8,
        kp=np.array([200.0, 250.0, 200.0, 60.0, 40.0, 30.0]),
        kd=np.array([8.0, 9.0, 7.0, 2.0, 1.2, 1.0]),
        slow=(),
        carries=(5,),
    )
