"""A payload as a point mass: its inertia is not linear in mass and first moments, so it is taken about an estimate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.fit.products import Products
from identification.diagnosis.model.terms import Term
from identification.diagnosis.numerics.bounded import solve

Array = np.ndarray

STEPS = 8
"""Steps from one estimate to the next at most."""
# Relative change of the estimate below which it is settled.
_SETTLED = 3e-3
# A point has no inertia about its centre.
_POINT = np.zeros(6)
# Mass [kg] that is none.
_NO_MASS = 1e-9


def settled(start: Float[Array, " 4"], last: Float[Array, " 4"]) -> bool:
    """True if an estimate hardly differs from the last one."""
    return bool(np.abs(start - last).max() <= _SETTLED * np.abs(last).max())


@dataclass(frozen=True)
class ReducedLoad:
    """The fit of one payload, all other columns eliminated: those at a bound stay there, the others are at their best.

    Attributes:
        a, b: Products of the ten columns of the payload, ``(10, 10)`` and ``(10,)``.
        prior: Precision of mass and first moments, ``(4,)``.
        map: `load_map` of the payload.
        least: Lightest load [kg], negative where the model may carry a part that is missing.
    """

    a: Float[Array, "10 10"]
    b: Float[Array, " 10"]
    prior: Float[Array, " 4"]
    map: Callable[[Float[Array, " 4"]], tuple[Float[Array, "10 4"], Float[Array, " 10"]]]
    least: float

    def followed(self, start: Float[Array, " 4"]) -> Float[Array, " 4"]:
        """Mass and first moments to which the steps from a start lead."""
        for _ in range(STEPS):
            last = start
            jacobian, offset = self.map(last)
            a = jacobian.T @ self.a @ jacobian + np.diag(self.prior)
            b = jacobian.T @ (self.b - self.a @ offset)
            start = solve(a, b)
            low, high = mass_bounds(last[0], self.least)
            if not low <= start[0] <= high:
                mass = float(np.clip(start[0], low, high))
                start = np.array([mass, *solve(a[1:, 1:], b[1:] - a[1:, 0] * mass)])
            if settled(start, last):
                break
        return start

    def loss(self, x: Float[Array, " 4"]) -> float:
        """Loss of a point mass with its exact inertia, up to a constant."""
        jacobian, offset = self.map(x)
        theta = jacobian @ x + offset
        return float(theta @ self.a @ theta - 2.0 * self.b @ theta + self.prior @ x**2)


def reduced_load(
    problem: Problem, active: Int[Array, " k"], products: Products, payload: Term, theta: Float[Array, " K"]
) -> ReducedLoad:
    """Eliminate all columns of a fit but those of its payload.

    Args:
        problem: Priors and bounds.
        active: Columns of the fit.
        products: Of these.
        payload: One of the terms.
        theta: All coefficients of a fit with free inertia, which says what is at a bound.
    """
    at = np.searchsorted(active, payload.columns)
    others = np.setdiff1d(np.arange(len(active)), at)
    x = theta[active]
    inside = (x[others] > problem.lower[active[others]]) & (x[others] < problem.upper[active[others]])
    free, held = others[inside], others[~inside]
    b = products.b - products.a[:, held] @ x[held]
    inner = products.a[np.ix_(free, free)] + np.diag(problem.precision[active[free]])
    cross = products.a[np.ix_(free, at)]
    made = solve(inner, np.column_stack([cross, b[free]]))
    return ReducedLoad(
        a=products.a[np.ix_(at, at)] - cross.T @ made[:, :-1],
        b=b[at] - cross.T @ made[:, -1],
        prior=problem.precision[active[at[:4]]],
        map=partial(load_map, problem, payload),
        least=payload.effect.lightest(problem.session.robot),
    )


def load_map(
    problem: Problem, term: Term, start: Float[Array, " 4"]
) -> tuple[Float[Array, "10 4"], Float[Array, " 10"]]:
    """`point_mass_map` of what a term may stand for."""
    return point_mass_map(start, term.effect.own_inertia(problem.session.robot, float(start[0])))


def mass_bounds(start: float, least: float) -> tuple[float, float]:
    """Between which masses a fit about one moves: linearised, the inertia goes as 1/m, so that it doubles or halves.

    One of zero has no centre and may become any.
    """
    if abs(start) <= _NO_MASS:
        return least, np.inf
    low, high = sorted((0.5 * start, 2.0 * start))
    return max(low, least), max(high, least)


def point_mass_map(
    start: Float[Array, " 4"], own: Float[Array, " 6"] = _POINT
) -> tuple[Float[Array, "10 4"], Float[Array, " 10"]]:
    """Ten inertial parameters of a point mass from mass and first moments ``(m, h)``, linearised: ``J x + c``.

    The inertia is ``(h.h 1 - h h^T) / m``, negative with a mass that is missing. Without a mass at the start it is left
    out.

    Args:
        start: Mass and first moments.
        own: Inertia about the centre per mass, of a part that is no point.
    """
    jacobian = np.zeros((10, 4))
    jacobian[:4] = np.eye(4)
    offset = np.zeros(10)
    m, h = start[0], start[1:]
    if abs(m) <= _NO_MASS:
        return jacobian, offset
    entries = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
    for k, (i, j) in enumerate(entries):
        value = ((h @ h) * (i == j) - h[i] * h[j]) / m
        slope = np.zeros(4)
        slope[0] = -value / m
        for axis in range(3):
            slope[1 + axis] = (2 * h[axis] * (i == j) - (axis == i) * h[j] - h[i] * (axis == j)) / m
        jacobian[4 + k] = slope
        offset[4 + k] = value - slope @ start
    jacobian[4:, 0] += own
    return jacobian, offset
