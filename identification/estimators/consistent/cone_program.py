# pyright: reportAttributeAccessIssue=false
"""The cvxpy program for physically consistent parameters, built once per shape of its arrays and solved repeatedly.

Translating a program to a cone program takes longer than solving it, but depends only on the shapes of the arrays.
Therefore the numbers are parameters of the program (disciplined parametrised programming, [Agrawal]_).

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

_MOST_PROGRAMS = 8
"""Number of programs that are kept: each needs some megabytes, and a run needs two or three."""


@dataclass(frozen=True)
class Shape:
    """Sizes that determine a program.

    Attributes:
        unknowns: Number of coordinates.
        bodies: For each body, the first coordinate on which its matrix depends.
        inequalities: Number of linear inequalities.
    """

    unknowns: int
    bodies: tuple[int, ...]
    inequalities: int


@dataclass(frozen=True)
class ConeProgram:
    """A cvxpy program whose numbers are set before each solution; a lock allows one solution at a time.

    Attributes:
        problem: The cvxpy problem.
        unknowns: The cvxpy variable.
        limits: The linear inequalities, or None.
        bodies: The matrix inequality of each body.
        parameters: The cvxpy parameters, in the order of the numbers of `solved`.
    """

    problem: Any
    unknowns: Any
    limits: Any
    bodies: list[Any]
    parameters: list[Any]
    _alone: threading.Lock = field(default_factory=threading.Lock)

    def solved(self, numbers: list[Array], tolerance: float) -> tuple[Array, Array, list[Array], str]:
        """Solve the program for some numbers.

        Args:
            numbers: If there are inequalities ``rows @ u >= least``, ``rows`` and ``least``. Then for each body the
                derivatives of its matrix, row by row, by the coordinates from its first one on, ``(16, k)``, its matrix
                at ``u = 0``, ``(4, 4)``, and the lower bound of the matrix in the order of semidefinite matrices.
            tolerance: Clarabel's tolerance of the solution.

        Returns:
            Coordinates at the minimum, dual values of the linear inequalities, dual values of the matrix inequalities,
            and the status of Clarabel.
        """
        import cvxpy as cp

        size = self.unknowns.size
        with self._alone, warnings.catch_warnings():
            # The warning on inaccurate solutions is not needed, as callers check the status.
            warnings.simplefilter("ignore", UserWarning)
            for parameter, value in zip(self.parameters, numbers, strict=True):
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
            bound_multipliers = np.zeros(0) if self.limits is None else np.array(self.limits.dual_value)
            body_multipliers = [np.array(body.dual_value) for body in self.bodies]
            return np.array(self.unknowns.value), bound_multipliers, body_multipliers, str(self.problem.status)


@lru_cache(maxsize=_MOST_PROGRAMS)
def cone_program(shape: Shape) -> ConeProgram:
    """The program of a shape, which is built once.

    cvxpy is imported here because it takes most of a second to load.
    """
    import cvxpy as cp

    u = cp.Variable(shape.unknowns)
    parameters: list[Any] = []

    def parameter(*size: int) -> Any:
        parameters.append(cp.Parameter(size))
        return parameters[-1]

    limits = None
    if shape.inequalities:
        limits = parameter(shape.inequalities, shape.unknowns) @ u >= parameter(shape.inequalities)
    bodies = []
    for first in shape.bodies:
        matrix = cp.reshape(parameter(16, shape.unknowns - first) @ u[first:], (4, 4), order="C") + parameter(4, 4)
        bodies.append(matrix >> parameter(4, 4))
    problem = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(u)), [*([] if limits is None else [limits]), *bodies])
    return ConeProgram(problem, u, limits, bodies, parameters)
