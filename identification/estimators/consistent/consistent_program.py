"""What the estimator of physically consistent parameters is asked for, and its closed form where no edge acts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag, solve_triangular

from identification.estimators.consistent.consistent_bodies import Reference, Region, pseudo_inertia
from phantom_dyn.errors import ParameterError

Array = np.ndarray

FREE = 1e-3
"""Distance that a coefficient counts which explains as much as all bodies together; a body as far from its reference as
that itself counts 1. Where a recording cannot tell them apart, the coefficient gives way."""


@dataclass(frozen=True)
class Prior:
    r"""How strongly parameters are drawn towards those of reference bodies.

    Attributes:
        weight: In units of the log-likelihood: ``1 / s^2`` if the bodies are known to a share ``s`` (one sigma). The
            default only chooses among parameters that the recording cannot tell apart.
        kind: ``pullback``: :math:`\tfrac{1}{2} |P_0^{-1/2} (P - P_0) P_0^{-1/2}|_F^2`, a square; ``entropic``:
            :math:`\mathrm{tr}(P_0^{-1} P) - \log\det(P_0^{-1} P) - 4`, the Bregman divergence of the log-determinant
            ([Lee]_), which keeps bodies away from the edge of the possible.

    References:
        .. [Lee] T. Lee, P. M. Wensing, F. C. Park, Geometric robot dynamic identification: a convex programming
           approach, IEEE Transactions on Robotics 36(2), 2020. Checked against cvxpy in
           tests/identification/estimators/test_consistent_cone.py.
    """

    weight: float = 1e-6
    kind: str = "pullback"

    def __post_init__(self):
        if self.kind not in ("pullback", "entropic"):
            raise ParameterError(f"A prior of kind '{self.kind}' is unknown: give 'pullback' or 'entropic'.")
        if not (np.isfinite(self.weight) and self.weight > 0):
            raise ParameterError(f"The weight of a prior is {self.weight:g}: give a finite one above zero.")


@dataclass(frozen=True)
class Program:
    """Minimise ``|factor pi - target|^2 / 2`` plus the prior, among what is physically possible.

    The first ten columns per body are its standard parameters, the others free or bounded coefficients.

    Attributes:
        factor: Shape ``(k, p)``.
        target: Shape ``(k,)``.
        bodies: References, one per body.
        regions: Where the mass of each body is, or None.
        lower: Bounds of the coefficients after the bodies', ``-inf`` for none.
        upper: ``inf`` for none.
        prior: Towards the references.
        margin: Smallest eigenvalue of each pseudo-inertia in units of the reference's mass and radius of gyration; by
            default a thickness of one per mil of the radius, about what a file's digits can state.
        exact: True if ``factor pi == target`` is to hold, so that the prior alone is minimised.
    """

    factor: Float[Array, "k p"]
    target: Float[Array, " k"]
    bodies: tuple[Reference, ...]
    regions: tuple[Region | None, ...]
    lower: Float[Array, " e"]
    upper: Float[Array, " e"]
    prior: Prior = Prior()
    margin: float = 1e-6
    exact: bool = False

    @property
    def scale(self) -> Float[Array, " p"]:
        """Unit of each column: the reference's; of a coefficient, what makes its column as large as all bodies'."""
        own = np.concatenate([np.zeros(0), *(body.scale for body in self.bodies)])
        rest = np.linalg.norm(self.factor[:, len(own) :], axis=0)
        size = float(np.linalg.norm(self.factor[:, : len(own)] * own)) or float(rest.max(initial=0.0)) or 1.0
        return np.concatenate([own, np.where(rest > 0, size / np.where(rest > 0, rest, 1.0), 1.0)])


@dataclass(frozen=True)
class Point:
    """Solution of a `Program`.

    Attributes:
        pi: Shape ``(p,)``.
        held_bodies: Indices of bodies whose pseudo-inertia is at its margin.
        held_regions: Indices of bodies that are at the edge of their region.
        held_bounds: Indices of coefficients, from 0 after the bodies, that are at a bound.
    """

    pi: Float[Array, " p"]
    held_bodies: tuple[int, ...] = ()
    held_regions: tuple[int, ...] = ()
    held_bounds: tuple[int, ...] = ()


def is_possible(program: Program, pi: Float[Array, " p"]) -> bool:
    """True if all bodies, regions and bounds of a program allow these parameters."""
    n = len(program.bodies)
    scaled = pi / program.scale
    if n and np.linalg.eigvalsh(pseudo_inertia(scaled[: 10 * n].reshape(n, 10)))[:, 0].min() < program.margin:
        return False
    given = [(region, pi[10 * k : 10 * k + 10]) for k, region in enumerate(program.regions) if region is not None]
    if any((region.rows() @ standard < 0).any() for region, standard in given):
        return False
    coefficients = pi[10 * n :]
    return bool((coefficients >= program.lower).all() and (coefficients <= program.upper).all())


def nearest_unconstrained(program: Program) -> Float[Array, " p"]:
    """Parameters nearest to the reference that solve the equations best, possible or not: a closed form."""
    roots = [_root(body) for body in program.bodies]
    free = program.factor.shape[1] - 10 * len(program.bodies)
    inverse = np.asarray(block_diag(*roots, np.eye(free) / FREE))
    scale = program.scale
    start = np.concatenate([*(body.standard for body in program.bodies), np.zeros(free)])
    rows = program.factor * scale @ inverse
    sizes = np.linalg.norm(rows, axis=1)
    sizes[sizes == 0] = 1.0
    step = np.linalg.lstsq(rows / sizes[:, None], (program.target - program.factor @ start) / sizes, rcond=None)[0]
    return start + scale * (inverse @ step)


def _root(body: Reference) -> Array:
    """``U`` with ``|U^-1 d|`` the distance of a change ``d`` in units of the reference's scale."""
    return np.asarray(solve_triangular(np.linalg.qr(body.metric, mode="r"), np.eye(10)))
