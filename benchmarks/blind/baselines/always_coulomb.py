"""Baseline that always answers Coulomb friction, on the joint where it reduces the residual most."""

from __future__ import annotations

import numpy as np

from benchmarks.blind.baselines.least_squares import Task, fit, joints_of, squares

EFFECT = "coulomb_friction"


def always_coulomb(task: Task) -> dict:
    """The answer in the form of ``diagnosis.json``."""
    nothing = np.zeros(len(task.prior))
    before = np.array([squares(row, nothing) for row in task.rows])
    bare = Task(task.robot, task.rows, task.choices, 0, task.prior)
    best: tuple[float, str | None, np.ndarray] = (-np.inf, None, nothing)
    for choice in task.choices:
        if choice.effect != EFFECT:
            continue
        theta = fit(bare, choice.columns, np.ones(len(task.rows)))
        after = np.array([squares(row, theta) for row in task.rows])
        share = float(np.max((before - after) / before))
        if share > best[0]:
            best = (share, choice.joint, theta)
    share, joint, theta = best
    finding = {
        "effect": EFFECT,
        "joint": joint,
        "parameters": {},
        "gap_closed": share,
        "probability": 1.0,
        "rivals": [],
    }
    findings = [finding] if joint is not None else []
    return {"verdict": "explained" if findings else "no_gap", "findings": findings, "joints": joints_of(task, theta)}
