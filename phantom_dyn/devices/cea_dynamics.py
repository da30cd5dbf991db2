r"""Inverse dynamics of the CEA branch in closed form (Table 4), and mass, friction and stiffness that a hand feels.

The source is the CEA paper (see `phantom_dyn.devices.cea`). :math:`R_1` rotates vectors from frame 1 to frame 0,
:math:`d_3` is the length of the arm, :math:`x_b` are the 16 parameters of Table 4, and :math:`K_{tot}` is the stiffness
of transmission and motor in series.

The drive torque is
:math:`\Gamma = A(q)\,a + H(q, v) + F_v v + F_c\,\mathrm{sign}\,v + \mathrm{offset} = D(q, v, a)\,x_b`, equations
(1) and (2). It follows from the kinetic energy :math:`\frac12 v^T A v` and the potential energy
:math:`-g \cdot R_1 s` with

.. math::
    A_{11} &= ZZ_1 + XX_2 \sin^2 q_2 + XX_3 \sin^2 q_5 + 2 d_3 MX_3 \cos q_2 \cos q_5, \\
    A_{22} &= ZZ_2, \quad A_{55} = ZZ_3, \quad A_{25} = d_3 MX_3 \cos(q_2 - q_5), \quad A_{12} = A_{15} = 0, \\
    s &= (MX_2 \cos q_2 + MX_3 \cos q_5,\; MY_1,\; -MX_2 \sin q_2 - MX_3 \sin q_5).

Parameters that Table 4 leaves out, because the source calls them small, are zero here. The equations of the source have
two misprints: the noise in (4) is :math:`E(\rho \rho^T) = \sigma^2 I`, and (5) lacks the square of the norm.

At the tip (18) gives :math:`M_{op} = J^{-T} A J^{-1}`, :math:`K_{op} = J^{-T} K_{tot} J^{-1}` and
:math:`F_{cop} = J^{-T} F_c`. Lengths are arguments here, because the source gives neither lengths nor posture. (For
maps of the robot as its file states it, see `phantom_dyn.maps`.) `nearest_posture` finds a posture whose values are in
the published ranges. About this posture, ``examples/cea_figures.py`` draws figures similar to figures 8 and 9 of the
source.
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
"""Stiffness of each joint [N m/rad] for which a posture exists whose mass, Coulomb force and stiffness at the tip are
all in the published ranges.

It is not from the paper: the printed stiffness, read in the only unit that is possible, is 1000 (see
`phantom_dyn.devices.cea.STIFFNESS_UNITS`)."""
# Ratio of smallest to largest singular value of J below which the tip cannot move in some direction.
_SINGULAR = 1e-6


def regressor(
    motion: Motion, *, lengths: LinkLengths = LENGTHS, gravity: tuple[float, float, float] = GRAVITY
) -> Float[Array, "N 3 16"]:
    """D of (2): drive torque per unit of each parameter of Table 4, in the order of `NAMES`.

    Args:
        motion: Motion of the active joints q1, q2, q5.
        lengths: Lengths of the links; only d3 is used.
        gravity: Gravity in frame 0 [m/s^2].
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
        lengths: Lengths of the links; only d3 is used.
        parameters: Parameters in the order of `NAMES`.

    Raises:
        ParameterError: If no bodies have these parameters because the arm is too long, see `longest_arm`.
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
        parameters: Parameters in the order of `NAMES`.
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
        ParameterError: If the arm is too long for these parameters, see `longest_arm`.
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
    """Posture at q1 = 0 whose mass, Coulomb force and stiffness are nearest to the published ranges, and these values.

    Distances are differences of logarithms. Of several postures within all ranges, the one with the largest mass is
    returned.

    Args:
        lengths: Lengths of the links.
    """
    angles = np.deg2rad(np.arange(-180.0, 180.0, 3.0))
    q2, q5 = (axis.ravel() for axis in np.meshgrid(angles, angles, indexing="ij"))
    # Only postures on the side of +x0: those on the other side differ by half a turn of q1.
    in_front = lengths.d3 * np.cos(q2) + lengths.d4 * np.cos(q5) > 0
    q = np.stack([np.zeros_like(q2), q2, q5], axis=1)[in_front]
    found = felt(q, lengths=lengths)
    distance = _outside(found.coulomb, *COULOMB_RANGE_N) + _outside(found.stiffness, *STIFFNESS_RANGE).sum(axis=1)
    distance += _outside(found.mass, 0.0, MASS_RANGE_KG[1])
    # The last term is so small that it decides only between postures within all ranges.
    k = int(np.nanargmin(distance - 1e-6 * np.log(found.mass)))
    return q[k], Felt(found.mass[k : k + 1], found.coulomb[k : k + 1], found.stiffness[k : k + 1])


def _outside(values: Array, low: float, high: float) -> Array:
    """Squared distance of the logarithm of each value from the logarithms of a range; zero inside the range."""
    below = np.log(low / values).clip(min=0) if low > 0 else 0.0
    return below**2 + np.log(values / high).clip(min=0) ** 2
