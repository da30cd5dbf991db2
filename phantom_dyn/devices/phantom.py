r"""PHANToM 1.5: published parameters, kinematics and Jacobian in closed form.

Joint angles ``q = (theta1, theta2, theta3)`` are absolute: theta2 is the upper arm, theta3 the forearm, which does not
move with theta2. Frame: x right, y up, z towards the user, origin at the tip in the zero configuration, in which the
upper arm (``l1``) lies along +z and the forearm (``l2``) hangs along -y.

One assembly is possible, because the parallelogram cannot be folded over: ``abs(theta3 - theta2) < pi / 2`` and
``l1 cos(theta2) + l2 sin(theta3) > 0``. The inverse kinematics returns that one.

References:
    M. C. Çavuşoğlu, D. Feygin, F. Tendick, *A Critical Study of the Mechanical and Electrical Properties of the PHANToM
    Haptic Interface and Improvements for High-Performance Control*, Presence 11(6), 2002: sections 2 and 3, appendix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

Array = np.ndarray
JOINTS = ("theta1", "theta2", "theta3")


@dataclass(frozen=True)
class PhantomParameters:
    """Lengths and inertias of the PHANToM family (1.0, 1.5, 3.0 differ in their numbers); SI units.

    Attributes:
        l1: Upper arm.
        l2: Forearm, elbow to tip.
        l3: Crank: distance of the parallel link from the upper arm.
        l5: Centre of mass of BE along the upper arm, from the joint centre.
        l6: Centre of mass of DF, from the joint centre away from the forearm.
        m_a: Mass of the forearm A, centre at ``l2 / 2``.
        m_c: Mass of the parallel link C, centre at ``l1 / 2``.
        m_be: Mass of upper arm and counterweight motor BE.
        m_df: Mass of crank and counterweight motor DF.
        inertia_a: Principal moments (x, y, z) about the centre of mass.
        inertia_c: Principal moments (x, y, z) about the centre of mass.
        inertia_be: Moments (x, y, z) about the joint centre, with the rotor as geared in x.
        inertia_df: Moments (x, y, z) about the joint centre, with the rotor as geared in x.
        inertia_base: Moment of the base about y, with its rotor.
        rotor_inertia: Rotor of theta2 and of theta3 seen at the joint: the part of ``inertia_be[0]`` and
            ``inertia_df[0]`` that belongs to no link.
        gear_ratio: Of theta2 and theta3.
    """

    l1: float
    l2: float
    l3: float
    l5: float
    l6: float
    m_a: float
    m_c: float
    m_be: float
    m_df: float
    inertia_a: tuple[float, float, float]
    inertia_c: tuple[float, float, float]
    inertia_be: tuple[float, float, float]
    inertia_df: tuple[float, float, float]
    inertia_base: float
    rotor_inertia: float
    gear_ratio: float

    @property
    def link_inertia_be(self) -> tuple[float, float, float]:
        """Moments of the link BE alone about its centre of mass."""
        x, y, z = self.inertia_be
        shift = self.m_be * self.l5**2
        return x - self.rotor_inertia - shift, y - shift, z

    @property
    def link_inertia_df(self) -> tuple[float, float, float]:
        """Moments of the link DF alone about its centre of mass."""
        x, y, z = self.inertia_df
        shift = self.m_df * self.l6**2
        return x - self.rotor_inertia - shift, y, z - shift


# The appendix, in which the moment "I_begg" is I_bezz. Only about the joint centre do the moments of BE and DF give the
# mass matrix of section 3. With the rotor in it no rigid body has them (I_xx exceeds I_yy + I_zz), and the rotor's own
# moment is not printed: 1.08e-6 kg m2 is the usual value of a Maxon RE25 motor, inside the range 0.3263e-6 to 1.1095e-6
# in which both links become possible bodies.
PHANTOM_1_5 = PhantomParameters(
    l1=0.215,
    l2=0.170,
    l3=0.0325,
    l5=-0.0368,
    l6=0.0527,
    m_a=0.0202,
    m_c=0.0249,
    m_be=0.2359,
    m_df=0.1906,
    inertia_a=(0.4864e-4, 0.001843e-4, 0.4864e-4),
    inertia_c=(0.959e-4, 0.959e-4, 0.0051e-4),
    inertia_be=(11.09e-4, 10.06e-4, 0.591e-4),
    inertia_df=(7.11e-4, 0.629e-4, 6.246e-4),
    inertia_base=11.87e-4,
    rotor_inertia=1.08e-6 * 11.6**2,
    gear_ratio=11.6,
)


def tip_position(q: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5) -> Float[Array, "N 3"]:
    """Tip in the device's frame [m] at joint angles ``q`` [rad], equation (1)."""
    l1, l2 = parameters.l1, parameters.l2
    (s1, s2, s3), (c1, c2, c3) = np.sin(q.T), np.cos(q.T)
    reach = l1 * c2 + l2 * s3
    return np.stack([s1 * reach, l2 - l2 * c3 + l1 * s2, -l1 + c1 * reach], axis=-1)


