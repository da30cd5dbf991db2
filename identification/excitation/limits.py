# pyright: reportAttributeAccessIssue=false
"""Limits of an exciting motion: of joints, of positions of frames, and of distances between bodies.

The robot's file and configuration state limits; the user may give lower ones. A robot with a joint without a drive is
refused. The limited quantities of one sample are put in one row, and `Bounds` has a lower and an upper bound of each.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from identification.excitation.closable import CLEAR, largest_slope, solved_numerically
from identification.excitation.collisions import Collisions, distances
from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError, RobotError, known_names
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import linear_joints

_UNLIMITED = 1e6  # larger numbers in a file mean no limit

SPEED = {False: 1.0, True: 0.25}
"""Speed limit if none is stated: of revolute joints (False) [rad/s], and of linear joints (True) [m/s]."""


def stated_limits(robot: Robot) -> Limits:
    """Limits that a robot states, infinite if none is stated.

    Zero, numbers above `_UNLIMITED`, and limits of continuous joints mean no limit.
    """
    model = robot.model
    joints = list(model.joints)[1:]
    names = tuple(model.names)[1:]
    single = np.array([joint.nq == 1 for joint in joints])  # continuous joints have nq = 2
    rows = [joint.idx_q for joint in joints]
    low, high = np.array(model.lowerPositionLimit)[rows], np.array(model.upperPositionLimit)[rows]
    lower = np.where(single & (np.abs(low) < _UNLIMITED), low, -np.inf)
    upper = np.where(single & (np.abs(high) < _UNLIMITED), high, np.inf)
    torque = stated_torque_limits(robot)
    notes = []
    for name, low, high in zip(names, lower, upper, strict=True):
        if not low < high:
            raise RobotError(
                f"{robot.source} lets {name} move from {low:g} to {high:g}, which leaves no room: widen its limits, or "
                f"hold it with lock: [{name}] in robot.yaml."
            )
    if not np.isfinite(torque).all():
        unlimited = [name for name, limit in zip(robot.joint_names, torque, strict=True) if not np.isfinite(limit)]
        notes.append(f"The robot states no torque limit of {', '.join(unlimited)}: the torque is not limited there.")
    velocity = _infinite_unless_stated(np.array(model.velocityLimit))
    return Limits(lower, upper, velocity, np.full(robot.nv, np.inf), torque, notes=tuple(notes))


def stated_torque_limits(robot: Robot) -> Float[Array, " nv"]:
    """Largest torque of each drive: its ``torque_limit``, or the effort limit of the file; infinite if neither."""
    torque = _infinite_unless_stated(np.array(robot.model.effortLimit))[list(robot.tree_rows)]
    for row, drive in enumerate(robot.actuators):
        if drive.torque_limit is not None:
            torque[row] = drive.torque_limit
    return torque


def require_excitable(robot: Robot, frames: Sequence[str]) -> None:
    """Raise an error for a robot with a joint without a drive, or for an unknown frame."""
    idle = [name for name, drive in zip(robot.joint_names, robot.actuators, strict=True) if not drive.actuated]
    if idle:
        raise RobotError(
            f"{', '.join(idle)} of {robot.name} has no drive that could follow a reference: hold it with "
            f"lock: [{', '.join(idle)}] in robot.yaml."
        )
    known = dict.fromkeys(frame.name for frame in robot.model.frames)
    for name in frames:
        if name not in known:
            raise RobotError(f"{robot.name} has no frame {name!r}: {known_names(name, known, 'frames')}")


def _infinite_unless_stated(limit: Float[Array, " n"]) -> Float[Array, " n"]:
    """The limits, infinite for numbers that mean no limit."""
    return np.where((limit > 0) & (limit < _UNLIMITED), limit, np.inf)


@dataclass(frozen=True)
class FrameBox(ReadOnlyArrays):
    """A box along the axes of the base [m] that the origin of a frame must not leave; infinite bounds are no limit."""

    frame: str
    lower: Float[Array, "3"]
    upper: Float[Array, "3"]

    def __post_init__(self):
        super().__post_init__()
        if not (self.lower < self.upper).all():
            raise ParameterError(
                f"The box of frame {self.frame} goes from {self.lower} to {self.upper} m: give lower corners "
                "below upper ones."
            )


@dataclass(frozen=True)
class Limits(ReadOnlyArrays):
    """Limits of a motion; infinite if there is no limit.

    Positions and velocities are limited for all joints of the tree, including passive ones; accelerations and drive
    torques for the active joints only.

    Attributes:
        lower: Lower limits of position [rad or m], shape ``(nt,)``.
        upper: Upper limits of position [rad or m], shape ``(nt,)``.
        velocity: Largest speed [rad/s or m/s], shape ``(nt,)``.
        acceleration: Largest acceleration [rad/s^2 or m/s^2], shape ``(nv,)``.
        torque: Largest drive torque [N m or N], shape ``(nv,)``.
        boxes: Boxes that frames must not leave.
        collisions: Pairs of bodies that must not touch.
        notes: Sentences on limits that the robot does not state.
        clear: Smallest distance of a closed chain from a singularity, see `phantom_dyn.loops.solver`.
    """

    lower: Float[Array, " nt"]
    upper: Float[Array, " nt"]
    velocity: Float[Array, " nt"]
    acceleration: Float[Array, " nv"]
    torque: Float[Array, " nv"]
    boxes: tuple[FrameBox, ...] = ()
    collisions: Collisions | None = None
    notes: tuple[str, ...] = ()
    clear: float = CLEAR

    def __post_init__(self):
        if not 0 < self.clear < 1:
            raise ParameterError(f"A distance of {self.clear:g} from a singularity was given: give one from 0 to 1.")
        super().__post_init__()
        if not (self.lower < self.upper).all():
            row = int(np.flatnonzero(~(self.lower < self.upper))[0])
            raise ParameterError(
                f"The position limits of joint number {row}, {self.lower[row]:g} to {self.upper[row]:g}, leave no "
                "room: widen them, or lock the joint."
            )
        for name in ("velocity", "acceleration", "torque"):
            if not (getattr(self, name) > 0).all():
                raise ParameterError(f"A limit of {name} is not above 0: give one that lets the robot move.")


def limits_of(
    robot: Robot,
    *,
    velocity: float | Sequence[float] | None = None,
    acceleration: float | Sequence[float] | None = None,
    share: float = 1.0,
    boxes: Sequence[FrameBox] = (),
    collisions: Collisions | None = None,
    clear: float = CLEAR,
) -> Limits:
    """Limits that a robot states, and further limits.

    Args:
        robot: The robot with limits of position, velocity and torque.
        velocity: Largest speed [rad/s or m/s], one number or one per active joint. The lower one of this and the stated
            limit is used.
        acceleration: Largest acceleration [rad/s^2 or m/s^2], one number or one per active joint; by default no limit.
        share: Share of the velocity and torque limits that is used, above 0 and at most 1.
        boxes: Boxes that frames must not leave.
        collisions: Pairs of bodies that must not touch.
        clear: Smallest distance of a closed chain from a singularity, above 0 and below 1.

    Raises:
        ParameterError: If a limit leaves no room, or the number of values is wrong.
        RobotError: If a frame is unknown, or a joint has no drive.
    """
    if not 0 < share <= 1:
        raise ParameterError(f"A share of {share:g} of the limits was given: give more than 0 and at most 1.")
    require_excitable(robot, [box.frame for box in boxes])
    stated = stated_limits(robot)
    active = list(robot.tree_rows)
    notes = list(stated.notes)
    speed = np.array(stated.velocity)
    wanted = _per_joint(robot, velocity, "velocity")
    speed[active] = np.minimum(speed[active], wanted)
    linear = linear_joints(robot.model)
    unlimited = ~np.isfinite(speed)
    unlimited[np.setdiff1d(np.arange(len(speed)), active)] = False  # passive joints need no limit
    if unlimited.any():
        names = ", ".join(robot.model.names[row + 1] for row in np.flatnonzero(unlimited).tolist())
        kept = " and ".join(
            f"{SPEED[kind]:g} {unit}" for kind, unit in ((False, "rad/s"), (True, "m/s")) if kind in linear[unlimited]
        )
        notes.append(
            f"The robot states no velocity limit of {names}: {kept} is used; give another velocity to change it."
        )
        speed[unlimited] = np.where(linear, SPEED[True], SPEED[False])[unlimited]
    return Limits(
        stated.lower,
        stated.upper,
        share * speed,
        _per_joint(robot, acceleration, "acceleration"),
        share * stated.torque,
        tuple(boxes),
        collisions,
        tuple(notes),
        clear,
    )


def _per_joint(robot: Robot, value: float | Sequence[float] | None, name: str) -> Float[Array, " nv"]:
    """A limit for each active joint, infinite if none is given."""
    if value is None:
        return np.full(robot.nv, np.inf)
    values = np.atleast_1d(np.asarray(value, dtype=float))
    if values.shape not in ((1,), (robot.nv,)):
        raise ParameterError(
            f"{values.size} values of {name} were given for {robot.nv} {'joint' if robot.nv == 1 else 'joints'}: give "
            f"one, or one for each of {', '.join(robot.joint_names)}."
        )
    if not (values > 0).all():
        article = "An" if name[0] in "aeiou" else "A"
        raise ParameterError(f"{article} {name} limit of {values.min():g} was given: give numbers above 0.")
    return np.broadcast_to(values, (robot.nv,))


NEAR = 0.01
"""A limit counts as reached if a value is closer to the bound than this share of the bound's size."""

