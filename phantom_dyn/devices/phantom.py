r"""PHANToM 1.5 in closed form: published parameters, kinematics, Jacobian and dynamics.

Joint angles ``q = (theta1, theta2, theta3)`` are absolute: theta2 is the angle of the upper arm, and theta3 that of the
forearm, which theta2 does not change. In the device's frame x points right, y up and z towards the user; its origin is
the tip in the zero configuration, in which the upper arm (``l1``) lies along +z and the forearm (``l2``) along -y.

The parallelogram cannot fold over, so that one assembly is possible: ``abs(theta3 - theta2) < pi / 2`` and
``l1 cos(theta2) + l2 sin(theta3) > 0``. The inverse kinematics returns this assembly.

The dynamics are :math:`M(q)\,a + C(q, v)\,v + N(q) = \tau` as published, without friction. Three misprints, which a
derivation from the Lagrangian shows, are corrected: the mass and inertia "e" are those of C, the denominator of C11
belongs to the whole first line, and **C32 has a minus sign**, with which C is the Christoffel matrix and
``dM/dt - 2 C`` is skew-symmetric.

References:
    M. C. Çavuşoğlu, D. Feygin, F. Tendick, *A Critical Study of the Mechanical and Electrical Properties of the PHANToM
    Haptic Interface and Improvements for High-Performance Control*, Presence 11(6), 2002: sections 2 and 3, appendix.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float


@dataclass(frozen=True)
class PhantomParameters:
    """Lengths and inertias of a device of the PHANToM family (1.0, 1.5, 3.0), in SI units.

    Attributes:
        l1: Length of the upper arm.
        l2: Length of the forearm, from elbow to tip.
        l3: Length of the crank, which is the distance of the parallel link from the upper arm.
        l5: Distance of the centre of mass of BE from the joint centre, along the upper arm.
        l6: Distance of the centre of mass of DF from the joint centre, away from the forearm.
        m_a: Mass of the forearm A, centre at ``l2 / 2``.
        m_c: Mass of the parallel link C, centre at ``l1 / 2``.
        m_be: Mass of upper arm and counterweight motor BE.
        m_df: Mass of crank and counterweight motor DF.
        inertia_a: Principal moments of inertia (x, y, z) of A about its centre of mass.
        inertia_c: Principal moments of inertia (x, y, z) of C about its centre of mass.
        inertia_be: Moments of inertia (x, y, z) of BE about the joint centre; x includes the rotor inertia.
        inertia_df: Moments of inertia (x, y, z) of DF about the joint centre; x includes the rotor inertia.
        inertia_base: Moment of inertia of the base about y, with its rotor.
        rotor_inertia: Inertia of the rotor of theta2, and of theta3, on the joint side of the gear.
        gear_ratio: Gear ratio of theta2 and theta3.
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
        """Moments of inertia of the link BE without rotor, about its centre of mass."""
        x, y, z = self.inertia_be
        shift = self.m_be * self.l5**2
        return x - self.rotor_inertia - shift, y - shift, z

    @property
    def link_inertia_df(self) -> tuple[float, float, float]:
        """Moments of inertia of the link DF without rotor, about its centre of mass."""
        x, y, z = self.inertia_df
        shift = self.m_df * self.l6**2
        return x - self.rotor_inertia - shift, y, z - shift


