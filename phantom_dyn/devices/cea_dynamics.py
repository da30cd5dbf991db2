r"""Inverse dynamics of the CEA branch in closed form, with the 16 parameters of Table 4.

:math:`\Gamma = A(q)\,a + H(q, v) + F_v v + F_c\,\mathrm{sign}\,v + \mathrm{offset} = D(q, v, a)\,x_b`, equations
(1) and (2), from kinetic energy :math:`\frac12 v^T A v` and potential energy :math:`-g \cdot R_1 s` with

.. math::
    A_{11} &= ZZ_1 + XX_2 \sin^2 q_2 + XX_3 \sin^2 q_5 + 2 d_3 MX_3 \cos q_2 \cos q_5, \\
    A_{22} &= ZZ_2, \quad A_{55} = ZZ_3, \quad A_{25} = d_3 MX_3 \cos(q_2 - q_5), \quad A_{12} = A_{15} = 0, \\
    s &= (MX_2 \cos q_2 + MX_3 \cos q_5,\; MY_1,\; -MX_2 \sin q_2 - MX_3 \sin q_5).

The parameters that Table 4 leaves out (small, says the source) are zero here. Two things in the equations of the source
are misprints: the noise is :math:`E(\rho \rho^T) = \sigma^2 I` in (4), and (5) lacks the square of the norm.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from phantom_dyn.devices.cea import GRAVITY, INERTIAL, LENGTHS, LinkLengths
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion

Array = np.ndarray

NAMES = tuple(INERTIAL)
UNITS = tuple(parameter.unit for parameter in INERTIAL.values())
VALUES = np.array([parameter.value for parameter in INERTIAL.values()])
VALUES.flags.writeable = False


def regressor(
    motion: Motion, *, lengths: LinkLengths = LENGTHS, gravity: tuple[float, float, float] = GRAVITY
) -> Float[Array, "N 3 16"]:
    """D of (2): drive torque per unit of each parameter of Table 4, in the order of `NAMES`.

    Args:
        motion: Of the active joints q1, q2, q5.
        lengths: Of the links; only d3 enters.
        gravity: In frame 0 [m/s^2].
    """
    (q1, q2, q5), (v1, v2, v5), (a1, a2, a5) = motion.q.T, motion.v.T, motion.a.T
    c1, s1, c2, s2, c5, s5 = np.cos(q1), np.sin(q1), np.cos(q2), np.sin(q2), np.cos(q5), np.sin(q5)
    g1, g2, g3 = c1 * gravity[0] + s1 * gravity[1], c1 * gravity[1] - s1 * gravity[0], gravity[2]
    d3, c, s = lengths.d3, np.cos(q2 - q5), np.sin(q2 - q5)
    columns = {
        ("ZZ1R", 0): a1,
        ("MY1R", 0): g1,
        ("XX2R", 0): s2**2 * a1 + 2 * s2 * c2 * v1 * v2,
        ("XX2R", 1): -s2 * c2 * v1**2,
        ("ZZ2R", 1): a2,
        ("MX2R", 0): -g2 * c2,
        ("MX2R", 1): g1 * s2 + g3 * c2,
        ("XX3R", 0): s5**2 * a1 + 2 * s5 * c5 * v1 * v5,
        ("XX3R", 2): -s5 * c5 * v1**2,
        ("ZZ3R", 2): a5,
        ("MX3R", 0): 2 * d3 * (c2 * c5 * a1 - s2 * c5 * v1 * v2 - c2 * s5 * v1 * v5) - g2 * c5,
        ("MX3R", 1): d3 * (c * a5 + s * v5**2 + s2 * c5 * v1**2),
        ("MX3R", 2): d3 * (c * a2 - s * v2**2 + c2 * s5 * v1**2) + g1 * s5 + g3 * c5,
        ("OFF2", 1): 1.0,
        ("OFF5", 2): 1.0,
    }
    for row, (viscous, coulomb) in enumerate((("FV1", "FS1"), ("FV2R", "FS2"), ("FV5R", "FS5R"))):
        columns |= {(viscous, row): motion.v[:, row], (coulomb, row): np.sign(motion.v[:, row])}
    out = np.zeros((len(motion.t), 3, len(NAMES)))
    for (name, row), column in columns.items():
        out[:, row, NAMES.index(name)] = column
    return out


def mass_matrix(
    q: Float[Array, "N 3"], *, lengths: LinkLengths = LENGTHS, parameters: Float[Array, " 16"] = VALUES
) -> Float[Array, "N 3 3"]:
    """A of (1) [kg m^2] at N active positions.

    Args:
        q: Active angles q1, q2, q5 [rad].
        lengths: Of the links; only d3 enters.
        parameters: In the order of `NAMES`.

    Raises:
        ParameterError: If the arm is so long that these parameters belong to no body, see `longest_arm`.
    """
    limit = longest_arm(parameters)
    if lengths.d3 >= limit:
        raise ParameterError(
            f"With an arm of d3 = {lengths.d3:g} m the mass matrix of these parameters is not positive definite: "
            f"give less than {limit:.3f} m."
        )
    p = dict(zip(NAMES, parameters, strict=True))
    q2, q5 = q[:, 1], q[:, 2]
    coupling = lengths.d3 * p["MX3R"]
    out = np.zeros((len(q), 3, 3))
    out[:, 0, 0] = p["ZZ1R"] + p["XX2R"] * np.sin(q2) ** 2 + p["XX3R"] * np.sin(q5) ** 2
    out[:, 0, 0] += 2 * coupling * np.cos(q2) * np.cos(q5)
    out[:, 1, 1], out[:, 2, 2] = p["ZZ2R"], p["ZZ3R"]
    out[:, 1, 2] = out[:, 2, 1] = coupling * np.cos(q2 - q5)
    return out


def longest_arm(parameters: Float[Array, " 16"] = VALUES) -> float:
    r"""Length d3 [m] below which A is positive definite in q2 and q5: :math:`\sqrt{ZZ_2 ZZ_3} / |MX_3|`.

    Args:
        parameters: In the order of `NAMES`.
    """
    p = dict(zip(NAMES, parameters, strict=True))
    return float(np.sqrt(p["ZZ2R"] * p["ZZ3R"]) / abs(p["MX3R"]))
