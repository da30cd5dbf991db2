"""Regimes of motion, such as low speed, and the share of a joint's residual in each of them."""

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
    """Masks of the in-band samples of one joint that belong to each regime.

    Args:
        log: The recording.
        columns: Columns of the problem, with the modelled torque.
        index: Index of the recording in the columns.
        row: Index of the joint.
    """
    at = log.samples
    v, a = log.motion.v[:, row], log.motion.a[at, row]
    load = np.abs(columns.model_torque[index][:, row])
    speed = np.abs(v[at])
    reversal = near_reversals(log)[:, row]
    top_speed, top_load, top_acceleration = (np.percentile(x, 95) + 1e-300 for x in (speed, load, np.abs(a)))
    elapsed = (log.motion.t[at] - log.motion.t[0]) / max(log.motion.t[-1] - log.motion.t[0], 1e-12)
    return {
        "velocity_reversal": reversal,
        "low_speed": (speed < 0.25 * top_speed) & ~reversal,
        "high_speed": speed > 0.6 * top_speed,
        # On a joint without a drive the modelled torque is the residual, so that a high load says nothing.
        "high_load": (load > 0.6 * top_load) & columns.operations[0].robot.actuators[row].actuated,
        "high_acceleration": np.abs(a) > 0.6 * top_acceleration,
        "one_direction": v[at] > 0,
        "time_drift": elapsed > 0.5,
    }


@dataclass(frozen=True)
class RegimeSplit:
    """Distribution of one joint's squared residual over regimes.

    Attributes:
        shares: Share of the squared residual in each regime.
        times: Share of the samples in each regime.
        best: Regime with the largest ratio of share to time, or ``everywhere`` if no ratio is at least 1.5.
    """

    shares: dict[str, float]
    times: dict[str, float]
    best: str


def regime_split(problem: Problem, residual: Series, row: int) -> RegimeSplit:
    """Distribution of one joint's squared residual over regimes.

    ``one_direction`` and ``time_drift`` are the direction, and the half of each recording, of the larger mean square.
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
    # A regime with very few samples has no reliable ratio.
    ratios = {name: shares[name] / times[name] if times[name] > 0.02 else 0.0 for name in shares}
    best = max(ratios, key=lambda name: ratios[name])
    return RegimeSplit(shares, times, best if ratios[best] >= 1.5 else "everywhere")
