"""Baseline: Coulomb and viscous friction and an offset of every joint by regression, at the lag that fits best.

The lag of the torque is searched over a grid. Where it takes more off than any friction it is the answer, else the
friction or the offset with the largest torque.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .regression import DEVIATIONS, answer_of, finding, read_task, root_mean_square, solved

LAGS = np.arange(-4, 41) * 1e-3  # [s]
FREE = ("coulomb_friction", "viscous_friction", "torque_offset")


def _late(model: np.ndarray, dt: float, lag: float) -> np.ndarray:
    """Command of a drive that acts so much later: the torque of the model, so much earlier."""
    times = dt * np.arange(len(model))
    return np.column_stack([np.interp(times + lag, times, column) for column in model.T])


def free_lag(robot_file: Path, log_file: Path) -> dict:
    """The answer to a case."""
    task = read_task(robot_file, log_file)
    free = [one for one in task.candidates if one.effect in FREE]
    columns = np.column_stack([one.columns for one in free])

    def residual(lag: float) -> np.ndarray:
        return task.rows(task.torque - _late(task.model, task.windows.dt, lag))

    left = [solved(columns, residual(lag))[2] for lag in LAGS]
    lag = float(LAGS[int(np.argmin(left))])
    rest = residual(lag)
    sizes, std, _ = solved(columns, rest)
    torque = [
        root_mean_square(columns[:, k] * sizes[k]) if abs(sizes[k]) > DEVIATIONS * std[k] > 0.0 else 0.0
        for k in range(len(free))
    ]
    if lag and root_mean_square(task.residual - rest) > max(torque):
        step = float(LAGS[1] - LAGS[0])
        size = {"delay": {"value": lag, "std": step / np.sqrt(12.0)}}
        return answer_of([{"effect": "input_delay", "joint": None, "parameters": size}])
    k = int(np.argmax(torque))
    return answer_of([finding(free[k], sizes[k : k + 1], std[k : k + 1])] if torque[k] else [])
