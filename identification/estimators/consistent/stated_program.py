# pyright: reportAttributeAccessIssue=false
"""The program of physically consistent parameters as cvxpy has it: stated once for each shape, solved with any numbers.

Turning a program into cones takes cvxpy most of the time of a solution, and depends on nothing but the shapes of its
arrays: the numbers are parameters (disciplined parametrised programming, [Agrawal]_).

References:
    .. [Agrawal] A. Agrawal, B. Amos, S. Barratt, S. Boyd, S. Diamond, J. Z. Kolter, Differentiable convex optimization
       layers, NeurIPS 2019. The solutions are checked against cvxpy without parameters in
       tests/identification/estimators/consistent/test_consistent_cone.py.
"""

from __future__ import annotations

import threading
import warnings
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from phantom_dyn.array_types import Array

_KEPT = 8
"""How many shapes stay stated: one takes some megabytes, and a run asks for two or three."""


@dataclass(frozen=True)
class Shape:
    """What a stated program depends on.

    Attributes:
        unknowns: Number of coordinates.
        bodies: The first coordinate that has to do with each body, of which each has a matrix that is not negative.
        inequalities: Number of linear inequalities.
    """

    unknowns: int
    bodies: tuple[int, ...]
    inequalities: int


@dataclass(frozen=True)
class Values:
    """Numbers of a program in its coordinates ``u``.

    Attributes:
        rows: Of the inequalities ``rows @ u >= least``.
        least: Their least values.
        slopes: Of each body's matrix, row by row ``(bodies, 16, unknowns)``.
        constants: That matrix at ``u = 0``, ``(bodies, 4, 4)``.
        margins: What it has to exceed, ``(bodies, 4, 4)``.
    """

    rows: Array
    least: Array
    slopes: Array
    constants: Array
    margins: Array


@dataclass(frozen=True)
class Stated:
    """A program whose numbers are given at each solution; one solution at a time.

    Attributes:
        shape: Of its arrays.
        problem: The problem of cvxpy.
        unknowns: Its variable.
        limits: Its linear inequalities, or None.
        bodies: Its matrices that are not negative.
        parameters: In the order of `_numbers`.
    """

    shape: Shape
    problem: Any
    unknowns: Any
    limits: Any
    bodies: list[Any]
    parameters: list[Any]
    _alone: threading.Lock = field(default_factory=threading.Lock)

    def solved(self, values: Values, tolerance: float) -> tuple[Array, Array, list[Array], str]:
        """Coordinates at the minimum, what each inequality and each body pushes with, and Clarabel's status."""
        import cvxpy as cp

        size = self.unknowns.size
        with self._alone, warnings.catch_warnings():
            # That a solution may be inaccurate is said by its status, which is looked at.
            warnings.simplefilter("ignore", UserWarning)
            for parameter, value in zip(self.parameters, _numbers(self.shape, values), strict=True):
                parameter.value = value
            try:
                self.problem.solve(
                    solver=cp.CLARABEL,
                    warm_start=False,
                    tol_gap_abs=tolerance,
                    tol_gap_rel=tolerance,
                    tol_feas=tolerance,
                )
            except cp.SolverError as error:
                return np.zeros(size), np.zeros(0), [], str(error)
            if self.unknowns.value is None:
                return np.zeros(size), np.zeros(0), [], str(self.problem.status)
            forces = np.zeros(0) if self.limits is None else np.array(self.limits.dual_value)
            pushes = [np.array(body.dual_value) for body in self.bodies]
            return np.array(self.unknowns.value), forces, pushes, str(self.problem.status)


def _numbers(shape: Shape, values: Values) -> list[Array]:
    """Those that a program of this shape has, in the order in which `stated` asks for them."""
    out = [values.rows, values.least] if shape.inequalities else []
    for at, first in enumerate(shape.bodies):
        out += [values.slopes[at][:, first:], values.constants[at], values.margins[at]]
    return out


@lru_cache(maxsize=_KEPT)
def stated(shape: Shape) -> Stated:
    """The program of a shape; the same one for the same shape, as its numbers come with each solution.

    cvxpy takes most of a second to load, and is loaded here.
    """
    import cvxpy as cp

    u = cp.Variable(shape.unknowns)
    parameters: list[Any] = []

    def asked(*size: int) -> Any:
        parameters.append(cp.Parameter(size))
        return parameters[-1]

    limits = asked(shape.inequalities, shape.unknowns) @ u >= asked(shape.inequalities) if shape.inequalities else None
    bodies = []
    for first in shape.bodies:
        matrix = cp.reshape(asked(16, shape.unknowns - first) @ u[first:], (4, 4), order="C") + asked(4, 4)
        bodies.append(matrix >> asked(4, 4))
    problem = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(u)), [*([] if limits is None else [limits]), *bodies])
    return Stated(shape, problem, u, limits, bodies, parameters)
