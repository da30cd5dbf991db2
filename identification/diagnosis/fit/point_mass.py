"""Fit of a payload as a point mass.

The inertia of a point mass is not linear in mass and first moments. So it is linearised about the last estimate, and
the linear fit is repeated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from identification.diagnosis.columns.terms import Term
from identification.diagnosis.fit.problem import Problem
from identification.engine.fits.bilinear import Products
from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.model.robot import Robot

# Largest number of iterations.
STEPS = 8
# Relative change of the estimate below which it has converged.
_CONVERGED = 3e-3
# Derivative of ``h.h 1 - h h^T``, with entries xx, xy, yy, xz, yz, zz, with respect to ``h``, per component of ``h``.
_INERTIA = np.array(
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
# Mass [kg] that counts as zero.
_NO_MASS = 1e-9


def converged(start: Float[Array, " 4"], last: Float[Array, " 4"]) -> bool:
    """True if an estimate ``start`` of mass and first moments hardly differs from the ``last`` one."""
    return bool(np.abs(start - last).max() <= _CONVERGED * np.abs(last).max())


@dataclass(frozen=True)
class ReducedLoad:
    """Fit of one payload with all other columns eliminated.

    Coefficients at a bound are held there; all others are optimal for the payload.

    Attributes:
        a, b: Products of the ten columns of the payload, ``(10, 10)`` and ``(10,)``.
        prior: Prior precision of mass and first moments, ``(4,)``.
        map: Gives the derivative of the ten inertial parameters at a mass and first moments (`load_map`).
        least: Smallest mass [kg]; negative if the robot may lack a part that the model has.
    """

    a: Float[Array, "10 10"]
    b: Float[Array, " 10"]
    prior: Float[Array, " 4"]
    map: Callable[[Float[Array, " 4"]], Float[Array, "10 4"]]
    least: float

    def iterated(self, start: Float[Array, " 4"]) -> Float[Array, " 4"]:
        """Mass and first moments to which the iteration converges from a start."""
        for _ in range(STEPS):
            last = start
            jacobian = self.map(last)
            a = jacobian.T @ self.a @ jacobian + np.diag(self.prior)
            b = jacobian.T @ self.b
            start = solve(a, b)
            low, high = mass_bounds(last[0], self.least)
            if not low <= start[0] <= high:
                # The mass is held at its bound, and the first moments are solved for.
                mass = float(np.clip(start[0], low, high))
                start = np.array([mass, *solve(a[1:, 1:], b[1:] - a[1:, 0] * mass)])
            if converged(start, last):
                break
        return start

    def loss(self, x: Float[Array, " 4"]) -> float:
        """Loss of a point mass with its exact inertia, up to a constant."""
        theta = self.map(x) @ x
        return float(theta @ self.a @ theta - 2.0 * self.b @ theta + self.prior @ x**2)


def reduced_load(
    problem: Problem, active: Int[Array, " k"], products: Products, payload: Term, theta: Float[Array, " K"]
) -> ReducedLoad:
    """The fit of a payload with all other columns of a fit eliminated.

    Args:
        problem: Priors and bounds.
        active: Columns of the fit.
        products: Products of these columns.
        payload: The term of the payload.
        theta: All coefficients of a fit with free inertia, by which the columns at a bound are known.
    """
    at = np.searchsorted(active, payload.columns)
    others = np.setdiff1d(np.arange(len(active)), at)
    x = theta[active]
    # Coefficients at a bound are held, all others are free.
    inside = (x[others] > problem.lower[active[others]]) & (x[others] < problem.upper[active[others]])
    free, held = others[inside], others[~inside]
    b = products.b - products.a[:, held] @ x[held]
    inner = products.a[np.ix_(free, free)] + np.diag(problem.precision[active[free]])
    cross = products.a[np.ix_(free, at)]
    solution = solve(inner, np.column_stack([cross, b[free]]))
    return ReducedLoad(
        a=products.a[np.ix_(at, at)] - cross.T @ solution[:, :-1],
        b=b[at] - cross.T @ solution[:, -1],
        prior=problem.precision[active[at[:4]]],
        map=partial(load_map, problem.session.robot, payload),
        least=payload.effect.lightest(problem.session.robot),
    )


@dataclass(frozen=True)
class FoldedLoad:
    """Map between all coefficients of a fit and reduced ones: the ten of a payload become mass and first moments, last.

    Attributes:
        at: Indices of the ten columns of the payload, ``(10,)``.
        count: Number of columns.
        jacobian: Derivative of the ten inertial parameters with respect to mass and first moments (`load_map`).
    """

    at: Int[Array, " 10"]
    count: int
    jacobian: Float[Array, "10 4"]

    @cached_property
    def others(self) -> Int[Array, " m"]:
        """Indices of all other columns."""
        return np.setdiff1d(np.arange(self.count), self.at)

    @property
    def keep(self) -> Int[Array, " n"]:
        """Indices of the columns whose priors and bounds the reduced coefficients have."""
        return np.concatenate([self.others, self.at[:4]])

    @property
    def expand(self) -> Float[Array, "k n"]:
        """Derivative of the coefficients of all columns with respect to the reduced ones."""
        return self.unfolded(np.eye(len(self.others) + 4)).T

    def reduced_gram(self, a: Float[Array, "*F k k"]) -> Float[Array, "*F n n"]:
        """Products of the reduced columns with each other."""
        many, n = self.others, len(self.others)
        out = np.empty((*a.shape[:-2], n + 4, n + 4))
        out[..., :n, :n] = a[..., many[:, None], many]
        cross = a[..., many[:, None], self.at] @ self.jacobian
        out[..., :n, n:] = cross
        out[..., n:, :n] = np.swapaxes(cross, -1, -2)
        out[..., n:, n:] = self.jacobian.T @ a[..., self.at[:, None], self.at] @ self.jacobian
        return out

    def reduced_right(self, b: Float[Array, "*F k"]) -> Float[Array, "*F n"]:
        """Products of the reduced columns with the residual."""
        return np.concatenate([b[..., self.others], b[..., self.at] @ self.jacobian], axis=-1)

    def unfolded(self, x: Float[Array, "*F n"]) -> Float[Array, "*F k"]:
        """Coefficients of all columns from the reduced ones."""
        out = np.empty((*x.shape[:-1], self.count))
        out[..., self.others] = x[..., :-4]
        out[..., self.at] = x[..., -4:] @ self.jacobian.T
        return out


def load_map(robot: Robot, term: Term, start: Float[Array, " 4"]) -> Float[Array, "10 4"]:
    """`point_mass_map` of a term, with the inertia of the missing part if the mass is negative."""
    return point_mass_map(start, term.effect.own_inertia(robot, float(start[0])))


def mass_bounds(start: float, least: float) -> tuple[float, float]:
    """Bounds of the mass [kg] in a fit linearised about the mass ``start``.

    They are half and double of that mass, because the inertia is proportional to its inverse. A start without mass has
    no centre of mass, and bounds the mass by ``least`` only.
    """
    if abs(start) <= _NO_MASS:
        return least, np.inf
    low, high = sorted((0.5 * start, 2.0 * start))
    return max(low, least), max(high, least)


def point_mass_map(start: Float[Array, " 4"], own: Float[Array, " 6"]) -> Float[Array, "10 4"]:
    """Derivative of the ten inertial parameters of a point mass with respect to mass and first moments ``(m, h)``.

    The inertia is ``(h.h 1 - h h^T) / m``, negative for a missing mass. It is homogeneous of degree one in ``(m, h)``,
    so the derivative times ``(m, h)`` gives the parameters themselves (Euler's theorem). If the mass is zero, the
    inertia is left out.

    Args:
        start: Mass and first moments.
        own: Inertia per mass about the centre of mass, as xx, xy, yy, xz, yz, zz; zero for a point.
    """
    jacobian = np.zeros((10, 4))
    jacobian[:4] = np.eye(4)
    m, h = start[0], start[1:]
    if abs(m) <= _NO_MASS:
        return jacobian
    by_moment = _INERTIA @ h / m
    jacobian[4:, 1:] = by_moment
    jacobian[4:, 0] = own - 0.5 * (by_moment @ h) / m
    return jacobian
