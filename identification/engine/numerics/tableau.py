"""Tableau (principal pivot transform) of a quadratic problem that is solved within bounds.

A free unknown is between its bounds, a held one at a bound. The tableau holds responses: the changes of the values of
all free unknowns, and of the slopes of the loss at all held ones, by a unit force on each free unknown (a change of the
linear part) and by a unit shift of each held one. From the responses `tableau_changes.py` computes the minimum of a
problem with additional unknowns, or without some of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from identification.engine.numerics.bounded import bounded_solve
from phantom_dyn.array_types import Array, Bool, Float

# Added to the unit diagonal, so that a problem with two equal columns has a solution. It is larger than in
# `bounded.py`, because computing an inverse loses twice as many digits as solving one system.
RIDGE = 1e-11
# Number of Newton steps that remove the rounding errors of the inverse.
_REFINED = 3
# A slope counts as nonzero only beyond this share of the largest entry of the linear part.
_ROUNDING = 1e-12


class Entering(NamedTuple):
    """Unknowns that are added to a solved problem, in scaled units.

    Attributes:
        cross: Entries of the quadratic part between the entering unknowns and those of the solved problem, ``(m, n)``.
        response: Response of the solved problem's unknowns to a shift of each entering one, ``(m, n)``.
        square: Entries of the quadratic part among the entering unknowns, ``(m, m)``.
        schur_complement: Second derivatives of the loss by the entering unknowns, while the free unknowns of the solved
            problem minimise the loss, ``(m, m)``.
        slope: Derivative of the loss by each entering unknown at zero, ``(m,)``.
        scale: Unit of each entering unknown, ``(m,)``.
    """

    cross: Float[Array, "m n"]
    response: Float[Array, "m n"]
    square: Float[Array, "m m"]
    schur_complement: Float[Array, "m m"]
    slope: Float[Array, " m"]
    scale: Float[Array, " m"]


class Tableau(NamedTuple):
    """A solved problem ``x a x / 2 - b x`` within bounds, in units in which ``a`` has a diagonal of ones.

    Attributes:
        a: Quadratic part, ``(n, n)``.
        b: Linear part, ``(n,)``.
        scale: Unit of each unknown, ``(n,)``.
        held: True for unknowns at a bound, ``(n,)``.
        x: Minimum, ``(n,)``.
        state: Values of free unknowns, slopes of held ones, ``(n,)``.
        response: Response of the state to a force on a free unknown or a shift of a held one, one row for each action,
            ``(n, n)``.
        rounding: Size below which a slope counts as zero.
    """

    a: Float[Array, "n n"]
    b: Float[Array, " n"]
    scale: Float[Array, " n"]
    held: Bool[Array, " n"]
    x: Float[Array, " n"]
    state: Float[Array, " n"]
    response: Float[Array, "n n"]
    rounding: float

    def entering_parts(
        self, cross: Float[Array, "m n"], diagonal: Float[Array, " m"], b: Float[Array, " m"]
    ) -> tuple[Float[Array, "m n"], Float[Array, "m n"], Float[Array, " m"], Float[Array, " m"]]:
        """Cross, response, slope and scale of `Entering`, which do not depend on the other entering unknowns.

        Args:
            cross: Entries of the quadratic part between the entering unknowns and those of the solved problem.
            diagonal: Diagonal entry of each entering unknown, prior included.
            b: Linear part of the entering unknowns.
        """
        scale = 1.0 / np.sqrt(np.maximum(diagonal, 1e-300))
        cross = cross * self.scale * scale[:, None]
        # A shift of an entering unknown is a force on the free unknowns, and changes the slopes of the held ones
        # directly.
        response = -np.where(self.held, 0.0, cross) @ self.response
        response[:, self.held] += cross[:, self.held]
        return cross, response, cross @ self.x - b * scale, scale

    def entering_of(
        self,
        cross: Float[Array, "m n"],
        response: Float[Array, "m n"],
        slope: Float[Array, " m"],
        scale: Float[Array, " m"],
        square: Float[Array, "m m"],
    ) -> Entering:
        """Entering unknowns, from the results of `entering_parts`.

        Args:
            cross: First result.
            response: Second result.
            slope: Third result.
            scale: Fourth result.
            square: Entries of the quadratic part among the entering unknowns, unscaled, priors included.
        """
        square = square * scale[:, None] * scale
        square.flat[:: len(square) + 1] += RIDGE
        free = ~self.held
        return Entering(cross, response, square, square + cross[:, free] @ response[:, free].T, slope, scale)


def tableau(
    a: Float[Array, "n n"],
    b: Float[Array, " n"],
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    near: Float[Array, " n"],
) -> Tableau:
    """Tableau of the solution of a quadratic problem within bounds.

    Args:
        a: Quadratic part, positive definite.
        b: Linear part.
        lower: Lower bounds.
        upper: Upper bounds.
        near: Minimum of a similar problem; NaN for unknowns without a start.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(a), 1e-300))
    x = bounded_solve(a, b, lower, upper, near) / scale
    held = (x <= lower / scale) | (x >= upper / scale)
    scaled, rhs = a * scale[:, None] * scale, b * scale
    scaled.flat[:: len(scaled) + 1] += RIDGE
    free, at_bound = np.flatnonzero(~held), np.flatnonzero(held)
    inverse = _inverse(scaled[np.ix_(free, free)])
    cross = scaled[np.ix_(free, at_bound)]
    response = np.empty_like(scaled)
    sensitivity = inverse @ cross
    response[np.ix_(free, free)] = inverse
    response[np.ix_(at_bound, free)] = -sensitivity.T
    response[np.ix_(free, at_bound)] = sensitivity
    response[np.ix_(at_bound, at_bound)] = scaled[np.ix_(at_bound, at_bound)] - cross.T @ sensitivity
    # Newton steps: the inverse alone is inaccurate where large terms cancel.
    for _ in range(_REFINED):
        x[free] += inverse @ (rhs[free] - scaled[free] @ x)
    state = np.where(held, scaled @ x - rhs, x)
    return Tableau(scaled, rhs, scale, held, x, state, response, _ROUNDING * float(np.abs(rhs).max(initial=0.0)))


def _inverse(a: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """Inverse of a positive definite matrix from its Cholesky factor, at half the cost of a general inverse."""
    from scipy.linalg import get_lapack_funcs

    if not len(a):  # LAPACK prints a warning for an empty matrix
        return a
    potrf, potri = get_lapack_funcs(("potrf", "potri"))
    factor, failed = potrf(a, lower=1)
    if failed:
        inverse = np.linalg.inv(a)
        return 0.5 * (inverse + inverse.T)
    lower_half = np.tril(potri(factor, lower=1)[0])
    return lower_half + np.tril(lower_half, -1).T
