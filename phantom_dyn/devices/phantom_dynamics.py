r"""Dynamics of the PHANToM in closed form: :math:`M(q)\,a + C(q, v)\,v + N(q) = \tau`.

As published (see `phantom_dyn.devices.phantom`), with what the Lagrangian shows to be misprinted put right: the mass
and inertia "e" are those of C, C11 has the whole of its first line, and **C32 has a minus sign**. Only with it is C
the Christoffel matrix, and ``dM/dt - 2 C`` skew. Friction is not modelled.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from phantom_dyn.devices.phantom import PHANTOM_1_5, PhantomParameters

Array = np.ndarray


def _constants(p: PhantomParameters) -> tuple[float, float, float]:
    """What multiplies cos(theta2) sin(theta3), cos(2 theta2) and -cos(2 theta3); the last two times eight."""
    (_, ay, az), (_, cy, cz) = p.inertia_a, p.inertia_c
    (_, bey, bez), (_, dfy, dfz) = p.inertia_be, p.inertia_df
    coupling = p.l1 * (p.l2 * p.m_a + p.l3 * p.m_c)
    upper = 4 * (bey - bez + cy - cz) + p.l1**2 * (4 * p.m_a + p.m_c)
    fore = 4 * (az - ay + dfz - dfy) + p.l2**2 * p.m_a + 4 * p.l3**2 * p.m_c
    return coupling, upper, fore


def mass_matrix(q: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5) -> Float[Array, "N 3 3"]:
    """Mass matrix M [kg m2] with rotors, shape ``(N, 3, 3)``."""
    p = parameters
    coupling, upper, fore = _constants(p)
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
    """Christoffel matrix C [N m s/rad], shape ``(N, 3, 3)``: the velocity torque is ``C v``."""
    coupling, upper, fore = _constants(parameters)
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


def gravity_torque(
    q: Float[Array, "N 3"], parameters: PhantomParameters = PHANTOM_1_5, *, gravity: float = 9.81
) -> Float[Array, "N 3"]:
    """Gravity torque N [N m], shape ``(N, 3)``, for ``gravity`` [m/s2] along -y."""
    p = parameters
    N = np.zeros((len(q), 3))
    N[:, 1] = gravity * (p.l1 * p.m_a + p.l5 * p.m_be + p.l1 * p.m_c / 2) * np.cos(q[:, 1])
    N[:, 2] = gravity * (p.l2 * p.m_a / 2 + p.l3 * p.m_c - p.l6 * p.m_df) * np.sin(q[:, 2])
    return N
