# pyright: reportAttributeAccessIssue=false
"""A point mass that the model lacks, on the link that carries the payload.

This is the link with ``payload_frame``, otherwise the link with the frame ``tip``, otherwise the last link. The mass is
negative if the robot lacks a part of the model. If a negative mass is about that of a body on a fixed or locked joint,
such as a hand, this body counts as missing, and its own inertia is removed too. If the interval of the mass is wider
than half of the mass, a finding states the first moments ``moment_x``, ``moment_y`` and ``moment_z`` instead of the
centre: on a pendulum, for example, the first moments are known well, while mass and lever are not.

A payload changes the inertial parameters of its link by four numbers, while `inertial_parameters` has ten; on a
pendulum both describe the same changes. URDF and MJCF: an additional inertial element.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from phantom_dyn.dynamics.dynamics import rigid_body_regressor, standard_parameters
from phantom_dyn.effects.author import (
    Array,
    Effect,
    EffectWords,
    Float,
    Operation,
    Parameter,
    Robot,
    Shape,
    Signature,
    Simulated,
    Stated,
)
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.model.attached import Attached
from phantom_dyn.model.inertia import (
    STANDARD_NAMES,
    STANDARD_UNITS,
    body_parameters,
    central_parameters,
    has_known_centre,
    payload_body,
    point_mass_parameters,
)

# Largest load [kg], and its largest distance from the frame of its joint [m].
_HEAVIEST, _FARTHEST = 1000.0, 3.0
# A part counts as missing if its mass and first moments agree with those of the finding within a quarter.
_MATCHES = 1.25
# A lever shorter than this counts as this long [m] when first moments are compared.
_SHORTEST_LEVER = 0.02
# Squared radius of gyration [m^2] by which rounded numbers in a robot file may falsify an inertia.
_ROUNDING = 1e-8
# Largest share of a link's mass that can be removed.
_LARGEST_SHARE = 0.999
# Assumed radius of gyration of a load over its lever: that of a ball whose radius is about half of the lever.
_EXTENT = 0.2
_MOMENTS = ("moment_x", "moment_y", "moment_z")
_CENTERS = ("center_x", "center_y", "center_z")


class Payload(Effect):
    """Mass that the model lacks, on the link that carries the payload."""

    name = "payload"
    scope = "robot"
    regime = "posture"
    made_of = ("acceleration",)
    acts_as = "load"
    shows_with = "acceleration"
    inertial = "point mass"
    words = EffectWords(
        name="a payload",
        meaning="a mass on the last link that the model does not carry",
        next_step="Weigh the tool, cable or load at the last link, and add it to the model.",
        less="less mass on the last link than modelled",
        size="of {mass}",
        parameters={
            "mass": "additional mass",
            "center_x": "its place along x of the frame of the joint that moves the link",
            "center_y": "its place along y",
            "center_z": "its place along z",
        },
        shown_over=("position", "modelled", "acceleration"),
        separated_by="weighing",
    )

    def parameters(self, robot: Robot, joint: str | None) -> tuple[Parameter, ...]:
        """``mass`` and its position in the frame of the joint that moves the link."""
        parts = robot.attached[payload_body(robot)]
        least = self.lightest(robot)
        mass = Parameter(
            "mass",
            "kg",
            least,
            plausible=(max(least, -_MATCHES * max((*(part.mass for part in parts), _carried_mass(robot)))), _HEAVIEST),
            plausible_because="the strongest arms lift a tonne, and what a robot lacks is a part that its model "
            "carries on a fixed or locked joint, or a load that an earlier diagnosis has found",
        )
        centers = (
            Parameter(
                f"center_{axis}",
                "m",
                plausible=(-_FARTHEST, _FARTHEST),
                plausible_because="a load is held within a few metres of the link that carries it",
            )
            for axis in "xyz"
        )
        return mass, *centers

    def regressor_columns(self, robot: Robot, joint: str | None) -> tuple[int, ...]:
        """Columns of the body that carries the payload."""
        first = 10 * (payload_body(robot) - 1)
        return tuple(range(first, first + 10))

    def signature(self, robot: Robot, operation: Operation, joint: str | None, shape: Shape) -> Signature:
        """The ten regressor columns of the body; `point_mass_parameters` gives their coefficients for a point mass."""
        columns = rigid_body_regressor(robot, operation)[:, :, list(self.regressor_columns(robot, joint))]
        return Signature(tuple(range(robot.nv)), columns, STANDARD_NAMES, STANDARD_UNITS)

    def lightest(self, robot: Robot) -> float:
        """Smallest mass [kg]: minus the mass of the link, including payloads of an earlier diagnosis."""
        return -float(_link(robot)[0])

    def own_inertia(self, robot: Robot, mass: float) -> Float[Array, " 6"]:
        """Inertia per kilogram of the part that a payload of this mass may remove; zero if there is no such part."""
        part = _nearest(robot, mass)
        return np.zeros(6) if part is None else body_parameters(0.0, np.zeros(3), part.inertia)[4:] / part.mass

    def from_coefficients(self, robot: Robot, joint: str | None, coefficients: Array, shape: Shape) -> Array:
        """Mass and centre from mass and first moments, changed to the nearest possible values.

        The size of a mass near zero is increased until its centre is within `_FARTHEST`. A negative mass is limited so
        that a body can have the inertial parameters of the remaining link.
        """
        mass, moments = float(coefficients[0]), np.asarray(coefficients[1:4], dtype=float)
        least = float(np.linalg.norm(moments)) / _FARTHEST
        mass = np.copysign(max(abs(mass), least), mass)
        if mass == 0.0:
            return np.zeros(4)
        center = moments / mass
        return np.array([mass if mass > 0 else -min(-mass, most_removed(robot, center)), *center])

    def stated_law(
        self, robot: Robot, joint: str | None, shape: Shape, std: Array, coefficients: Array
    ) -> tuple[tuple[Parameter, ...], Callable[[Array], Array]]:
        """Mass and centre; first moments instead of the centre if the mass is not known well enough."""
        if has_known_centre(coefficients[0], std[0]):
            return super().stated_law(robot, joint, shape, std, coefficients)
        names = (Parameter(f"moment_{axis}", "kg m") for axis in "xyz")
        return (self.parameters(robot, joint)[0], *names), lambda x: x[:4]

    def from_stated(self, robot: Robot, stated: Stated) -> Stated:
        """Mass and centre; if a finding states first moments, the centre is computed from them."""
        if "moment_x" not in stated:
            return stated
        numbers = np.array([float(np.ravel(stated[name])[0]) for name in ("mass", *_MOMENTS)])
        theta = self.from_coefficients(robot, None, numbers, ())
        return dict(zip(("mass", *_CENTERS), theta.tolist(), strict=True))

    def remark(self, robot: Robot, joint: str | None, theta: Array) -> str:
        """A sentence on the part of the model that the robot lacks, if there is one."""
        part = missing_part(robot, theta)
        if part is None:
            return ""
        names = part.names[0] + (f" with {' and '.join(part.names[1:])}" if part.names[1:] else "")
        return (
            f"The model carries {names} ({part.mass:.3g} kg) where the robot is lighter by {-theta[0]:.3g} kg: it is "
            "missing on the robot, and the corrected model is without its inertia too."
        )

    def probe(self, robot: Robot, operation: Operation, joint: str | None) -> tuple[str, Array]:
        """Size of the effect: a mass at the centre of mass of the link."""
        center = robot.model.inertias[payload_body(robot)].lever
        return "mass", point_mass_parameters(1.0, center)

    def sized(
        self, robot: Robot, joint: str | None, name: str, size: float, posture: Array
    ) -> tuple[float, ...] | None:
        """Parameters of a mass of this size at the centre of mass of the link."""
        return (size, *(float(x) for x in robot.model.inertias[payload_body(robot)].lever))

    def torque(self, robot: Robot, operation: Operation, joint: str | None, theta: Array) -> Array:
        """Minus the drive torque that moves the mass."""
        return -rigid_body_regressor(robot, operation) @ self._added_to_robot(robot, theta)

    def simulated(self, robot: Robot, joint: str | None, theta: Array) -> Simulated:
        """The robot with the payload in the inertial parameters of its link."""
        added = self._added_to_robot(robot, theta)
        return Simulated(robot=lambda moved: with_parameters(moved, added))

    def _added_to_robot(self, robot: Robot, theta: Array) -> Float[Array, " p"]:
        """Change of the standard parameters of all bodies."""
        added = np.zeros_like(standard_parameters(robot))
        added[list(self.regressor_columns(robot, None))] = _added(robot, theta)
        return added


def _link(robot: Robot) -> Float[Array, " 10"]:
    """Standard parameters of the link that carries a payload, including payloads of an earlier diagnosis."""
    own = np.array(robot.model.inertias[payload_body(robot)].toDynamicParameters())
    return own if robot.carried is None else own + robot.carried


def _extent_of_carried(robot: Robot) -> float:
    """Mass times squared radius of gyration along each axis [kg m^2] that loads of an earlier diagnosis may have.

    The diagnosis found them as point masses, but real loads have an extent.
    """
    mass = _carried_mass(robot)
    if robot.carried is None or mass == 0.0:
        return 0.0
    return float(_EXTENT**2 * np.sum(np.square(robot.carried[1:4])) / mass)


def _carried_mass(robot: Robot) -> float:
    """Mass of the loads that an earlier diagnosis has found [kg]; zero if it is negative."""
    return 0.0 if robot.carried is None else max(float(robot.carried[0]), 0.0)


def carrying(robot: Robot, thetas: Sequence[Float[Array, " 4"]]) -> Robot:
    """The robot with payloads that an earlier diagnosis has found.

    Args:
        robot: The given model, which is not changed.
        thetas: Mass and centre of each payload.
    """
    if not thetas:
        return robot
    return replace(robot, carried=np.sum([_added(robot, np.asarray(theta)) for theta in thetas], axis=0))


def _added(robot: Robot, theta: Float[Array, " 4"]) -> Float[Array, " 10"]:
    """Ten inertial parameters that a payload adds, including the inertia of a part that it removes."""
    mass = float(theta[0])
    own = point_mass_parameters(mass, theta[1:4])
    own[4:] += mass * Payload().own_inertia(robot, mass)
    return own


def _nearest(robot: Robot, mass: float) -> Attached | None:
    """The part on a fixed or locked joint whose mass is nearest to minus ``mass``, within a factor of two."""
    if mass >= 0.0:
        return None
    near = [part for part in robot.attached[payload_body(robot)] if 0.5 * part.mass <= -mass <= 2.0 * part.mass]
    return min(near, key=lambda part: abs(np.log(-mass / part.mass)), default=None)


def missing_part(robot: Robot, theta: Float[Array, " 4"]) -> Attached | None:
    """The part on a fixed or locked joint that a negative payload removes; None if no part matches it."""
    part = _nearest(robot, float(theta[0]))
    if part is None:
        return None
    lever = max(float(np.linalg.norm(part.center)), _SHORTEST_LEVER)
    mismatch = float(np.linalg.norm(theta[0] * np.asarray(theta[1:4]) + part.mass * part.center)) / (part.mass * lever)
    return part if max(abs(theta[0] + part.mass) / part.mass, mismatch) <= _MATCHES - 1.0 else None


def most_removed(robot: Robot, center: Float[Array, " 3"]) -> float:
    """Largest point mass [kg] that can be removed at a point of the payload's link.

    A body can have the remaining parameters if the pseudo-inertia ``P - m p p^T`` with ``p = (center, 1)`` is positive
    semidefinite. This holds up to ``m = 1 / (p^T P^-1 p)``.
    """
    mass, link_center, inertia = central_parameters(_link(robot))
    second_moments = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    homogeneous, point = np.append(link_center, 1.0), np.append(center, 1.0)
    pseudo_inertia = mass * np.outer(homogeneous, homogeneous)
    pseudo_inertia[:3, :3] += second_moments
    # The inertia is increased to allow for rounded numbers in a robot file, and for the extent of loads that an earlier
    # diagnosis has found as point masses.
    widened = pseudo_inertia + (_ROUNDING * mass + _extent_of_carried(robot)) * np.diag([1.0, 1.0, 1.0, 0.0])
    return float(min(1.0 / (point @ np.linalg.solve(widened, point)), _LARGEST_SHARE * mass))
