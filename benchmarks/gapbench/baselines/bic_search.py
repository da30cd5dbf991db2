"""Baseline: forward selection by the Bayesian information criterion over a small catalogue of columns.

What the stated tolerance lets move is fitted beside, with its prior. The rivals of a finding are the causes that could
stand in its place, with the weights ``exp(-BIC / 2)``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from .regression import Candidate, Task, answer_of, finding, read_task, solved

MOST = 4  # causes
LISTED = 0.05  # probability from which a rival is listed


class _Score:
    """BIC of sets of causes; columns are freed once of what the tolerance explains at the noise that is left."""

    def __init__(self, task: Task) -> None:
        self.task = task
        m = task.nuisances.shape[1]
        noise = np.sqrt(solved(np.column_stack([task.nuisances, *self._all()]), task.residual)[2])
        self.count, self.prior = len(task.residual), noise * np.eye(m)
        self.nuisances = np.vstack([task.nuisances, self.prior])
        self.base, _ = np.linalg.qr(self.nuisances)
        self.residual = self._freed(np.append(task.residual, np.zeros(m)))
        self.freed = {
            id(one): self._freed(np.vstack([one.columns, np.zeros((m, one.columns.shape[1]))]))
            for one in task.candidates
        }

    def _all(self) -> list[np.ndarray]:
        return [one.columns for one in self.task.candidates]

    def _freed(self, x: np.ndarray) -> np.ndarray:
        return x - self.base @ (self.base.T @ x)

    def fit(self, chosen: tuple[Candidate, ...]) -> tuple[float, np.ndarray, np.ndarray]:
        """BIC, sizes and their standard deviations."""
        if not chosen:
            return self.count * float(np.log(self.residual @ self.residual)), np.zeros(0), np.zeros(0)
        columns = np.column_stack([self.freed[id(one)] for one in chosen])
        sizes, std, _ = solved(columns, self.residual)
        left = self.residual - columns @ sizes
        return (
            self.count * float(np.log(left @ left)) + columns.shape[1] * float(np.log(self.count)),
            sizes,
            std,
        )


def _joins(chosen: tuple[Candidate, ...], other: Candidate) -> bool:
    return all((one.effect, one.joint) != (other.effect, other.joint) for one in chosen)


def _finding(score: _Score, chosen: tuple[Candidate, ...], k: int) -> dict:
    rest = chosen[:k] + chosen[k + 1 :]
    others = [one for one in score.task.candidates if _joins(rest, one)]
    values = np.array([score.fit((*rest, one))[0] for one in others])
    weights = np.exp(-0.5 * (values - values.min()))
    weights /= weights.sum()
    own = next(i for i, one in enumerate(others) if one is chosen[k])
    rivals = [
        {"effects": [{"effect": one.effect, "joint": one.joint}], "probability": float(p)}
        for one, p in sorted(zip(others, weights, strict=True), key=lambda pair: -pair[1])
        if one is not chosen[k] and p >= LISTED
    ]
    _, sizes, std = score.fit((*rest, chosen[k]))
    width = chosen[k].columns.shape[1]
    return finding(chosen[k], sizes[-width:], std[-width:], probability=float(weights[own]), rivals=rivals)


def bic_search(robot_file: Path, log_file: Path) -> dict:
    """The answer to a case; the cause that was chosen first leads."""
    score = _Score(read_task(robot_file, log_file))
    chosen: tuple[Candidate, ...] = ()
    value = score.fit(chosen)[0]
    while len(chosen) < MOST:
        more = [(*chosen, one) for one in score.task.candidates if _joins(chosen, one)]
        values = [score.fit(one)[0] for one in more]
        if min(values) >= value:
            break
        value, chosen = min(values), more[int(np.argmin(values))]
    return answer_of([_finding(score, chosen, k) for k in range(len(chosen))])
