# pyright: reportAttributeAccessIssue=false
"""Inertial parameters of bodies: names, physical consistency, conversions, payloads, and priors from tolerances."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from phantom_dyn.array_types import Array, Float
from phantom_dyn.model.robot import Robot

STANDARD_NAMES = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""Names of the ten parameters of a body in Pinocchio's order, about the joint origin in the joint's axes."""
STANDARD_UNITS = ("kg", "kg m", "kg m", "kg m", *["kg m^2"] * 6)
# Row and column of the six inertia entries in Pinocchio's order.
_ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
# A negative inertia counts as rounding up to this share of the largest principal inertia, or of the mass [m^2].
_NEGATIVE, _NEGATIVE_GYRATION = 1e-9, 1e-14
# Relative excess up to which a violation of the triangle inequality counts as rounding.
_TRIANGLE = 1e-6
# Name of the frame that carries the payload if robot.yaml names none.
_TIP = "tip"


def body_name(robot: Robot, joint_index: int) -> str:
    """Name of the link on a joint; the name of the joint if it has no link.

    Args:
        robot: The robot.
        joint_index: Pinocchio's index of the joint, from 1.
    """
    model = robot.model
    joint_frame = model.getFrameId(model.names[joint_index], pin.FrameType.JOINT)
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY and frame.parentFrame == joint_frame:
            return frame.name
    return model.names[joint_index]


def parameter_names(robot: Robot) -> tuple[str, ...]:
    """Names such as ``upper_arm.mx`` of the columns of `phantom_dyn.dynamics.dynamics.rigid_body_regressor`."""
    bodies = [body_name(robot, j) for j in range(1, robot.model.njoints)]
    return tuple(f"{body}.{name}" for body in bodies for name in STANDARD_NAMES)


def parameter_units(robot: Robot) -> tuple[str, ...]:
    """Unit of each of `parameter_names`."""
    return STANDARD_UNITS * (robot.model.njoints - 1)


def impossible_because(mass: float, central_inertia: Float[Array, "3 3"]) -> str | None:
    """Reason why no body can have this mass and this inertia about its centre of mass; None if a body can.

    A negative principal inertia counts as rounding up to 1e-9 of the largest one, because files have about ten digits,
    and up to a radius of gyration of 0.1 um, because exporters write rounding errors instead of zero. The triangle
    inequality is not checked here, because files of many vendors violate it, see `breaks_triangle`.

    Args:
        mass: Mass [kg].
        central_inertia: Inertia about the centre of mass [kg m^2], shape ``(3, 3)``, symmetric.
    """
    if not (np.isfinite(mass) and np.isfinite(central_inertia).all()):
        return "its inertia is not a finite number"
    if mass < 0:
        return f"its mass is {mass:g} kg, below zero"
    principal = np.linalg.eigvalsh(central_inertia)
    if principal[0] < -max(_NEGATIVE * np.abs(principal).max(), _NEGATIVE_GYRATION * mass):
        return f"its smallest principal inertia is {principal[0]:g} kg m^2, below zero"
    return None


def breaks_triangle(central_inertia: Float[Array, "3 3"]) -> bool:
    """True if one principal inertia exceeds the sum of the others by more than 1e-6 (the rounding of files)."""
    principal = np.linalg.eigvalsh(central_inertia)
    return bool(principal[2] > (principal[0] + principal[1]) * (1 + _TRIANGLE))


def central_parameters(
    standard: Float[Array, " 10"],
) -> tuple[float, Float[Array, " 3"], Float[Array, "3 3"]]:
    """Mass [kg], centre of mass [m] and inertia about it [kg m^2] from the ten standard parameters.

    The centre of a body without mass is the joint origin.

    Args:
        standard: Parameters in the order of `STANDARD_NAMES`.
    """
    mass = float(standard[0])
    center = standard[1:4] / mass if mass else np.zeros(3)
    inertia = np.empty((3, 3))
    for (i, j), value in zip(_ENTRIES, standard[4:], strict=True):
        inertia[i, j] = inertia[j, i] = value
    return mass, center, inertia - mass * (center @ center * np.eye(3) - np.outer(center, center))