# Numbers of the appendix, in which the moment "I_begg" is I_bezz. The moments of BE and DF give the mass matrix of
# section 3 only if they are about the joint centre. They must include the rotor, because no rigid body without a rotor
# has them (I_xx exceeds I_yy + I_zz). The moment of the rotor alone is not printed: 1.08e-6 kg m2 is the usual value of
# a Maxon RE25 motor. With values from 0.3263e-6 to 1.1095e-6, rigid bodies can have the remaining moments.
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
    """Position of the tip in the device's frame [m] at joint angles ``q`` [rad], equation (1)."""
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
    """Joint angles [rad] at which the tip is at ``p`` [m], in the only possible assembly.

    Args:
        p: Tip positions in the device's frame, shape ``(N, 3)``.
        parameters: Parameters of the device.

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
    """Jacobian of the tip's twist in the forearm's own axes: rows v [m/rad], then w, shape ``(N, 6, 3)``."""
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
    """Jacobian of the tip's twist in the device's axes: rows v, then w, shape ``(N, 6, 3)``."""
    rotation = tip_rotation(q)
    body = body_jacobian(q, parameters)
    return np.concatenate([rotation @ body[:, :3], rotation @ body[:, 3:]], axis=1)


def wrench_torque(
    q: Float[Array, "N 3"], wrench: Float[Array, "N 6"], parameters: PhantomParameters = PHANTOM_1_5
) -> Float[Array, "N 3"]:
    """Motor torque with which the tip exerts a wrench.

    Args:
        q: Joint angles [rad], shape ``(N, 3)``.
        wrench: Force [N], then moment about the tip [N m], that the tip exerts, in the device's axes, ``(N, 6)``.
        parameters: Parameters of the device.

    Returns:
        ``J^T F`` [N m], shape ``(N, 3)``.
    """
    return np.einsum("nij,ni->nj", hybrid_jacobian(q, parameters), wrench)


def manipulability(q: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5) -> Float[Array, " N"]:
    """Ratio of smallest to largest singular value of the translational Jacobian; at most ``l2 / l1``."""
    sigma = np.linalg.svd(body_jacobian(q, parameters)[:, :3], compute_uv=False)
    return sigma[:, -1] / sigma[:, 0]


def mass_matrix(q: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5) -> Float[Array, "N 3 3"]:
    """Mass matrix M [kg m2] with rotors, shape ``(N, 3, 3)``."""
    p = parameters
    coupling, upper, fore = _coefficients(p)
    theta2, theta3 = q[:, 1], q[:, 2]
    moments = sum(p.inertia_a[1:]) + sum(p.inertia_c[1:]) + sum(p.inertia_be[1:]) + sum(p.inertia_df[1:])
    masses = p.m_a * (4 * p.l1**2 + p.l2**2) + p.m_c * (p.l1**2 + 4 * p.l3**2)
    M = np.zeros((len(q), 3, 3))
    M[:, 0, 0] = (
        (4 * moments + 8 * p.inertia_base + masses) / 8
        + upper * np.cos(2 * theta2) / 8
        - fore * np.cos(2 * theta3) / 8
        + coupling * np.cos(theta2) * np.sin(theta3)
    )
    M[:, 1, 1] = p.inertia_be[0] + p.inertia_c[0] + p.l1**2 * (p.m_a + p.m_c / 4)
    M[:, 2, 2] = p.inertia_a[0] + p.inertia_df[0] + p.l2**2 * p.m_a / 4 + p.l3**2 * p.m_c
    M[:, 1, 2] = M[:, 2, 1] = -coupling * np.sin(theta2 - theta3) / 2
    return M


def coriolis_matrix(
    q: Float[Array, "N 3"], v: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5
) -> Float[Array, "N 3 3"]:
    """Christoffel matrix C [kg m2/s], shape ``(N, 3, 3)``: the centrifugal and Coriolis torque is ``C v``."""
    coupling, upper, fore = _coefficients(parameters)
    theta2, theta3 = q[:, 1], q[:, 2]
    v1, v2, v3 = v.T
    along2 = upper * np.sin(2 * theta2) + 4 * coupling * np.sin(theta2) * np.sin(theta3)
    along3 = fore * np.sin(2 * theta3) + 4 * coupling * np.cos(theta2) * np.cos(theta3)
    C = np.zeros((len(q), 3, 3))
    C[:, 0, 0] = (along3 * v3 - along2 * v2) / 8
    C[:, 0, 1] = -along2 * v1 / 8
    C[:, 0, 2] = along3 * v1 / 8
    C[:, 1, 0] = -C[:, 0, 1]
    C[:, 2, 0] = -C[:, 0, 2]
    C[:, 1, 2] = coupling * np.cos(theta2 - theta3) * v3 / 2
    C[:, 2, 1] = -coupling * np.cos(theta2 - theta3) * v2 / 2
    return C


def gravity_torque(q: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5) -> Float[Array, "N 3"]:
    """Gravity torque N [N m], shape ``(N, 3)``, for 9.81 m/s2 along -y."""
    p = parameters
    N = np.zeros((len(q), 3))
    N[:, 1] = 9.81 * (p.l1 * p.m_a + p.l5 * p.m_be + p.l1 * p.m_c / 2) * np.cos(q[:, 1])
    N[:, 2] = 9.81 * (p.l2 * p.m_a / 2 + p.l3 * p.m_c - p.l6 * p.m_df) * np.sin(q[:, 2])
    return N


def _coefficients(p: PhantomParameters) -> tuple[float, float, float]:
    """Coefficients in M11: of cos(theta2) sin(theta3), eight times that of cos(2 theta2) and of -cos(2 theta3)."""
    (_, ay, az), (_, cy, cz) = p.inertia_a, p.inertia_c
    (_, bey, bez), (_, dfy, dfz) = p.inertia_be, p.inertia_df
    coupling = p.l1 * (p.l2 * p.m_a + p.l3 * p.m_c)
    upper = 4 * (bey - bez + cy - cz) + p.l1**2 * (4 * p.m_a + p.m_c)
    fore = 4 * (az - ay + dfz - dfy) + p.l2**2 * p.m_a + 4 * p.l3**2 * p.m_c
    return coupling, upper, fore
