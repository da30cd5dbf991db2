# pyright: reportAttributeAccessIssue=false
r"""Zero moment point of a whole robot, and the support polygon in which it has to stay.

The source of this package lacks these equations and cites [Huang]_. Let :math:`L` be the angular momentum of a body
about its own centre of mass, in right-handed axes, with :math:`z` upwards from the ground. Then

.. math::
    x_{zmp} = \frac{\sum m (\ddot z + g) x - \sum m \ddot x z - \sum \dot L_y}{\sum m (\ddot z + g)}, \qquad
    y_{zmp} = \frac{\sum m (\ddot z + g) y - \sum m \ddot y z + \sum \dot L_x}{\sum m (\ddot z + g)}

The sign of :math:`\dot L_x` is plus. [Huang]_ prints minus in both equations, which is right only for other axes. With
right-handed axes a minus changes the point by up to a metre in fast motion. Equations without :math:`\dot L` (point
masses) have almost the same error. A test checks both.

References:
    .. [Huang] Q. Huang et al., Planning walking patterns for a biped robot, IEEE Trans. Robotics and Automation 17(3),
       2001 (cited from memory); the equations here are derived, and compared with each other and with a closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from scipy.spatial import ConvexHull, QhullError

from phantom_dyn.array_types import Array, Float, ReadOnlyArrays
from phantom_dyn.errors import ParameterError, RobotError


@dataclass(frozen=True)
class SupportPolygon(ReadOnlyArrays):
    """Convex hull of the contact points on level ground.

    Attributes:
        vertices: Corners [m], counter-clockwise seen from above, shape ``(K, 2)``.
    """

    vertices: Float[Array, "K 2"]

    def margin(self, points: Float[Array, "N 2"]) -> Float[Array, " N"]:
        """Distance to the boundary [m], positive inside and negative outside, shape ``(N,)``.

        Args:
            points: Points on the ground [m], shape ``(N, 2)``.
        """
        edges = np.roll(self.vertices, -1, axis=0) - self.vertices
        offsets = points[:, None, :] - self.vertices
        along = np.clip((offsets * edges).sum(-1) / (edges**2).sum(-1), 0.0, 1.0)
        distance = np.linalg.norm(offsets - along[..., None] * edges, axis=-1).min(axis=1)
        inside = (edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0] >= 0).all(axis=1)
        return np.where(inside, distance, -distance)


def support_polygon(contacts: Float[Array, "C 2"]) -> SupportPolygon:
    """Support polygon of contact points on level ground.

    Args:
        contacts: Contact points of all feet [m], shape ``(C, 2)``, in any order.

    Raises:
        ParameterError: If fewer than three points are given, one is not finite, or all are on one line.
    """
    if len(contacts) < 3:
        raise ParameterError(f"A support polygon was asked for of {len(contacts)} contact points: give three or more.")
    if not np.isfinite(contacts).all():
        raise ParameterError("A contact point of the support polygon is not finite: give numbers in metres.")
    try:
        hull = ConvexHull(contacts)
    except QhullError as problem:
        raise ParameterError(
            "The contact points of the support polygon lie on one line: give points that span an area."
        ) from problem
    return SupportPolygon(contacts[hull.vertices])


def support_polygon_along(contacts: Float[Array, "C 3"], force: Float[Array, " 3"]) -> SupportPolygon:
    r"""Support polygon of contact points at different heights: the hull of their projections along the force to z = 0.

    A force f through the point :math:`\sum \lambda_i c_i`, :math:`\lambda_i \ge 0`, :math:`\sum \lambda_i = 1`, is
    the sum of parallel forces :math:`\lambda_i f` at the contacts c_i. If the zero moment point of f on z = 0 is inside
    this polygon, and f is inside the friction cone, these contact forces produce the motion. A projection to another
    height than z = 0 would shift the point and the polygon equally, which does not change the margin. For soles at one
    height, the margin is the usual one in their plane.

    Args:
        contacts: Contact points [m], shape ``(C, 3)``.
        force: Sum of the contact forces [N], upwards, shape ``(3,)``.

    Raises:
        ParameterError: If the force does not point upwards, or for the reasons in `support_polygon`.
    """
    _upward(force[2:])
    return support_polygon(contacts[:, :2] - contacts[:, 2:] * force[:2] / force[2])


def zmp_from_bodies(
    model: pin.Model, q: Float[Array, "N nq"], v: Float[Array, "N nv"], a: Float[Array, "N nv"], *, ground: float = 0.0
) -> Float[Array, "N 2"]:
    """Zero moment point [m] in world axes from the sum over bodies, shape ``(N, 2)``.

    Args:
        model: Robot with a free-flyer as its first joint.
        q: Configurations with the quaternion of the base [m, rad], shape ``(N, nq)``.
        v: Velocities, those of the base in its own frame [m/s, rad/s], shape ``(N, nv)``.
        a: Time derivatives of the velocities, shape ``(N, nv)``.
        ground: Height of the ground [m].

    Raises:
        RobotError: If the base does not float or gravity is not vertical.
        ParameterError: If the robot does not press on the ground in a sample.
    """
    g = _vertical_gravity(model)
    data = model.createData()
    moments, forces = np.zeros((len(q), 2)), np.zeros(len(q))
    for k in range(len(q)):
        pin.forwardKinematics(model, data, q[k], v[k], a[k])
        for joint in range(1, model.njoints):
            mass, point, acceleration, spin = _body_motion(model, data, joint)
            press = mass * (acceleration[2] + g)
            moments[k] += press * point[:2] - mass * acceleration[:2] * (point[2] - ground) + (-spin[1], spin[0])
            forces[k] += press
    return moments / _upward(forces)[:, None]


def zmp_from_centroidal_momentum(
    model: pin.Model, q: Float[Array, "N nq"], v: Float[Array, "N nv"], a: Float[Array, "N nv"], *, ground: float = 0.0
) -> Float[Array, "N 2"]:
    """Zero moment point [m] from the rate of change of the centroidal momentum, shape ``(N, 2)``.

    Arguments and errors are those of `zmp_from_bodies`.
    """
    g = _vertical_gravity(model)
    data = model.createData()
    mass = pin.computeTotalMass(model)
    com, rate = np.zeros((len(q), 3)), np.zeros((len(q), 6))
    for k in range(len(q)):
        pin.computeCentroidalMomentumTimeVariation(model, data, q[k], v[k], a[k])
        com[k], rate[k] = data.com[0], data.dhg.vector
    force = _upward(rate[:, 2] + mass * g)[:, None]
    turn = np.stack([-rate[:, 4], rate[:, 3]], axis=1)
    return com[:, :2] + (turn - rate[:, :2] * (com[:, 2:] - ground)) / force


def contact_wrench(
    model: pin.Model, q: Float[Array, "N nq"], v: Float[Array, "N nv"], a: Float[Array, "N nv"]
) -> tuple[Float[Array, "N 3"], Float[Array, "N 3"]]:
    """Force [N] and moment [N m] of the ground on the robot, about the world's origin in world axes, each ``(N, 3)``.

    Inverse dynamics gives them as the wrench at the floating base, because only the feet touch the ground. The
    arguments are those of `zmp_from_bodies`.

    Raises:
        RobotError: If the base does not float or gravity is not vertical.
        ParameterError: If the robot does not press on the ground in a sample.
    """
    _vertical_gravity(model)
    data = model.createData()
    wrench = np.zeros((len(q), 6))
    for k in range(len(q)):
        base = pin.Force(pin.rnea(model, data, q[k], v[k], a[k])[:6])
        wrench[k] = data.liMi[1].act(base).vector
    _upward(wrench[:, 2])
    return wrench[:, :3], wrench[:, 3:]


def zmp_of_wrench(
    force: Float[Array, "N 3"], moment: Float[Array, "N 3"], *, ground: float = 0.0
) -> Float[Array, "N 2"]:
    """Point [m] at height ``ground`` about which a wrench has no horizontal moment, shape ``(N, 2)``.

    Args:
        force: Contact force [N], upwards in every sample, shape ``(N, 3)``.
        moment: Contact moment about the world's origin [N m], shape ``(N, 3)``.
        ground: Height of the ground [m].
    """
    # Moment about (0, 0, ground): moment - (0, 0, ground) x force.
    moment_x = moment[:, 0] + ground * force[:, 1]
    moment_y = moment[:, 1] - ground * force[:, 0]
    return np.stack([-moment_y, moment_x], axis=1) / _upward(force[:, 2])[:, None]


def zmp_from_contact_wrench(
    model: pin.Model, q: Float[Array, "N nq"], v: Float[Array, "N nv"], a: Float[Array, "N nv"], *, ground: float = 0.0
) -> Float[Array, "N 2"]:
    """Zero moment point [m] from the wrench of the ground on the robot, shape ``(N, 2)``.

    Arguments and errors are those of `zmp_from_bodies`.
    """
    return zmp_of_wrench(*contact_wrench(model, q, v, a), ground=ground)


def _body_motion(model: pin.Model, data: pin.Data, joint: int) -> tuple[float, Array, Array, Array]:
    """Mass, centre of mass, its acceleration, and the rate of the angular momentum about it, in world axes."""
    inertia = model.inertias[joint]
    rotation = data.oMi[joint].rotation
    omega = data.v[joint].angular
    alpha = data.a[joint].angular
    origin = pin.getClassicalAcceleration(model, data, joint, pin.ReferenceFrame.LOCAL).linear
    lever = inertia.lever
    acceleration = rotation @ (origin + np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever)))
    spin = rotation @ (inertia.inertia @ alpha + np.cross(omega, inertia.inertia @ omega))
    return inertia.mass, data.oMi[joint].act(lever), acceleration, spin


def _vertical_gravity(model: pin.Model) -> float:
    """Gravity [m/s^2], after a check that the base floats and gravity is vertical."""
    if model.njoints < 2 or model.joints[1].nv != 6:
        raise RobotError("The zero moment point needs a robot on a floating base: give a model with a free-flyer.")
    x, y, z = model.gravity.linear
    if x or y or z >= 0:
        raise RobotError(
            f"The zero moment point needs gravity along -z, and it is ({x:g}, {y:g}, {z:g}): turn the model's gravity."
        )
    return -float(z)


def _upward(force: Float[Array, " N"]) -> Float[Array, " N"]:
    """The force, after a check that it is above zero in every sample."""
    lifted = np.flatnonzero(force <= 0)
    if lifted.size:
        raise ParameterError(
            f"The robot does not press on the ground at sample {lifted[0]}, where the force is {force[lifted[0]]:g} N: "
            "there is no zero moment point, give a motion with a foot on the ground."
        )
    return force
