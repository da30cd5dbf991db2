"""Prepares a case for the least-squares baselines: the library's columns and their products."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from identification.data.reading import read_recording
from identification.data.signals import process_all
from identification.diagnosis.columns.residual_columns import Columns, build_columns
from identification.diagnosis.columns.session import session_of_logs
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot


@dataclass(frozen=True)
class Row:
    """Products of the columns that act on one joint's torque; every sample counts as independent.

    Attributes:
        index: Indices of the columns, ``(k,)``.
        a, b, c: Products of columns with columns, columns with the residual, residual with itself.
        count: Number of samples.
    """

    index: np.ndarray
    a: np.ndarray
    b: np.ndarray
    c: float
    count: int


@dataclass(frozen=True)
class Choice:
    """An effect at a joint in one of its shapes: indices of its columns, and number of its parameters."""

    effect: str
    joint: str | None
    columns: tuple[int, ...]
    size: int


@dataclass(frozen=True)
class Task:
    """One recording prepared for least squares.

    Attributes:
        robot: The given model.
        rows: Products of each joint.
        choices: All effects with joints and shapes.
        nuisances: Number of leading columns that every fit contains.
        prior: Prior precision of every column; zero except for the tolerances.
    """

    robot: Robot
    rows: tuple[Row, ...]
    choices: tuple[Choice, ...]
    nuisances: int
    prior: np.ndarray


def _rows(columns: Columns, residual: tuple[np.ndarray, ...]) -> tuple[Row, ...]:
    out = []
    for j, index in enumerate(columns.rows):
        values = np.vstack([v[j][use[:, j]] for v, use in zip(columns.values, columns.usable, strict=True)])
        rest = np.concatenate([r[:, j][use[:, j]] for r, use in zip(residual, columns.usable, strict=True)])
        out.append(Row(np.array(index), values.T @ values, values.T @ rest, float(rest @ rest), len(rest)))
    return tuple(out)


def prepare(robot_file: Path, log_file: Path) -> Task:
    """Read a case and compute the columns of the whole catalogue."""
    robot = load_robot(robot_file)
    logs, cutoff_hz = process_all((read_recording(log_file, robot),), robot)
    session = session_of_logs(robot, logs, cutoff_hz)
    columns = build_columns(session)
    known = {effect.name for effect in EFFECTS}
    choices = tuple(
        Choice(*term.effect_joint, tuple(term.columns), term.size)
        for term in columns.terms
        if term.effect.name in known
    )
    prior = np.zeros(len(columns.names))
    for k, nuisance in enumerate(columns.tolerance_parameters):
        prior[k] = 1.0 / nuisance.sigma**2
    rows = _rows(columns, session.in_judged_band(columns.residual))
    return Task(robot, rows, choices, len(columns.tolerance_parameters), prior)


def squares(row: Row, theta: np.ndarray) -> float:
    """Sum of squared residuals of a row."""
    x = theta[row.index]
    return max(float(row.c - 2.0 * row.b @ x + x @ row.a @ x), 1e-12 * row.c, 1e-300)


def fit(task: Task, columns: tuple[int, ...], sigma: np.ndarray) -> np.ndarray:
    """Coefficients of nuisances and columns for given standard deviations of the rows; all others are zero."""
    active = np.array(sorted({*range(task.nuisances), *columns}), dtype=int)
    place = np.full(len(task.prior), -1)
    place[active] = np.arange(len(active))
    a, b = np.diag(task.prior[active]), np.zeros(len(active))
    for row, s in zip(task.rows, sigma, strict=True):
        mine = np.flatnonzero(place[row.index] >= 0)
        at = place[row.index[mine]]
        a[np.ix_(at, at)] += row.a[np.ix_(mine, mine)] / s**2
        b[at] += row.b[mine] / s**2
    scale = np.sqrt(np.maximum(np.diag(a), 1e-300))
    theta = np.zeros(len(task.prior))
    # With the small diagonal, equal columns get equal coefficients, and columns of zeros get zero.
    normal = a / np.outer(scale, scale) + 1e-10 * np.eye(len(active))
    theta[active] = np.linalg.solve(normal, b / scale) / scale
    return theta


def residual_rms(task: Task, theta: np.ndarray) -> np.ndarray:
    """Root mean square of the residual of each row."""
    return np.sqrt([squares(row, theta) / row.count for row in task.rows])


def joints_of(task: Task, theta: np.ndarray) -> list[dict]:
    """The gap before and after as in ``diagnosis.json``; the scorer adds the true noise floors."""
    before, after = residual_rms(task, np.zeros(len(task.prior))), residual_rms(task, theta)
    return [
        {"joint": name, "rms_before": float(b), "rms_after": float(x), "noise_floor": float(x)}
        for name, b, x in zip(task.robot.joint_names, before, after, strict=True)
    ]
