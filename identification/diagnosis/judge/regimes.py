"""Regimes of motion in which the residual of a joint is larger than at other times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.data.log import Log
from identification.diagnosis.columns.motion.standstill import near_reversals
from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.session import Series
from identification.diagnosis.fit.problem import Problem
from phantom_dyn.array_types import Array, Bool


def regimes(log: Log, columns: Columns, index: int, row: int) -> dict[str, Bool[Array, " n"]]:
    """In-band samples of one joint in each regime, as far as the motion alone defines it."""
    at = log.samples
    v, a = log.motion.v[:, row], log.motion.a[at, row]
    load = np.abs(columns.model_torque[index][:, row])
    speed = np.abs(v[at])
    near = near_reversals(log)[:, row]
    top, most, hardest = (np.percentile(x, 95) + 1e-300 for x in (speed, load, np.abs(a)))
    elapsed = (log.motion.t[at] - log.motion.t[0]) / max(log.motion.t[-1] - log.motion.t[0], 1e-12)
    return {
        "velocity_reversal": near,
        "low_speed": (speed < 0.25 * top) & ~near,
        "high_speed": speed > 0.6 * top,
        "high_load": load > 0.6 * most,
        "high_acceleration": np.abs(a) > 0.6 * hardest,
        "one_direction": v[at] > 0,
        "time_drift": elapsed > 0.5,
    }


@dataclass(frozen=True)
class RegimeSplit:
    """Distribution of one joint's residual energy over regimes.

    Attributes:
        shares: Shares of the energy, by regime.
        times: Shares of the samples, by regime.
        best: The regime that holds most beyond its share of time, or ``everywhere``.
    """

    shares: dict[str, float]
    times: dict[str, float]
    best: str


def regime_shares(problem: Problem, residual: Series, row: int) -> tuple[dict[str, float], str]:
    """Shares of one joint's residual energy, and the regime with most; see `regime_split`."""
    split = regime_split(problem, residual, row)
    return split.shares, split.best


def regime_split(problem: Problem, residual: Series, row: int) -> RegimeSplit:
    """Share of one joint's residual energy in each regime, and the regime that holds most beyond its share of time.

    Of the two directions, and of the two halves of the record, only the one with more energy is listed. A regime is
    named if its share of the energy is at least 1.5 times its share of the samples; else the gap is ``everywhere``.
    """
    columns = problem.columns
    energy, samples, total, count = {}, {}, 0.0, 0
    for k, log in enumerate(problem.session.logs):
        use = columns.usable[k][:, row]
        square = residual[k][:, row] ** 2 * use
        total += float(square.sum())
        count += int(use.sum())
        for name, mask in regimes(log, columns, k, row).items():
            energy[name] = energy.get(name, 0.0) + float(square[mask].sum())
            samples[name] = samples.get(name, 0) + int((use & mask).sum())
    if total == 0:
        return RegimeSplit(dict.fromkeys(energy, 0.0), dict.fromkeys(energy, 0.0), "everywhere")
    shares = {name: value / total for name, value in energy.items()}
    times = {name: value / count for name, value in samples.items()}
    for name in ("one_direction", "time_drift"):
        if shares[name] < times[name]:
            shares[name], times[name] = 1 - shares[name], 1 - times[name]
    lift = {name: shares[name] / times[name] if times[name] > 0.02 else 0.0 for name in shares}
    best = max(lift, key=lambda name: lift[name])
    return RegimeSplit(shares, times, best if lift[best] >= 1.5 else "everywhere")
