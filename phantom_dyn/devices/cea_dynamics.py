r"""Inverse dynamics of the CEA branch in closed form (Table 4), and mass, friction and stiffness that a hand feels.

:math:`\Gamma = A(q)\,a + H(q, v) + F_v v + F_c\,\mathrm{sign}\,v + \mathrm{offset} = D(q, v, a)\,x_b`, equations
(1) and (2), from kinetic energy :math:`\frac12 v^T A v` and potential energy :math:`-g \cdot R_1 s` with

.. math::
    A_{11} &= ZZ_1 + XX_2 \sin^2 q_2 + XX_3 \sin^2 q_5 + 2 d_3 MX_3 \cos q_2 \cos q_5, \\
    A_{22} &= ZZ_2, \quad A_{55} = ZZ_3, \quad A_{25} = d_3 MX_3 \cos(q_2 - q_5), \quad A_{12} = A_{15} = 0, \\
    s &= (MX_2 \cos q_2 + MX_3 \cos q_5,\; MY_1,\; -MX_2 \sin q_2 - MX_3 \sin q_5).

The parameters that Table 4 leaves out (small, says the source) are zero here. Two things in the equations of the source
are misprints: the noise is :math:`E(\rho \rho^T) = \sigma^2 I` in (4), and (5) lacks the square of the norm.

At the tip, (18): :math:`M_{op} = J^{-T} A J^{-1}`, :math:`K_{op} = J^{-T} K_{tot} J^{-1}`,
:math:`F_{cop} = J^{-T} F_c` at chosen postures. Maps of the robot file are in `phantom_dyn.maps`; here the lengths are
arguments, as the source states neither the lengths nor the posture. So a posture can be found at which the published
ranges are met, and figures like 8 and 9 can be drawn about it (``examples/cea_figures.py``), but not the same figures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.devices.cea import (
    COULOMB_FRICTION,
    COULOMB_RANGE_N,
    GRAVITY,
    INERTIAL,
    LENGTHS,
    MASS_RANGE_KG,
    STIFFNESS_RANGE,
    LinkLengths,
    tip_jacobian,
)
from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import Motion

NAMES = tuple(INERTIAL)
"""Parameters of Table 4."""
UNITS = tuple(parameter.unit for parameter in INERTIAL.values())
VALUES = np.array([parameter.value for parameter in INERTIAL.values()])
VALUES.flags.writeable = False
STIFFNESS_OF_RANGES = 450.0
"""Joint stiffness [N m/rad] at which the published ranges of mass, Coulomb force and stiffness can all be met.

The only possible reading of the printed unit gives 1000, see `phantom_dyn.devices.cea.STIFFNESS_UNITS`."""
_SINGULAR = 1e-6
"""Smallest over largest singular value of J below which the tip cannot move in some direction."""


def regressor(
    motion: Motion, *, lengths: LinkLengths = LENGTHS, gravity: tuple[float, float, float] = GRAVITY
) -> Float[Array, "N 3 16"]:
    """D of (2): drive torque per unit of each parameter of Table 4, in the order of `NAMES`.

    Args:
        motion: Motion of the active joints q1, q2, q5.
        lengths: Lengths of the links; only d3 enters.
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
        lengths: Lengths of the links; only d3 enters.
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


@dataclass(frozen=True)
class Felt:
    """Mass, friction and stiffness that a hand feels at the tip; NaN where the tip cannot move in some direction.

    Attributes:
        mass: Largest apparent mass over all directions [kg], shape ``(N,)``.
        coulomb: Largest Coulomb force [N], largest singular value of F_cop, shape ``(N,)``.
        stiffness: Diagonal of K_op in frame 0 [N/m], shape ``(N, 3)``.
    """

    mass: Float[Array, " N"]
    coulomb: Float[Array, " N"]
    stiffness: Float[Array, "N 3"]


def felt(q: Float[Array, "N 3"], *, lengths: LinkLengths = LENGTHS, stiffness: float = STIFFNESS_OF_RANGES) -> Felt:
    """Apparent mass, Coulomb force and stiffness at postures, with the parameters of Table 4.

    Args:
        q: Active angles q1, q2, q5 [rad].
        lengths: Lengths of the links.
        stiffness: Stiffness of each joint, transmission and motor in series [N m/rad].

    Raises:
        ParameterError: If the arm is too long for these parameters, see `cea_dynamics.longest_arm`.
    """
    J = tip_jacobian(q, lengths)
    sigma = np.linalg.svd(J, compute_uv=False)
    good = sigma[:, 2] > _SINGULAR * sigma[:, 0]
    inverse = np.full_like(J, np.nan)
    inverse[good] = np.linalg.inv(J[good])
    transposed = np.swapaxes(inverse, 1, 2)
    mass, coulomb = np.full(len(q), np.nan), np.full(len(q), np.nan)
    mass[good] = np.linalg.norm((transposed @ mass_matrix(q, lengths=lengths) @ inverse)[good], 2, axis=(1, 2))
    coulomb[good] = np.linalg.norm((transposed * np.array(COULOMB_FRICTION))[good], 2, axis=(1, 2))
    return Felt(mass, coulomb, stiffness * np.sum(inverse**2, axis=1))


def nearest_posture(*, lengths: LinkLengths = LENGTHS) -> tuple[Float[Array, " 3"], Felt]:
    """Posture at q1 = 0 whose figures come nearest to the published ranges, and these figures.

    Distances are those of logarithms. Of several postures within all ranges it is the one with the largest mass.

    Args:
        lengths: Lengths of the links.
    """
    angles = np.deg2rad(np.arange(-180.0, 180.0, 3.0))
    q2, q5 = (axis.ravel() for axis in np.meshgrid(angles, angles, indexing="ij"))
    # The arm on the side of x0; the other side is the same with q1 turned by half a circle.
    out = lengths.d3 * np.cos(q2) + lengths.d4 * np.cos(q5) > 0
    q = np.stack([np.zeros_like(q2), q2, q5], axis=1)[out]
    found = felt(q, lengths=lengths, stiffness=STIFFNESS_OF_RANGES)
    off = _outside(found.coulomb, *COULOMB_RANGE_N) + _outside(found.stiffness, *STIFFNESS_RANGE).sum(axis=1)
    off += _outside(found.mass, 0.0, MASS_RANGE_KG[1])
    # The last term is far below any distance that matters: it decides only among postures within all ranges.
    k = int(np.nanargmin(off - 1e-6 * np.log(found.mass)))
    return q[k], Felt(found.mass[k : k + 1], found.coulomb[k : k + 1], found.stiffness[k : k + 1])


def _outside(values: Array, low: float, high: float) -> Array:
    """Squared distance of values from a range, in logarithms; zero inside."""
    below = np.log(low / values).clip(min=0) if low > 0 else 0.0
    return below**2 + np.log(values / high).clip(min=0) ** 2
