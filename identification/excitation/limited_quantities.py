# pyright: reportAttributeAccessIssue=false
"""Everything that a design limits as one row of quantities: their bounds, and how far a motion exceeds them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from identification.excitation.closable import largest_slope, solved_numerically
from identification.excitation.collisions import CLEARANCE, distances
from identification.excitation.limits import Limits
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import linear_joints, read_only

NEAR = 0.01
"""A limit counts as reached within this share of its size."""
_SINGULAR = "distance of the loops from a singularity"
_APART = 0.1  # size [m] that distances are measured in


@dataclass(frozen=True)
class Bounds:
    """Lower and upper bounds of m quantities: what they are, their unit, and a size to measure excess in."""

    labels: tuple[str, ...]
    units: tuple[str, ...]
    lower: Float[Array, " m"]
    upper: Float[Array, " m"]
    size: Float[Array, " m"]

    def __post_init__(self):
        for name in ("lower", "upper", "size"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def excess(self, values: Float[Array, "N m"]) -> Float[Array, "2 N m"]:
        """How far values lie below and above their bounds, in units of their size; negative inside."""
        return np.stack([self.lower - values, values - self.upper]) / self.size

    def inside(self, margin: float) -> Bounds:
        """Bounds narrowed on both sides by a share of their size."""
        return Bounds(
            self.labels, self.units, self.lower + margin * self.size, self.upper - margin * self.size, self.size
        )

    def reached(self, values: Float[Array, "N m"]) -> tuple[str, ...]:
        """Labels of the bounds that values come near."""
        worst = self.excess(values).max(axis=(0, 1))
        return tuple(label for label, share in zip(self.labels, worst, strict=True) if share > -NEAR)

    def worst(self, values: Float[Array, "N m"]) -> str:
        """The bound that is broken most and the excess over it, as half a sentence."""
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
    """Bounds of position and velocity of the tree, acceleration and torque of the active joints, and of places.

    Of loops that are closed numerically the distance from a singularity comes next; then boxes and distances.

    The torque bound leaves out the modelled Coulomb friction, which adds to the torque of any motion at most itself.

    Raises:
        ParameterError: If the limits are of another robot, or friction alone takes the torque.
    """
    tree = tuple(robot.model.names)[1:]
    units = ["m" if linear else "rad" for linear in linear_joints(robot.model)]
    active = [units[row] for row in robot.tree_rows]
    shapes = (len(limits.lower), len(limits.velocity), len(limits.acceleration), len(limits.torque))
    if shapes != (len(tree), len(tree), robot.nv, robot.nv):
        raise ParameterError(f"The limits are not those of {robot.name}: make them with limits_of for this robot.")
    usable = limits.torque - _coulomb(robot)
    for name, limit, left in zip(robot.joint_names, limits.torque, usable, strict=True):
        if not left > 0:
            raise ParameterError(
                f"The drive of {name} gives {limit:.4g}, and its modelled Coulomb friction alone takes "
                f"{limit - left:.4g}: correct torque_limit or the friction of the robot file."
            )
    parts = [
        ("position", tree, units, limits.lower, limits.upper),
        ("velocity", tree, [f"{unit}/s" for unit in units], -limits.velocity, limits.velocity),
        ("acceleration", robot.joint_names, [f"{u}/s^2" for u in active], -limits.acceleration, limits.acceleration),
        ("torque", robot.joint_names, list(robot.torque_units), -usable, usable),
    ]
    labels = [f"{what} of {name}" for what, names, *_ in parts for name in names]
    named = [unit for _, _, units_of, *_ in parts for unit in units_of]
    lower, upper = [part[3] for part in parts], [part[4] for part in parts]
    if solved_numerically(robot):
        labels.append(_SINGULAR)
        named.append("")
        lower.append(np.array([limits.clear]))
        upper.append(np.array([np.inf]))
    for box in limits.boxes:
        labels += [f"{axis} of frame {box.frame}" for axis in "xyz"]
        named += ["m"] * 3
        lower.append(box.lower)
        upper.append(box.upper)
    pairs = limits.collisions.names if limits.collisions is not None else ()
    labels += [f"distance of {pair}" for pair in pairs]
    named += ["m"] * len(pairs)
    lower.append(np.full(len(pairs), limits.collisions.clearance if limits.collisions is not None else CLEARANCE))
    upper.append(np.full(len(pairs), np.inf))
    low, high = np.concatenate(lower), np.concatenate(upper)
    with np.errstate(invalid="ignore"):
        half = (high - low) / 2
    size = np.where(np.isfinite(half), half, 1.0)
    if _SINGULAR in labels:
        size[labels.index(_SINGULAR)] = limits.clear
    size[len(size) - len(pairs) :] = _APART
    return Bounds(tuple(labels), tuple(named), low, high, size)


def _coulomb(robot: Robot) -> Float[Array, " nv"]:
    """Largest torque that the modelled Coulomb friction can take from each drive, passive joints' included."""
    own = np.array(robot.coulomb_friction)
    if robot.chain is None or not robot.chain.coulomb_friction.any():
        return own
    return own + robot.chain.coulomb_friction @ largest_slope(robot)


def places(
    model: pin.Model, limits: Limits, configuration: Float[Array, "N nq"], *, slopes: bool
) -> tuple[Float[Array, "N m"], Float[Array, "N m nt"] | None]:
    """Coordinates [m] of the frames that have a box, then the distance [m] of each pair that must not collide.

    Args:
        model: The tree.
        limits: Names frames and pairs.
        configuration: Pinocchio's, N samples.
        slopes: True if the slope is wanted too, else None.

    Returns:
        Values, and their slope in the joint velocities of the tree.
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
    apart, apart_slope = distances(model, limits.collisions, configuration, slopes=slopes)
    if slope is None or apart_slope is None:
        return np.concatenate([values, apart], axis=1), None
    return np.concatenate([values, apart], axis=1), np.concatenate([slope, apart_slope], axis=1)