_DISTANCE_SIZE = 0.1  # unit of the excess of a distance between bodies [m]


@dataclass(frozen=True)
class Bounds(ReadOnlyArrays):
    """Lower and upper bounds of m quantities.

    Attributes:
        labels: Names of the quantities.
        units: Units of the quantities.
        lower: Lower bounds.
        upper: Upper bounds.
        size: Values by which an excess over a bound is divided, to compare excesses of different quantities.
    """

    labels: tuple[str, ...]
    units: tuple[str, ...]
    lower: Float[Array, " m"]
    upper: Float[Array, " m"]
    size: Float[Array, " m"]

    def excess(self, values: Float[Array, "N m"]) -> Float[Array, "2 N m"]:
        """Excess of values below and above their bounds, in units of the sizes, ``(2, N, m)``; negative inside."""
        return np.stack([self.lower - values, values - self.upper]) / self.size

    def inside(self, margin: float) -> Bounds:
        """Bounds narrowed on both sides by a share of their size."""
        return Bounds(
            self.labels, self.units, self.lower + margin * self.size, self.upper - margin * self.size, self.size
        )

    def reached(self, values: Float[Array, "N m"]) -> tuple[str, ...]:
        """Labels of the bounds that the values nearly reach."""
        worst = self.excess(values).max(axis=(0, 1))
        return tuple(label for label, share in zip(self.labels, worst, strict=True) if share > -NEAR)

    def worst(self, values: Float[Array, "N m"]) -> str:
        """A clause on the bound with the largest excess."""
        excess = self.excess(values).max(axis=1)
        side, m = np.unravel_index(int(np.argmax(excess)), excess.shape)
        column = values[:, m]
        reached, limit, word = (
            (column.min(), self.lower[m], "under") if side == 0 else (column.max(), self.upper[m], "over")
        )
        unit = f" {self.units[m]}" if self.units[m] else ""
        return (
            f"the {self.labels[m]} reaches {reached:.4g}{unit}, {abs(reached - limit):.3g}{unit} {word} its limit of "
            f"{limit:.4g}{unit}"
        )


