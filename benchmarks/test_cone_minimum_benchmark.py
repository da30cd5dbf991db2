# pyright: reportAttributeAccessIssue=false
"""Time the best physically possible body for a quadratic loss, with the compiled interior-point method and Clarabel.

    pytest benchmarks/test_cone_minimum_benchmark.py --benchmark-enable -n 0

cvxpy states the program once; of Clarabel only its solver is timed, on the arrays from cvxpy.
"""

from __future__ import annotations

import clarabel
import cvxpy as cp
import numpy as np
import pytest
from cvxpy.reductions.solvers.conic_solvers.clarabel_conif import dims_to_solver_cones

from identification.diagnosis.fit.cone_minimum import best_bodies
from identification.estimators.consistent.consistent_bodies import PSEUDO
from phantom_dyn.array_types import Array

ROUNDS = 1000
# A box about the origin that contains a ball of unit mass, whose centre is not the middle of the box.
GIVEN = np.array([1.0, 0.1, -0.05, 0.2, 0.5, 0.0, 0.6, 0.0, 0.0, 0.4])
REACH = np.array([[1.0, *(sign * (np.arange(3) == axis))] + [0.0] * 6 for axis in range(3) for sign in (1.0, -1.0)])


@pytest.fixture
def loss() -> tuple[Array, Array]:
    """Quadratic and linear part of a loss whose minimum is not a possible body."""
    rng = np.random.default_rng(0)
    rows = rng.standard_normal((30, 10)) * 10.0 ** rng.uniform(-3, 3, 10)
    a = rows.T @ rows
    return a, a @ (3.0 * rng.standard_normal(10))


def test_one_body_by_the_compiled_method(benchmark, loss):
    a, b = loss
    found = benchmark.pedantic(best_bodies, (a, b, GIVEN[None], REACH[None]), rounds=ROUNDS, warmup_rounds=10)
    assert (REACH @ (GIVEN + found)).min() > 0.0


def test_one_body_by_clarabel(benchmark, loss):
    a, b = loss
    x, root = cp.Variable(10), np.linalg.cholesky(a)
    limits = [sum((GIVEN + x)[k] * PSEUDO[k] for k in range(10)) >> 0, REACH @ (GIVEN + x) >= 0]
    program = cp.Problem(cp.Minimize(cp.sum_squares(root.T @ x - np.linalg.solve(root, b))), limits)
    data, _, _ = program.get_problem_data(cp.CLARABEL)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    parts = data["P"], data["c"], data["A"], data["b"], dims_to_solver_cones(data["dims"])
    found = benchmark.pedantic(
        lambda: clarabel.DefaultSolver(*parts, settings).solve(), rounds=ROUNDS, warmup_rounds=10
    )
    assert str(found.status) == "Solved"
