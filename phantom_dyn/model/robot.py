# pyright: reportAttributeAccessIssue=false
"""Data of a robot: a private Pinocchio model, its actuators, its loops, and the uncertainty of the model."""

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
    """Position controller of one joint: ``tau = kp (q_ref - q) - kd v``, delayed by ``delay`` [s].

    Attributes:
        kind: ``pd``, or ``duty``: the drive applies a share of the supply voltage that is proportional to the position
            error. Then ``kp`` describes the torque at standstill, and ``kd`` describes the back-EMF.
        kp: Gain on the position error [N m/rad or N/m].
        kd: Gain on the velocity [N m s/rad or N s/m].
        delay: Delay of the whole torque [s].
        reference_delay: Additional delay of the reference [s].
        limit: Largest ``kp (q_ref - q)`` [N m or N].
        drops_beyond: Position error beyond which ``drops_to`` is the limit [rad or m].
        drops_to: Limit at larger position errors [N m or N].
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
        limit = np.where(np.abs(error) > self.drops_beyond, min(self.drops_to, self.limit), self.limit)
        return np.clip(self.kp * error, -limit, limit)


@dataclass(frozen=True)
class Actuator:
    """Drive of one joint, in SI units; the rotor inertia and the torque limit are on the joint side of the gear.

    A drive may filter its references by a first-order low pass with the time constant ``reference_lag`` [s]; the
    reader of a recording applies this filter to the recorded references.

    ``drive_known`` is False if the torque of the drive is unknown, by ``drive: unknown`` in ``robot.yaml`` or because
    the recording does not have it. The motion of the joint is then used, and its torque is not judged.
    """

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
    reference_lag: float = 0.0


@dataclass(frozen=True)
class Tolerance:
    """Relative standard deviations of the modelled inertias, friction and rotor inertias; 0 means exact."""

    inertia: float = 0.05
    friction: float = 0.05
    rotor_inertia: float = 0.10


@runtime_checkable
class UserEffect(Protocol):
    """The part of a user's effect that a robot needs; the whole interface is `phantom_dyn.effects.effect.Effect`."""

    name: str


@dataclass(frozen=True)
class Robot:
    """A robot with one velocity for each joint.

    The root of the model is the base. The base of a floating robot moves, and `phantom_dyn.motion.Motion` contains
    that motion.

    The model is a tree. In a closed chain (``chain`` is not None) each of its joints is active or passive. All
    attributes for the joints then contain the active joints only, in the tree's order; ``nv`` is their number.

    Attributes:
        model: Private copy of the Pinocchio model; ``model.armature`` has the rotor inertias of all joints.
        name: Name for reports.
        source: The file or name that was given.
        sha256: SHA-256 of the robot file.
        joint_names: Name of each joint, in Pinocchio's order.
        actuators: Drive of each joint.
        viscous_friction: Modelled viscous coefficients [N m s/rad or N s/m], shape ``(nv,)``.
        coulomb_friction: Modelled Coulomb torques [N m or N], shape ``(nv,)``.
        prismatic: True where the joint is linear, shape ``(nv,)``.
        torque_hold: ``zoh`` if ``tau[k]`` acts from ``t[k]`` to ``t[k+1]``.
        reference_hold: ``zoh`` if ``q_ref[k]`` acts from ``t[k]`` to ``t[k+1]``; None if the recording decides.
        torque_source: Quantity in the torque columns of recordings.
        tolerance: Uncertainty of the model.
        payload_frame: Frame that carries a payload; None means the frame ``tip``, or the last link if there is none.
        warnings: Sentences about the robot file that the user should read.
        locked: Joints of the file that are held fixed and are no longer in the model.
        chain: Positions of the passive joints as functions of the active ones; None without a closed chain.
        config: The ``robot.yaml`` that the user named; None if it is the one beside the robot file, or there is none.
        user_effects: The user's effects in addition to the catalogue, see `phantom_dyn.effects.user`.
        carried: Standard parameters of the payload that an earlier diagnosis found, ``(10,)``, or None. A negative
            payload (mass to be taken off) may be as large as the link's mass plus this mass.
        soft_friction: For each joint, the soft Coulomb friction of the file's simulator, or None; empty for a URDF.
        gains_of_file: Joints whose controller comes from their actuator in the robot's file.
        unknown_arrivals: Joints whose drive receives each reference at an unknown time within one cycle of the
            fieldbus, see `identification.data.drives.arrivals`.
        model_error: Root mean square error of the model's torque that an earlier diagnosis found [N m or N],
            ``(nv, 2)``: where the joint creeps or reverses, and elsewhere. None if unknown.
        floating: True if the base is not bolted down.
        unmodelled: Joints on which forces may act that the robot's file states and the model leaves out.
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
    unmodelled: frozenset[str] = frozenset()

    def __post_init__(self):
        object.__setattr__(self, "model", self.model.copy())
        for name in ("viscous_friction", "coulomb_friction"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        object.__setattr__(self, "prismatic", read_only(self.prismatic, bool))

    # The cached properties are functions of the model alone, which never changes.
    @cached_property
    def arrays(self) -> TreeArrays:
        """Arrays of the model for compiled loops."""
        return tree_arrays(self.model)

    @cached_property
    def attached(self) -> tuple[tuple[Attached, ...], ...]:
        """Bodies that fixed or locked joints attach to each moving body, by Pinocchio's index of its joint."""
        return attached_bodies(self.model)

    # Stored solutions do not change any result, because a solution depends on the positions alone.
    @cached_property
    def solutions(self) -> RecentSolutions:
        """Solver for the loops of a closed chain, which keeps its last solutions.

        Raises:
            ChainError: If the robot is no closed chain.
        """
        if self.chain is None:
            raise ChainError(f"{self.name} has no loops to close.")
        return RecentSolutions(self.model, self.chain, self.arrays)

    @property
    def nv(self) -> int:
        """Number of joint velocities; in a closed chain, of active joints."""
        return self.model.nv if self.chain is None else self.chain.nv

    @property
    def nq(self) -> int:
        """Length of Pinocchio's configuration vector of the tree (a continuous joint takes two entries)."""
        return self.model.nq

    @property
    def tree_rows(self) -> tuple[int, ...]:
        """Index of each joint among the velocities of ``model``."""
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
        """Pinocchio configurations of the tree at the joint positions ``q`` [rad or m].

        Raises:
            ChainError: If the loops of a closed chain cannot be closed at ``q``.
        """
        if self.chain is not None:
            q = self.solutions.at(q).x
        return configurations(self.model, q)


def position_limits(robot: Robot) -> tuple[Float[Array, " nv"], Float[Array, " nv"]]:
    """Lower and upper position limit of each joint [rad or m], infinite where it has none."""
    lower, upper = tree_position_limits(robot.model)
    return lower[list(robot.tree_rows)], upper[list(robot.tree_rows)]


def tree_position_limits(model: pin.Model) -> tuple[Float[Array, " nt"], Float[Array, " nt"]]:
    """Lower and upper position limit of every joint of the tree [rad or m], infinite where it has none."""
    lower, upper = np.full(model.nv, -np.inf), np.full(model.nv, np.inf)
    for joint in list(model.joints)[1:]:
        low, high = float(model.lowerPositionLimit[joint.idx_q]), float(model.upperPositionLimit[joint.idx_q])
        if joint.nq == 1 and low < high:
            lower[joint.idx_v], upper[joint.idx_v] = low, high
    return lower, upper
