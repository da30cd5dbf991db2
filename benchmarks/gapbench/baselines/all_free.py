"""Baseline: all parameters of the MuJoCo model free at once, in one least squares on its inverse dynamics.

Its answer is the parameter more than three of its own standard deviations off with the largest torque.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .one_at_a_time import knobs
from .regression import DEVIATIONS, answer_of, finding, read_task, root_mean_square, solved


def all_free(robot_file: Path, log_file: Path) -> dict:
    """The answer to a case."""
    task = read_task(robot_file, log_file)
    free = knobs(task)
    columns = np.column_stack([one.columns for one in free])
    sizes, std, _ = solved(columns, task.residual)
    off = [
        (root_mean_square(columns[:, k] * sizes[k]), k)
        for k in range(len(free))
        if abs(sizes[k]) > DEVIATIONS * std[k] > 0.0
    ]
    if not off:
        return answer_of([])
    _, k = max(off)
    return answer_of([finding(free[k], sizes[k : k + 1], std[k : k + 1])])
