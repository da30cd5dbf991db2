"""Baseline: least squares over the same catalogue with independent samples, and model selection by BIC.

Effects are selected forwards, with removal. The score is ``sum_j n_j log(RSS_j / n_j) + k log n`` plus the prior's
penalty on changes within the tolerances. The rivals of a finding are the effects that could replace it, with the usual
weights ``exp(-BIC / 2)``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.blind.baselines.least_squares import Choice, Task, fit, joints_of, residual_rms, squares

MOST = 6  # largest number of effects; with coloured residuals BIC would select many more
LISTED = 0.05

Chosen = tuple[Choice, ...]


def _columns(chosen: Chosen) -> tuple[int, ...]:
    return tuple(column for choice in chosen for column in choice.columns)


def bic(task: Task, chosen: Chosen, sigma: np.ndarray) -> float:
    """Bayesian information criterion of a set of effects; lower is better."""
    theta = fit(task, _columns(chosen), sigma)
    count = sum(row.count for row in task.rows)
    cost = sum(row.count * np.log(squares(row, theta) / row.count) for row in task.rows)
    penalty = theta[: task.nuisances] ** 2 @ task.prior[: task.nuisances]
    return float(cost + penalty + sum(choice.size for choice in chosen) * np.log(count))


def _can_join(chosen: Chosen, choice: Choice) -> bool:
    """True if no chosen effect has the same name and joint."""
    return all((c.effect, c.joint) != (choice.effect, choice.joint) for c in chosen)


def _best_addition(task: Task, chosen: Chosen, sigma: np.ndarray) -> tuple[float, Chosen]:
    """Score and effects of the best set with one more effect."""
    more = ((*chosen, choice) for choice in task.choices if _can_join(chosen, choice))
    return min(((bic(task, one, sigma), one) for one in more), key=lambda pair: pair[0], default=(np.inf, chosen))


def select(task: Task) -> tuple[Chosen, np.ndarray]:
    """The selected effects, and the standard deviation of each row's residual."""
    chosen: Chosen = ()
    sigma = residual_rms(task, fit(task, (), np.sqrt([row.c / row.count for row in task.rows])))
    while len(chosen) < MOST:
        score, more = _best_addition(task, chosen, sigma)
        if score >= bic(task, chosen, sigma):
            break
        chosen = more
        sigma = residual_rms(task, fit(task, _columns(chosen), sigma))
        while len(chosen) > 1:
            fewer = [chosen[:i] + chosen[i + 1 :] for i in range(len(chosen))]
            without = fewer[int(np.argmin([bic(task, one, sigma) for one in fewer]))]
            if bic(task, without, sigma) > bic(task, chosen, sigma):
                break
            chosen = without
    return chosen, sigma


def _finding(task: Task, chosen: Chosen, choice: Choice, sigma: np.ndarray, loss: tuple[float, float]) -> dict:
    """A selected effect in the form of ``diagnosis.json``; ``loss`` is that without and with all effects."""
    rest = tuple(c for c in chosen if c is not choice)
    scores: dict[tuple[str, str | None], float] = {}
    for other in task.choices:
        if _can_join(rest, other):
            place = (other.effect, other.joint)
            scores[place] = min(bic(task, (*rest, other), sigma), scores.get(place, np.inf))
    best = min(scores.values())
    weights = {place: np.exp(-0.5 * (score - best)) for place, score in scores.items()}
    total = sum(weights.values())
    shares = {place: float(w / total) for place, w in weights.items()}
    own = (choice.effect, choice.joint)
    rivals = [
        {"effects": [{"effect": e, "joint": j}], "probability": p}
        for (e, j), p in sorted(shares.items(), key=lambda item: -item[1])
        if (e, j) != own and p >= LISTED
    ]
    before, after = loss
    without = _loss(task, fit(task, _columns(rest), sigma), sigma)
    return {
        "effect": choice.effect,
        "joint": choice.joint,
        "parameters": {},
        "gap_closed": (without - after) / max(before - after, 1e-12),
        "probability": shares[own],
        "rivals": rivals,
    }


def _loss(task: Task, theta: np.ndarray, sigma: np.ndarray) -> float:
    """Mean square of the residuals, each row relative to its standard deviation."""
    return float(np.mean((residual_rms(task, theta) / sigma) ** 2))


def independent_bic(task: Task) -> dict:
    """The answer in the form of ``diagnosis.json``."""
    # Columns of zeros are removed, because they cannot be chosen and make the normal equations ill-conditioned.
    seen = {int(k) for row in task.rows for k, d in zip(row.index, np.diag(row.a), strict=True) if d > 0}
    task = replace(task, choices=tuple(c for c in task.choices if set(c.columns) & seen))
    chosen, sigma = select(task)
    theta = fit(task, _columns(chosen), sigma)
    loss = (_loss(task, np.zeros_like(theta), sigma), _loss(task, theta, sigma))
    findings = [_finding(task, chosen, choice, sigma, loss) for choice in chosen]
    return {"verdict": "explained" if findings else "no_gap", "findings": findings, "joints": joints_of(task, theta)}