def bounds_of(robot: Robot, limits: Limits) -> Bounds:
    """Bounds of all limited quantities.

    The order is: position and velocity of the tree, acceleration and torque of the active joints, distance from a
    singularity (only if loops are solved numerically), boxes of frames, distances of bodies. The bounds of torque are
    reduced by the modelled Coulomb friction, which is not part of the computed torque.

    Raises:
        ParameterError: If the limits are those of another robot, or friction alone needs the whole torque.
    """
    tree = tuple(robot.model.names)[1:]
    units = ["m" if linear else "rad" for linear in linear_joints(robot.model)]
    shapes = (len(limits.lower), len(limits.velocity), len(limits.acceleration), len(limits.torque))
    if shapes != (len(tree), len(tree), robot.nv, robot.nv):
        raise ParameterError(f"The limits are not those of {robot.name}: make them with limits_of for this robot.")
    usable = limits.torque - _coulomb(robot)
    for name, limit, usable_torque in zip(robot.joint_names, limits.torque, usable, strict=True):
        if not usable_torque > 0:
            raise ParameterError(
                f"The drive of {name} gives {limit:.4g}, and its modelled Coulomb friction alone takes "
                f"{limit - usable_torque:.4g}: correct torque_limit or the friction of the robot file."
            )
    speeds = [f"{unit}/s" for unit in units]
    accelerations = [f"{units[row]}/s^2" for row in robot.tree_rows]
    parts = [
        _of_joints("position", tree, units, limits.lower, limits.upper),
        _of_joints("velocity", tree, speeds, -limits.velocity, limits.velocity),
        _of_joints("acceleration", robot.joint_names, accelerations, -limits.acceleration, limits.acceleration),
        _of_joints("torque", robot.joint_names, robot.torque_units, -usable, usable),
    ]
    if solved_numerically(robot):
        clear = np.array([limits.clear])
        parts.append(Bounds(("distance of the loops from a singularity",), ("",), clear, np.array([np.inf]), clear))
    for box in limits.boxes:
        axes = tuple(f"{axis} of frame {box.frame}" for axis in "xyz")
        parts.append(Bounds(axes, ("m",) * 3, box.lower, box.upper, _half_range(box.lower, box.upper)))
    if limits.collisions is not None:
        pairs = tuple(f"distance of {pair}" for pair in limits.collisions.names)
        each = np.ones(len(pairs))
        clearance = limits.collisions.clearance * each
        parts.append(Bounds(pairs, ("m",) * len(pairs), clearance, np.inf * each, _DISTANCE_SIZE * each))
    return Bounds(
        tuple(label for part in parts for label in part.labels),
        tuple(unit for part in parts for unit in part.units),
        *(np.concatenate([getattr(part, name) for part in parts]) for name in ("lower", "upper", "size")),
    )


