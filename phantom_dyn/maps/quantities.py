r"""Quantities that a hand feels at the tip: mass, friction, stiffness and weight.

With the translational Jacobian J of the tip, an inverse A of J maps a velocity of the tip to joint velocities. Then
:math:`M_{op} = A^T M A`, :math:`B_{op} = A^T F_v A`, :math:`K_{op} = A^T K A`, :math:`F_{cop} = A^T F_c`, and the
weight is :math:`A^T g`. The largest singular value of :math:`F_{cop}` is the largest force of Coulomb friction that a
hand may feel.

With three active joints A is the inverse of J, and these equations are (18) of the source. With more joints A is the
generalised inverse with the least kinetic energy for masses, friction and weight, so that
:math:`M_{op} = (J M^{-1} J^T)^{-1}`, and the one with the least elastic energy for the stiffness. With fewer joints A
is the pseudo-inverse, and all quantities are zero in a direction in which the tip cannot move.

References:
    A. Janot et al., *Modeling and Identification of a 3 DOF Haptic Interface*, ICRA 2007, section VII: (18), (19).
    O. Khatib, *A unified approach for motion and force control of robot manipulators*, IEEE J. Robotics and
    Automation 3(1), 1987, for more joints than directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phantom_dyn.array_types import Array
from phantom_dyn.errors import ParameterError, known_names
from phantom_dyn.maps.map_model import JointSpace, MapModel, joint_space, projected_friction

SINGULAR = 1e-6
"""Ratio of smallest to largest singular value of J, below which a point counts as singular: at this ratio, rounding
errors of M_op are twelve digits larger."""


@dataclass(frozen=True)
class Quantity:
    """One quantity of a map.

    Attributes:
        name: Name on the command line and in files.
        title: Name in words.
        unit: Unit of the values; empty for a ratio.
        kind: ``scalar``, ``vector`` (x, y, z) or ``matrix`` (rows x, y, z).
        columns: Columns of a matrix: ``axes`` (x, y, z) or ``joints``.
        share: True if values are between 0 and 1 by definition.
    """

    name: str
    title: str
    unit: str
    kind: str
    columns: str = "axes"
    share: bool = False


_LIST = (
    Quantity("manipulability", "manipulability, smallest over largest singular value", "", "scalar", share=True),
    Quantity("apparent_mass", "apparent mass, largest singular value", "kg", "scalar"),
    Quantity("apparent_mass_matrix", "apparent mass", "kg", "matrix"),
    Quantity("stiffness", "stiffness", "N/m", "matrix"),
    Quantity("viscous_friction", "viscous friction", "N s/m", "matrix"),
    Quantity("coulomb_friction", "Coulomb friction", "N", "matrix", columns="joints"),
    Quantity("coulomb_force", "Coulomb friction, largest force at the tip", "N", "scalar"),
    Quantity("gravity_force", "force that holds the weight", "N", "vector"),
)
QUANTITIES = {quantity.name: quantity for quantity in _LIST}


def require_quantities(names: tuple[str, ...], model: MapModel) -> None:
    """Refuse unknown quantities, and a stiffness if the robot states none.

    Raises:
        ParameterError: If a quantity is refused; the message says what to give.
    """
    if not names:
        raise ParameterError(f"No quantity was given: name some of {', '.join(QUANTITIES)}.")
    for name in names:
        if name not in QUANTITIES:
            raise ParameterError(f"Unknown quantity {name!r}: {known_names(name, QUANTITIES, 'quantities')}")
    if "stiffness" in names and model.stiffness is None:
        raise ParameterError(
            f"Nothing states how stiff the joints of {model.name} are: give --stiffness, or each joint a controller "
            "with kp in robot.yaml, or leave the quantity stiffness out."
        )


def shape_of(name: str, nv: int) -> tuple[int, ...]:
    """Shape of one value of a quantity."""
    kind = QUANTITIES[name].kind
    if kind == "matrix":
        return (3, nv) if QUANTITIES[name].columns == "joints" else (3, 3)
    return (3,) if kind == "vector" else ()


def felt_at(model: MapModel, q: Array, names: tuple[str, ...]) -> tuple[dict[str, Array], Array]:
    """Quantities at joint positions.

    Args:
        model: The robot.
        q: Active positions [rad or m], shape ``(N, nv)``, finite.
        names: Names of `QUANTITIES`.

    Returns:
        Values by name, NaN at singular points, and a mask of singular points, shape ``(N,)``.
    """
    rest = [name for name in names if name != "manipulability"]
    space = joint_space(model, q, inertia=bool(rest))
    sigma = np.linalg.svd(space.J, compute_uv=False)
    singular = ~(sigma[:, -1] > SINGULAR * sigma[:, 0])
    out = {name: np.full((len(q), *shape_of(name, model.nv)), np.nan) for name in names}
    good = np.flatnonzero(~singular)
    if "manipulability" in out:
        out["manipulability"][good] = sigma[good, -1] / sigma[good, 0]
    if rest and len(good):
        values = _felt(model, space, good, rest)
        for name in rest:
            out[name][good] = values[name]
    return out, singular


def _felt(model: MapModel, space: JointSpace, rows: Array, names: list[str]) -> dict[str, Array]:
    """Quantities that need an inverse of J, at the samples ``rows``, which are not singular."""
    assert space.M is not None
    assert space.weight is not None
    J, M = space.J[rows], space.M[rows]
    A = _cheapest_inverse(J, M)
    viscous, coulomb = projected_friction(model.robot, space.G)
    out: dict[str, Array] = {}
    if {"apparent_mass", "apparent_mass_matrix"} & set(names):
        mass = _symmetric(_times_transposed(A, M) @ A)
        out["apparent_mass_matrix"] = mass
        if "apparent_mass" in names:  # the matrix is symmetric and positive, so eigenvalues are singular values
            out["apparent_mass"] = np.linalg.eigvalsh(mass)[:, -1]
    if "viscous_friction" in names:
        out["viscous_friction"] = _symmetric(_times_transposed(A, viscous[rows]) @ A)
    if {"coulomb_friction", "coulomb_force"} & set(names):
        out["coulomb_friction"] = np.swapaxes(A, 1, 2) * coulomb[rows, None, :]
        if "coulomb_force" in names:
            # The square root of the largest eigenvalue of the square is much faster than a singular value.
            squares = out["coulomb_friction"] @ np.swapaxes(out["coulomb_friction"], 1, 2)
            out["coulomb_force"] = np.sqrt(np.maximum(np.linalg.eigvalsh(squares)[:, -1], 0.0))
    if "gravity_force" in names:
        out["gravity_force"] = np.einsum("nji,nj->ni", A, space.weight[rows])
    if "stiffness" in names and model.stiffness is not None:
        A = A if model.nv <= 3 else _cheapest_inverse(J, np.diag(model.stiffness))
        out["stiffness"] = _symmetric(np.swapaxes(A, 1, 2) @ (model.stiffness[:, None] * A))
    return out


def _cheapest_inverse(J: Array, W: Array) -> Array:
    """Inverse of J that gives joint velocities with the least ``v^T W v``."""
    nv = J.shape[2]
    if nv == 3:
        return np.linalg.inv(J)
    if nv < 3:
        return np.linalg.pinv(J)
    back = np.linalg.solve(W, np.swapaxes(J, 1, 2))
    return back @ np.linalg.inv(J @ back)


def _times_transposed(A: Array, B: Array) -> Array:
    """``A^T B`` for each sample."""
    return np.swapaxes(A, 1, 2) @ B


def _symmetric(matrices: Array) -> Array:
    """Matrices that are symmetric up to rounding, made exactly symmetric."""
    return (matrices + np.swapaxes(matrices, 1, 2)) / 2
