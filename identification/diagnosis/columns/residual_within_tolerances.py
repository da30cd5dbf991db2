"""Residual of a recording after a fit of the tolerance parameters of the model alone."""

from __future__ import annotations

import numpy as np

from identification.diagnosis.columns.tolerance_parameters import parameters_by_joint, tolerance_parameters
from identification.engine.numerics.bounded import solve
from phantom_dyn.array_types import Array, Bool, Float
from phantom_dyn.model.robot import Robot


def residual_within_tolerances(
    robot: Robot,
    columns: tuple[list[list[Float[Array, " n"]]], ...],
    residual: tuple[Float[Array, "n nv"], ...],
    usable: tuple[Bool[Array, "n nv"], ...],
) -> tuple[Float[Array, "n nv"], ...]:
    """Residual of a weighted least squares fit of the tolerance parameters, with the tolerances as prior.

    The noise of each joint is assumed to be a tenth of its residual, which is about right if the model is wrong.

    Args:
        robot: The given model.
        columns: For each log and joint, the columns of the parameters that may change its torque, then any others.
        residual: Measured minus modelled torque of each log.
        usable: Samples that may be used.
    """
    parameters = tolerance_parameters(robot)
    rows = range(residual[0].shape[1])
    acting = [list(indices) for indices in parameters_by_joint(robot, parameters)]
    a = np.diag([1.0 / parameter.sigma**2 for parameter in parameters])
    b = np.zeros(len(parameters))
    for j in rows:
        x = np.concatenate(
            [np.column_stack(log[j][: len(acting[j])])[u[:, j]] for log, u in zip(columns, usable, strict=True)]
        )
        y = np.concatenate([r[:, j][u[:, j]] for r, u in zip(residual, usable, strict=True)])
        weight = 100.0 / max(float(y @ y) / max(len(y), 1), 1e-30)
        a[np.ix_(acting[j], acting[j])] += weight * x.T @ x
        b[acting[j]] += weight * x.T @ y
    change = solve(a, b)
    return tuple(
        np.column_stack([r[:, j] - np.column_stack(log[j][: len(acting[j])]) @ change[acting[j]] for j in rows])
        for log, r in zip(columns, residual, strict=True)
    )
