"""Baseline: every parameter of the MuJoCo model by itself, as one turns knobs by hand; the one that helps most."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .regression import DEVIATIONS, Candidate, Task, answer_of, finding, read_task, solved

KNOBS = ("coulomb_friction", "viscous_friction", "rotor_inertia", "inertial_parameters", "payload", "input_delay")
LEAST = 0.05  # of the residual's square that a knob has to take off


def knobs(task: Task) -> list[Candidate]:
    """What a MuJoCo model has a number for."""
    return [one for one in task.candidates if one.effect in KNOBS]


def one_at_a_time(robot_file: Path, log_file: Path) -> dict:
    """The answer to a case."""
    task = read_task(robot_file, log_file)
    before = float(np.mean(task.residual**2))
    best, share = [], LEAST
    for candidate in knobs(task):
        sizes, std, square = solved(candidate.columns, task.residual)
        closed = 1.0 - square / before
        if closed > share and abs(sizes[0]) > DEVIATIONS * std[0]:
            best, share = [finding(candidate, sizes, std, gap_closed=closed)], closed
    return answer_of(best)