def _of_joints(
    what: str, names: Sequence[str], units: Sequence[str], lower: Float[Array, " j"], upper: Float[Array, " j"]
) -> Bounds:
    """Bounds of one quantity, such as ``position``, of several joints."""
    labels = tuple(f"{what} of {name}" for name in names)
    return Bounds(labels, tuple(units), lower, upper, _half_range(lower, upper))


def _half_range(lower: Float[Array, " j"], upper: Float[Array, " j"]) -> Float[Array, " j"]:
    """Half of each range; 1 without a lower or an upper bound."""
    half = (upper - lower) / 2
    return np.where(np.isfinite(half), half, 1.0)


def _coulomb(robot: Robot) -> Float[Array, " nv"]:
    """Largest torque of each drive that overcomes modelled Coulomb friction, including that of passive joints."""
    coulomb = np.array(robot.coulomb_friction)
    if robot.chain is None or not robot.chain.coulomb_friction.any():
        return coulomb
    return coulomb + robot.chain.coulomb_friction @ largest_slope(robot)


def places(
    model: pin.Model, limits: Limits, configuration: Float[Array, "N nq"], *, slopes: bool
) -> tuple[Float[Array, "N m"], Float[Array, "N m nt"] | None]:
    """Coordinates [m] of frames that have a box, then the distance [m] of each pair that must not touch.

    Args:
        model: The tree.
        limits: Limits with the frames and pairs.
        configuration: Pinocchio's configurations, shape ``(N, nq)``.
        slopes: True to compute derivatives.

    Returns:
        Values, and their derivatives by the positions of the tree (None without ``slopes``).
    """
    frames = [model.getFrameId(box.frame) for box in limits.boxes]
    values = np.empty((len(configuration), 3 * len(frames)))
    slope = np.empty((*values.shape, model.nv)) if slopes else None
    data = model.createData()
    for k, q in enumerate(configuration if frames else ()):
        if slopes:
            pin.computeJointJacobians(model, data, q)
        else:
            pin.forwardKinematics(model, data, q)
        for m, frame in enumerate(frames):
            values[k, 3 * m : 3 * m + 3] = pin.updateFramePlacement(model, data, frame).translation
            if slope is not None:
                J = pin.getFrameJacobian(model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
                slope[k, 3 * m : 3 * m + 3] = J[:3]
    if limits.collisions is None or not len(limits.collisions.names):
        return values, slope
    gaps, gap_slopes = distances(model, limits.collisions, configuration, slopes=slopes)
    if slope is None or gap_slopes is None:
        return np.concatenate([values, gaps], axis=1), None
    return np.concatenate([values, gaps], axis=1), np.concatenate([slope, gap_slopes], axis=1)