def tip_rotation(q: Float[Array, "N 3"]) -> Float[Array, "N 3 3"]:
    """Orientation of the forearm in the device's frame; the identity at zero."""
    s1, _, s3 = np.sin(q.T)
    c1, _, c3 = np.cos(q.T)
    rows = [[c1, -s1 * s3, s1 * c3], [np.zeros_like(c1), c3, s3], [-s1, -c1 * s3, c1 * c3]]
    return np.moveaxis(np.array(rows), -1, 0)


def inverse_kinematics(p: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5) -> Float[Array, "N 3"]:
    """Joint angles [rad] that bring the tip to ``p`` [m], in the one assembly that is possible.

    Args:
        p: Tip positions in the device's frame, shape ``(N, 3)``.
        parameters: Of the device.

    Returns:
        Angles, shape ``(N, 3)``; a row of NaN where the point is out of reach.
    """
    l1, l2 = parameters.l1, parameters.l2
    x, y, z = p[:, 0], p[:, 1] - l2, p[:, 2] + l1
    d = np.hypot(x, z)
    r = np.hypot(d, y)
    with np.errstate(invalid="ignore", divide="ignore"):
        shoulder = np.arccos((l1**2 + r**2 - l2**2) / (2 * l1 * r))
        elbow = np.arccos((l1**2 + l2**2 - r**2) / (2 * l1 * l2))
    theta2 = shoulder + np.arctan2(y, d)
    q = np.stack([np.arctan2(x, z), theta2, theta2 + elbow - np.pi / 2], axis=-1)
    q[np.isnan(q).any(axis=1)] = np.nan
    return q


def body_jacobian(q: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5) -> Float[Array, "N 6 3"]:
    """Jacobian to the tip's twist in the forearm's own axes: rows v [m/rad], then w, shape ``(N, 6, 3)``."""
    l1, l2 = parameters.l1, parameters.l2
    theta2, theta3 = q[:, 1], q[:, 2]
    J = np.zeros((len(q), 6, 3))
    J[:, 0, 0] = l1 * np.cos(theta2) + l2 * np.sin(theta3)
    J[:, 1, 1] = l1 * np.cos(theta2 - theta3)
    J[:, 2, 1] = -l1 * np.sin(theta2 - theta3)
    J[:, 2, 2] = l2
    J[:, 3, 2] = -1.0
    J[:, 4, 0] = np.cos(theta3)
    J[:, 5, 0] = np.sin(theta3)
    return J


def hybrid_jacobian(q: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5) -> Float[Array, "N 6 3"]:
    """Jacobian to the tip's twist in the device's axes: rows v, then w, shape ``(N, 6, 3)``."""
    rotation = tip_rotation(q)
    body = body_jacobian(q, parameters)
    return np.concatenate([rotation @ body[:, :3], rotation @ body[:, 3:]], axis=1)


def wrench_torque(
    q: Float[Array, "N 3"], wrench: Float[Array, "N 6"], parameters: PhantomParameters = PHANTOM_1_5
) -> Float[Array, "N 3"]:
    """Motor torque that holds a wrench at the tip.

    Args:
        q: Joint angles [rad], shape ``(N, 3)``.
        wrench: Force [N], then moment about the tip [N m], in the device's axes, that the tip exerts, shape ``(N, 6)``.
        parameters: Of the device.

    Returns:
        ``J^T F`` [N m], shape ``(N, 3)``.
    """
    return np.einsum("nij,ni->nj", hybrid_jacobian(q, parameters), wrench)


def manipulability(q: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5) -> Float[Array, " N"]:
    """Smallest over largest singular value of the translational Jacobian; at most ``l2 / l1``."""
    sigma = np.linalg.svd(body_jacobian(q, parameters)[:, :3], compute_uv=False)
    return sigma[:, -1] / sigma[:, 0]
