# pyright: reportAttributeAccessIssue=false
"""The robot as data: a private Pinocchio model, its actuators, its loops, and how far the model is trusted."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Literal, Protocol, runtime_checkable

import numpy as np
import pinocchio as pin

from phantom_dyn._kernels.tree_arrays import TreeArrays, tree_arrays
from phantom_dyn.array_types import Array, Float, read_only
from phantom_dyn.errors import ChainError
from phantom_dyn.loops.chain import ClosedChain
from phantom_dyn.loops.solver import RecentSolutions
from phantom_dyn.model.attached import Attached, attached_bodies
from phantom_dyn.model.robot_xml import SoftFriction
from phantom_dyn.motion import configurations


@dataclass(frozen=True)
class Controller:
    """Position controller of one joint: ``tau = kp (q_ref - q) - kd v``, late by ``delay`` [s].

    Attributes:
        kind: ``pd``, or ``duty``: the drive puts a share of the supply on the motor that grows with the position error.
            ``kp`` is then that of the torque at standstill, and ``kd`` the back-EMF's.
        kp: [N m/rad or N/m].
        kd: [N m s/rad or N s/m].
        delay: Delay of the whole torque [s].
        reference_delay: By which the reference alone is late [s].
        limit: Largest ``kp (q_ref - q)`` [N m or N].
        drops_beyond: Position error from which on the limit is another [rad or m].
        drops_to: That other limit [N m or N].
    """

    kind: Literal["pd", "duty"] = "pd"
    kp: float = 0.0
    kd: float = 0.0
    delay: float = 0.0
    reference_delay: float = 0.0
    limit: float = np.inf
    drops_beyond: float = np.inf
    drops_to: float = np.inf

    def stiff_part(self, error: Float[Array, " N"]) -> Float[Array, " N"]:
        """``kp (q_ref - q)`` within the limits [N m or N] at position errors [rad or m]."""
        most = np.where(np.abs(error) > self.drops_beyond, min(self.drops_to, self.limit), self.limit)
        return np.clip(self.kp * error, -most, most)


@dataclass(frozen=True)
class Actuator:
    """Drive of one joint; SI units on the joint side unless a name says motor."""

    rotor_inertia: float = 0.0
    gear_ratio: float = 1.0
    torque_constant: float | None = None
    torque_limit: float | None = None
    encoder_counts: float | None = None
    encoder_side: Literal["motor", "link"] = "motor"
    actuated: bool = True
    resistance: float | None = None
    voltage_limit: float | None = None
    controller: Controller | None = None
    drive_known: bool = True


@dataclass(frozen=True)
class Tolerance:
    """Relative one-sigma trust in the modelled inertias, friction and rotor inertias; 0 is trusted exactly."""

    inertia: float = 0.05
    friction: float = 0.05
    rotor_inertia: float = 0.10


@runtime_checkable
class UserEffect(Protocol):
    """An effect as a robot carries it; what it is to be, `phantom_dyn.effects.effect.Effect` says."""

    name: str


@dataclass(frozen=True)
class Robot:
    """A robot ready for dynamics: one velocity per joint.

    The root of the model is the base, also of a robot that is not bolted down: how its base moves is part of a
    `phantom_dyn.motion.Motion` then.

    The model is a tree. In a closed chain (``chain`` is not None) its joints are active or passive, and all that is
    said of the robot's joints, their number ``nv`` included, is of the active ones, in the tree's order.

    Attributes:
        model: Private copy of the Pinocchio model; rotor inertias are in ``model.armature``, passive joints' included.
        name: Name for reports.
        source: The file or name that was given.
        sha256: SHA-256 of the robot file.
        joint_names: One per velocity, in Pinocchio's order.
        actuators: One per velocity.
        viscous_friction: Modelled viscous coefficients [N m s/rad or N s/m], shape ``(nv,)``.
        coulomb_friction: Modelled Coulomb torques [N m or N], shape ``(nv,)``.
        prismatic: True where the joint is linear, shape ``(nv,)``.
        torque_hold: ``zoh`` if ``tau[k]`` acts from ``t[k]`` to ``t[k+1]``.
        reference_hold: ``zoh`` if ``q_ref[k]`` acts from ``t[k]`` to ``t[k+1]``; None: as
            the log's format says or the log shows.
        torque_source: Quantity in the torque columns of recordings.
        tolerance: Allowed errors of the model.
        payload_frame: Frame that carries a payload, or None for frame ``tip`` if there is one, else the last link.
        warnings: Sentences about the robot file that the user should read.
        locked: Joints of the file that are held fixed and are no longer in the model.
        chain: How the passive joints of a closed chain follow the active ones, or None.
        config: The ``robot.yaml`` that was named for it; None: the one beside its file, where there is one.
        user_effects: Effects beside the catalogue that the user brought for it, see `phantom_dyn.effects.user`.
        carried: Standard parameters that an earlier diagnosis has found on the link of a payload, ``(10,)``:
            so much may be taken off. None: none.
        soft_friction: By joint, how the simulator that the file is written for softens Coulomb friction, or None;
            empty for a URDF.
        gains_of_file: Joints whose controller is that of their actuator in the robot's file.
        unknown_arrivals: Joints whose references reach the drive at an unknown time within a frame of the bus, see
            `identification.data.drives.arrivals`.
        model_error: Root mean square [N m or N] by which an earlier diagnosis has found the torque of the model wrong,
            where a joint creeps or turns about and elsewhere, ``(nv, 2)``. None: not known.
        floating: True if the base is not bolted down.
    """

    model: pin.Model
    name: str
    source: str
    sha256: str
    joint_names: tuple[str, ...]
    actuators: tuple[Actuator, ...]
    viscous_friction: Float[Array, " nv"]
    coulomb_friction: Float[Array, " nv"]
    prismatic: np.ndarray
    torque_hold: Literal["zoh", "instant"] = "instant"
    reference_hold: Literal["zoh", "instant"] | None = None
    torque_source: Literal["command", "current", "sensor"] = "command"
    tolerance: Tolerance = field(default_factory=Tolerance)
    payload_frame: str | None = None
    warnings: tuple[str, ...] = ()
    locked: tuple[str, ...] = ()
    chain: ClosedChain | None = None
    config: Path | None = None
    user_effects: tuple[UserEffect, ...] = ()
    soft_friction: tuple[SoftFriction | None, ...] = ()
    carried: Float[Array, " 10"] | None = None
    gains_of_file: tuple[str, ...] = ()
    floating: bool = False
    unknown_arrivals: tuple[str, ...] = ()
    model_error: Float[Array, "nv 2"] | None = None

    def __post_init__(self):
        object.__setattr__(self, "model", self.model.copy())
        for name in ("viscous_friction", "coulomb_friction"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        object.__setattr__(self, "prismatic", read_only(self.prismatic, bool))

    # Cached: a function of the model alone, which never changes.
    @cached_property
    def arrays(self) -> TreeArrays:
        """The model as compiled loops take it, made at the first use."""
        return tree_arrays(self.model)

    # Cached: a function of the model alone, which never changes.
    @cached_property
    def attached(self) -> tuple[tuple[Attached, ...], ...]:
        """Parts on each body behind fixed or locked joints, by Pinocchio's index of the joint that moves the body."""
        return attached_bodies(self.model)

    # Cached: it keeps solutions that depend on the positions alone, see there, so that no answer depends on it.
    @cached_property
    def solutions(self) -> RecentSolutions:
        """Solver of the loops of a closed chain, with what it solved last.

        Raises:
            ChainError: If the robot is no closed chain.
        """
        if self.chain is None:
            raise ChainError(f"{self.name} has no loops to close.")
        return RecentSolutions(self.model, self.chain, self.arrays)

    @property
    def nv(self) -> int:
        """Number of joint velocities; in a closed chain of the active joints."""
        return self.model.nv if self.chain is None else self.chain.nv

    @property
    def nq(self) -> int:
        """Length of Pinocchio's configuration vector of the tree (a continuous joint takes two entries)."""
        return self.model.nq

    @property
    def tree_rows(self) -> tuple[int, ...]:
        """Place of each joint among the velocities of ``model``."""
        return tuple(range(self.model.nv)) if self.chain is None else self.chain.active

    @property
    def passive_names(self) -> tuple[str, ...]:
        """Joints of a closed chain that follow the active ones."""
        return () if self.chain is None else self.chain.passive_names

    @property
    def rotor_inertia(self) -> Float[Array, " nv"]:
        """Rotor inertia of each joint on the joint side [kg m^2 or kg]."""
        return self.model.armature[list(self.tree_rows)]

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Unit of the drive torque of each joint."""
        return tuple("N" if p else "N m" for p in self.prismatic)

    @property
    def position_units(self) -> tuple[str, ...]:
        """Unit of the position of each joint."""
        return tuple("m" if p else "rad" for p in self.prismatic)

    def configuration(self, q: Float[Array, "N nv"]) -> Float[Array, "N nq"]:
        """Pinocchio configurations of the tree at joint positions ``q`` [rad or m]; a continuous joint: cos, sin.

        Raises:
            ChainError: If the loops of a closed chain cannot be closed there.
        """
        if self.chain is not None:
            q = self.solutions.at(q).x
        return configurations(self.model, q)


def position_limits(robot: Robot) -> tuple[Float[Array, " nv"], Float[Array, " nv"]]:
    """Lower and upper position limit of each joint [rad or m], infinite where it has none.

    Args:
        robot: Gives the joints.
    """
    lower, upper = tree_position_limits(robot.model)
    return lower[list(robot.tree_rows)], upper[list(robot.tree_rows)]


def tree_position_limits(model: pin.Model) -> tuple[Float[Array, " nt"], Float[Array, " nt"]]:
    """As `position_limits`, of every joint of the tree."""
    lower, upper = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
    for joint in list(model.joints)[1:]:
        low, high = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
        if joint.nq == 1 and low < high:
            lower[joint.idx_v], upper[joint.idx_v] = low, high
    return lower, upper
