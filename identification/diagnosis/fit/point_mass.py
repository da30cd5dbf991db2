"""Fit of a payload as a point mass.

The ten inertial parameters of a point mass follow from four: its mass and its first moments (mass times centre of
mass). The inertia is not linear in these four. So it is linearised about the last estimate, and the linear fit is
repeated.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.problem import Problem
from identification.engine.fits.bilinear import Products
from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.model.robot import Robot

# Largest number of iterations; then the last estimate is the result, converged or not.
STEPS = 8
# Relative change of the estimate below which it has converged.
_CONVERGED = 3e-3
# Derivative of ``h.h 1 - h h^T``, with entries xx, xy, yy, xz, yz, zz, with respect to ``h``, per component of ``h``.
_INERTIA_SLOPES = np.array(
    [
        [[0, 0, 0], [0, 2, 0], [0, 0, 2]],
        [[0, -1, 0], [-1, 0, 0], [0, 0, 0]],
        [[2, 0, 0], [0, 0, 0], [0, 0, 2]],
        [[0, 0, -1], [0, 0, 0], [-1, 0, 0]],
        [[0, 0, 0], [0, 0, -1], [0, -1, 0]],
        [[2, 0, 0], [0, 2, 0], [0, 0, 0]],
    ],
    dtype=float,
)
# A mass of at most this magnitude [kg] counts as zero. Its inertia, in which the mass is a divisor, is left out.
_NO_MASS = 1e-9


def converged(estimate: Float[Array, " 4"], last: Float[Array, " 4"]) -> bool:
    """True if an estimate of mass and first moments hardly differs from the ``last`` one."""
    return bool(np.abs(estimate - last).max() <= _CONVERGED * np.abs(last).max())


def best_estimate(
    problem: Problem,
    active: Int[Array, " k"],
    products: Products,
    payload: Term,
    theta: Float[Array, " K"],
    starts: list[Float[Array, " 4"]],
) -> Float[Array, " 4"]:
    """Mass and first moments with the least loss among those to which the iteration converges from several starts.

    The coefficients of all other columns are eliminated: those at a bound keep this value, and all others have their
    best values for each mass and first moments.

    Args:
        problem: Priors and bounds.
        active: Columns of the fit.
        products: Products of these columns.
        payload: The term of the payload.
        theta: All coefficients of a fit with free inertia; it shows which of them are at a bound.
        starts: Estimates of mass [kg] and first moments [kg m], ``(4,)`` each.
    """
    robot = problem.session.robot
    at = np.searchsorted(active, payload.columns)
    others = np.setdiff1d(np.arange(len(active)), at)
    x = theta[active]
    inside = (x[others] > problem.lower[active[others]]) & (x[others] < problem.upper[active[others]])
    free, fixed = others[inside], others[~inside]
    right_side = products.b - products.a[:, fixed] @ x[fixed]
    inner = products.a[np.ix_(free, free)] + np.diag(problem.precision[active[free]])
    cross = products.a[np.ix_(free, at)]
    solution = solve(inner, np.column_stack([cross, right_side[free]]))
    # Products of the ten columns of the payload with each other and with the residual, after this elimination.
    ten_gram = products.a[np.ix_(at, at)] - cross.T @ solution[:, :-1]
    ten_right_side = right_side[at] - cross.T @ solution[:, -1]
    prior, least_mass = problem.precision[active[at[:4]]], payload.effect.lightest(robot)

    def iterated(start: Float[Array, " 4"]) -> Float[Array, " 4"]:
        """Mass and first moments to which the iteration converges from a start."""
        estimate = start
        for _ in range(STEPS):
            last = estimate
            jacobian = load_jacobian(robot, payload, last)
            a = jacobian.T @ ten_gram @ jacobian + np.diag(prior)
            b = jacobian.T @ ten_right_side
            estimate = solve(a, b)
            low, high = mass_bounds(last[0], least_mass)
            if not low <= estimate[0] <= high:
                # The mass is fixed at its bound, and the first moments are solved for.
                mass = float(np.clip(estimate[0], low, high))
                estimate = np.array([mass, *solve(a[1:, 1:], b[1:] - a[1:, 0] * mass)])
            if converged(estimate, last):
                break
        return estimate

    def loss(estimate: Float[Array, " 4"]) -> float:
        """Loss of a point mass with its exact inertia, up to a constant."""
        ten = load_jacobian(robot, payload, estimate) @ estimate
        return float(ten @ ten_gram @ ten - 2.0 * ten_right_side @ ten + prior @ estimate**2)

    return min((iterated(start) for start in starts), key=loss)


@dataclass(frozen=True)
class PayloadMap:
    """Map between all coefficients of a fit and the reduced ones: mass and first moments replace a payload's ten.

    Mass and first moments come last among the reduced coefficients.

    Attributes:
        at: Indices of the ten columns of the payload, ``(10,)``.
        count: Number of columns.
        jacobian: Derivative of the ten inertial parameters with respect to mass and first moments (`load_jacobian`).
    """

    at: Int[Array, " 10"]
    count: int
    jacobian: Float[Array, "10 4"]

    @cached_property
    def others(self) -> Int[Array, " m"]:
        """Indices of all other columns."""
        return np.setdiff1d(np.arange(self.count), self.at)

    @property
    def kept_columns(self) -> Int[Array, " n"]:
        """Indices of the columns whose priors and bounds the reduced coefficients have."""
        return np.concatenate([self.others, self.at[:4]])

    @property
    def jacobian_of_all(self) -> Float[Array, "k n"]:
        """Derivative of the coefficients of all columns with respect to the reduced ones."""
        return self.expanded(np.eye(len(self.others) + 4)).T

    def reduced_gram(self, a: Float[Array, "*F k k"]) -> Float[Array, "*F n n"]:
        """Products of the reduced columns with each other."""
        others, n = self.others, len(self.others)
        out = np.empty((*a.shape[:-2], n + 4, n + 4))
        out[..., :n, :n] = a[..., others[:, None], others]
        cross = a[..., others[:, None], self.at] @ self.jacobian
        out[..., :n, n:] = cross
        out[..., n:, :n] = np.swapaxes(cross, -1, -2)
        out[..., n:, n:] = self.jacobian.T @ a[..., self.at[:, None], self.at] @ self.jacobian
        return out

    def reduced_right_side(self, b: Float[Array, "*F k"]) -> Float[Array, "*F n"]:
        """Products of the reduced columns with the residual."""
        return np.concatenate([b[..., self.others], b[..., self.at] @ self.jacobian], axis=-1)

    def expanded(self, x: Float[Array, "*F n"]) -> Float[Array, "*F k"]:
        """Coefficients of all columns from the reduced ones."""
        out = np.empty((*x.shape[:-1], self.count))
        out[..., self.others] = x[..., :-4]
        out[..., self.at] = x[..., -4:] @ self.jacobian.T
        return out


def load_jacobian(robot: Robot, term: Term, start: Float[Array, " 4"]) -> Float[Array, "10 4"]:
    """Derivative of a payload's ten inertial parameters with respect to mass and first moments (`point_mass_jacobian`).

    A negative mass is a part that the robot lacks. Its inertia then includes that of this part about its own centre.
    """
    return point_mass_jacobian(start, term.effect.own_inertia(robot, float(start[0])))


def mass_bounds(start: float, least_mass: float) -> tuple[float, float]:
    """Bounds of the mass [kg] in a fit linearised about the mass ``start``.

    They are half and double of that mass. The inertia is proportional to the inverse of the mass, so its linearisation
    does not hold farther away. If the start is zero, no inertia was linearised, and ``least_mass`` is the only bound.
    """
    if abs(start) <= _NO_MASS:
        return least_mass, np.inf
    low, high = sorted((0.5 * start, 2.0 * start))
    return max(low, least_mass), max(high, least_mass)


def point_mass_jacobian(start: Float[Array, " 4"], own: Float[Array, " 6"]) -> Float[Array, "10 4"]:
    """Derivative of the ten inertial parameters of a point mass with respect to mass and first moments ``(m, h)``.

    The inertia is ``(h.h 1 - h h^T) / m``, negative for a missing mass. It is homogeneous of degree one in ``(m, h)``,
    so the derivative times ``(m, h)`` gives the parameters themselves (Euler's theorem). If the mass is zero, the
    inertia is left out.

    Args:
        start: Mass [kg] and first moments [kg m].
        own: Inertia per mass about the centre of mass [m^2], as xx, xy, yy, xz, yz, zz; zero for a point.
    """
    jacobian = np.zeros((10, 4))
    jacobian[:4] = np.eye(4)
    m, h = start[0], start[1:]
    if abs(m) <= _NO_MASS:
        return jacobian
    by_moment = _INERTIA_SLOPES @ h / m
    jacobian[4:, 1:] = by_moment
    jacobian[4:, 0] = own - 0.5 * (by_moment @ h) / m
    return jacobian
