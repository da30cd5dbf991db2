r"""What a hand at the tip of the CEA branch feels, for any link lengths: (18) of the source at chosen postures.

:math:`M_{op} = J^{-T} A J^{-1}`, :math:`K_{op} = J^{-T} K_{tot} J^{-1}`, :math:`F_{cop} = J^{-T} F_c`. Maps of the
robot file are in `phantom_dyn.maps`; here the lengths are free, as the source gives neither them nor its posture. So
the published ranges can be matched in size but its Figures 8 and 9 cannot be redrawn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from phantom_dyn.devices.cea import (
    COULOMB_FRICTION,
    COULOMB_RANGE_N,
    LENGTHS,
    MASS_RANGE_KG,
    STIFFNESS_RANGE,
    LinkLengths,
    tip_jacobian,
)
from phantom_dyn.devices.cea_dynamics import mass_matrix

Array = np.ndarray

STIFFNESS_OF_RANGES = 450.0
"""Joint stiffness [N m/rad] with which the published ranges of mass, Coulomb force and stiffness hold together.

The only possible reading of the printed unit gives 1000, see `phantom_dyn.devices.cea.STIFFNESS_UNITS`."""

_SINGULAR = 1e-6  # of the largest singular value of J


@dataclass(frozen=True)
class Felt:
    """Felt at the tip at N postures; nan where the tip cannot move in some direction.

    Attributes:
        mass: Largest apparent mass of any direction [kg], shape ``(N,)``.
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
        lengths: Of the links.
        stiffness: Of each joint, transmission and motor in series [N m/rad].

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


def nearest_posture(
    *, lengths: LinkLengths = LENGTHS, stiffness: float = STIFFNESS_OF_RANGES, step_deg: float = 3.0
) -> tuple[Float[Array, " 3"], Felt]:
    """Posture at q1 = 0 that comes nearest to the published ranges, and what is felt there.

    "Nearest" is in logarithms; of postures within all ranges, the one of largest apparent mass.

    Args:
        lengths: Of the links.
        stiffness: Of each joint [N m/rad].
        step_deg: Of the grid over q2 and q5 [deg].
    """
    angles = np.deg2rad(np.arange(-180.0, 180.0, step_deg))
    q2, q5 = (axis.ravel() for axis in np.meshgrid(angles, angles, indexing="ij"))
    # The arm on the side of x0; the other side is the same with q1 turned by half a circle.
    out = lengths.d3 * np.cos(q2) + lengths.d4 * np.cos(q5) > 0
    q = np.stack([np.zeros_like(q2), q2, q5], axis=1)[out]
    found = felt(q, lengths=lengths, stiffness=stiffness)
    off = _outside(found.coulomb, *COULOMB_RANGE_N) + _outside(found.stiffness, *STIFFNESS_RANGE).sum(axis=1)
    off += _outside(found.mass, 0.0, MASS_RANGE_KG[1])
    # Far below any distance that matters: only parts postures that are all within the ranges.
    k = int(np.nanargmin(off - 1e-6 * np.log(found.mass)))
    return q[k], Felt(found.mass[k : k + 1], found.coulomb[k : k + 1], found.stiffness[k : k + 1])


def _outside(values: Array, low: float, high: float) -> Array:
    """Square of how far, in logarithms, values lie outside a range."""
    below = np.log(low / values).clip(min=0) if low > 0 else 0.0
    return below**2 + np.log(values / high).clip(min=0) ** 2