def body_parameters(
    mass: float, center: Float[Array, " 3"], central_inertia: Float[Array, "3 3"]
) -> Float[Array, " 10"]:
    """The ten standard parameters of a body; inverse of `central_parameters`.

    Args:
        mass: Mass [kg].
        center: Centre of mass in the joint frame [m].
        central_inertia: Inertia about the centre of mass in the joint's axes [kg m^2].
    """
    inertia = central_inertia + mass * (center @ center * np.eye(3) - np.outer(center, center))
    return np.concatenate([[mass], mass * center, [inertia[i, j] for i, j in _ENTRIES]])


def tolerance_directions(robot: Robot, joint_index: int) -> tuple[Float[Array, "10 10"], tuple[str, ...]]:
    r"""Change of the ten standard parameters of a body per unit relative change of mass, centre and inertia.

    The columns are the mass (relative to itself, with fixed centre and central inertia), three components of the centre
    of mass (relative to its distance from the joint origin), and six entries of the central inertia (``Iij`` relative
    to :math:`\sqrt{I_{ii} I_{jj}}`). A tolerance ``s`` of inertias is a prior with the covariance :math:`s^2 D D^T`.

    Args:
        robot: The robot.
        joint_index: Pinocchio's index of the joint, from 1.

    Returns:
        ``D``, shape ``(10, 10)``, rows in the order of `STANDARD_NAMES`, and a name for each column such as
        ``link2 mass``, ``link2 center x``, ``link2 Ixx``.
    """
    mass, center, inertia = central_parameters(robot.model.inertias[joint_index].toDynamicParameters())
    directions = np.zeros((10, 10))
    directions[:, 0] = body_parameters(mass, center, np.zeros((3, 3)))
    distance = np.linalg.norm(center)
    for axis, unit in enumerate(np.eye(3)):
        directions[1 + axis, 1 + axis] = distance * mass
        slope = 2 * center[axis] * np.eye(3) - np.outer(unit, center) - np.outer(center, unit)
        directions[4:, 1 + axis] = distance * mass * np.array([slope[i, j] for i, j in _ENTRIES])
    # Rounding may have made a diagonal entry of a file negative.
    diagonal = np.sqrt(np.maximum(np.diag(inertia), 0.0))
    for column, (i, j) in enumerate(_ENTRIES):
        directions[4 + column, 4 + column] = diagonal[i] * diagonal[j]
    body = body_name(robot, joint_index)
    quantities = ("mass", "center x", "center y", "center z", *STANDARD_NAMES[4:])
    return directions, tuple(f"{body} {quantity}" for quantity in quantities)


def has_known_centre(mass: float, std: float) -> bool:
    """True if the mass is known well enough to state a centre of mass: its 95 % interval is narrower than half of it.

    Otherwise first moments are stated, for which no division by the mass is needed.

    Args:
        mass: Mass [kg].
        std: Standard deviation of the mass [kg].
    """
    return 2 * 1.96 * std < 0.5 * abs(mass)


def payload_body(robot: Robot) -> int:
    """Pinocchio's index of the joint whose link carries the payload.

    This is the link with the payload frame, otherwise the link with the frame ``tip``, otherwise the last link. On a
    tree with several ends, the last link depends on the order in the file.
    """
    frame = robot.payload_frame or _TIP
    joint = robot.model.frames[robot.model.getFrameId(frame)].parentJoint if robot.model.existFrame(frame) else 0
    return joint if joint > 0 else robot.model.njoints - 1


def tip_of(robot: Robot) -> Float[Array, " 3"] | None:
    """Position of the frame ``tip`` in the frame of the joint that moves it [m]; None if no moving link has one."""
    if not robot.model.existFrame(_TIP):
        return None
    tip = robot.model.frames[robot.model.getFrameId(_TIP)]
    return np.array(tip.placement.translation) if tip.parentJoint > 0 else None


def point_mass_parameters(mass: float, center: Array) -> Array:
    """The ten standard inertial parameters of a point mass at ``center`` [m], about the joint origin."""
    return body_parameters(mass, np.asarray(center), np.zeros((3, 3)))
