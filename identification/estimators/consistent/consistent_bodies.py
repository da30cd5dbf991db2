r"""Pseudo-inertia matrices of bodies, which state whether inertial parameters are physically consistent.

A body with given parameters can exist if and only if its pseudo-inertia :math:`P = \int [x; 1][x; 1]^T dm` (4 x 4,
[Wensing]_) is positive semidefinite. The matrix is linear in the ten inertial parameters.

References:
    .. [Wensing] P. M. Wensing, S. Kim, J.-J. E. Slotine, Linear matrix inequalities for physically consistent inertial
       parameter identification, IEEE Robotics and Automation Letters 3(1), 2018. The eigenvalues are checked against
       central inertias in tests/identification/estimators/consistent/test_consistent.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError

_ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # order of the six inertia entries

_FLOOR = 1e-4
"""Smallest eigenvalue of a reference body's pseudo-inertia, in units of mass and squared radius of gyration. It means a
thickness of 1 % of that radius. Robot files contain rods and points, from which every distance would otherwise be
infinite, and inertias that violate the triangle inequality."""


def _pseudo_basis() -> Array:
    """Pseudo-inertia per unit of each of the ten parameters."""
    basis = np.zeros((10, 4, 4))
    basis[0, 3, 3] = 1.0
    for axis in range(3):
        basis[1 + axis, axis, 3] = basis[1 + axis, 3, axis] = 1.0
    for k, (i, j) in enumerate(_ENTRIES):
        if i == j:
            basis[4 + k, :3, :3] = 0.5 * np.eye(3)
        basis[4 + k, i, j] -= 1.0
        basis[4 + k, j, i] = basis[4 + k, i, j]
    return basis


PSEUDO = _pseudo_basis()
"""Pseudo-inertia per unit of each of the ten parameters, ``(10, 4, 4)``."""


def pseudo_inertia(standard: Float[Array, "*b 10"]) -> Float[Array, "*b 4 4"]:
    """Pseudo-inertia [kg m^2, kg m, kg] from the ten standard parameters about the joint origin.

    Args:
        standard: Parameters in the order of `phantom_dyn.model.inertia.STANDARD_NAMES`.
    """
    return np.einsum("...k,kij->...ij", standard, PSEUDO)


def standard_of(pseudo: Float[Array, "4 4"]) -> Float[Array, " 10"]:
    """The ten standard parameters of a pseudo-inertia, inverse of `pseudo_inertia`."""
    second = pseudo[:3, :3]
    inertia = np.trace(second) * np.eye(3) - second
    return np.concatenate([[pseudo[3, 3]], pseudo[:3, 3], [inertia[i, j] for i, j in _ENTRIES]])


@dataclass(frozen=True)
class ReferenceBody:
    """A body from which the distance of other parameters is measured, in units of its mass and radius of gyration.

    Attributes:
        standard: Ten parameters of the body; if such a body cannot exist, the nearest possible ones.
        scale: Unit of each of the ten parameters.
        whitening: ``C^-1``, where ``C C^T`` is the body's pseudo-inertia in these units.
    """

    standard: Float[Array, " 10"]
    scale: Float[Array, " 10"]
    whitening: Float[Array, "4 4"]

    @property
    def metric(self) -> Float[Array, "16 10"]:
        r"""``L`` with :math:`|L d|^2 = |C^{-1} P(d) C^{-T}|_F^2` for a change ``d`` in units of ``scale``."""
        whitened = np.einsum("ai,kij,bj->abk", self.whitening, PSEUDO, self.whitening)
        return whitened.reshape(16, 10)


def reference_body(standard: Float[Array, " 10"], *, mass: float | None = None) -> ReferenceBody:
    """The reference body for given parameters; eigenvalues of the pseudo-inertia below `_FLOOR` are raised to it.

    Args:
        standard: Ten parameters of the body.
        mass: Unit of mass [kg]; by default the body's mass, or 1 for a body without mass.
    """
    unit = mass if mass is not None else float(standard[0])
    unit = unit if unit > 0 else 1.0
    squared = max(0.5 * float(standard[4] + standard[6] + standard[9]), 0.0) / unit
    # Unit of length [m]: the radius of gyration about the joint.
    reach = float(np.sqrt(squared))
    reach = reach if reach > 1e-4 else 0.1
    scale = unit * np.concatenate([[1.0], np.full(3, reach), np.full(6, reach**2)])
    values, vectors = np.linalg.eigh(pseudo_inertia(standard / scale))
    lifted = np.maximum(values, _FLOOR)
    possible = standard_of((vectors * lifted) @ vectors.T) * scale if (values < _FLOOR).any() else standard
    return ReferenceBody(possible, scale, (vectors / np.sqrt(lifted)).T)


def reference_bodies(standard: Float[Array, " p"]) -> tuple[ReferenceBody, ...]:
    """The reference body for each body; a body without mass has the mean of the other masses as its unit of mass."""
    bodies = standard.reshape(-1, 10)
    if not np.isfinite(bodies).all():
        raise ParameterError("The parameters of a reference body are not finite: give finite ones.")
    masses = bodies[bodies[:, 0] > 0, 0]
    usual = float(masses.mean()) if len(masses) else 1.0
    return tuple(reference_body(body, mass=float(body[0]) if body[0] > 0 else usual) for body in bodies)
