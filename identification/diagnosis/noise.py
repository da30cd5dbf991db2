"""Noise of each joint's residual, from the data themselves."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from identification.diagnosis.blocks import Block, Weights
from identification.diagnosis.columns import Columns, Term
from identification.diagnosis.flexible import held_out_ridge, state_features
from identification.diagnosis.gap import held_out_torque, residual_after
from identification.diagnosis.search import Search
from identification.log import Log

Array = np.ndarray


def autocorrelation_time(e: Float[Array, " n"]) -> float:
    """Samples of ``e`` that tell as much as one independent sample: ``1 + 2 sum of autocorrelations``.

    The sum stops where the autocorrelation of a pair of lags first turns negative (Geyer's initial positive
    sequence), which keeps it from adding noise.
    """
    n = len(e)
    if n < 8 or not np.any(e):
        return 1.0
    centred = e - e.mean()
    spectrum = np.abs(np.fft.rfft(centred, 2 * n)) ** 2
    r = np.fft.irfft(spectrum)[: n // 2]
    r = r / r[0]
    pairs = r[: len(r) // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    stop = int(negative[0]) if len(negative) else len(pairs)
    return float(max(1.0, 2 * pairs[:stop].sum() - 1.0))


def estimate_noise(
    columns: Columns, logs: tuple[Log, ...], blocks: tuple[Block, ...], folds: Int[Array, " B"]
) -> tuple[Weights, tuple[Float[Array, "n nv"], ...]]:
    """Noise floor and colour of each row, and the residual that no model here predicts.

    Each row's residual is predicted from all columns at once, and from all columns and the flexible features; the
    better of the two leaves the noise. Both are judged on blocks that they have not seen.

    Returns:
        The weights, and for each log the unpredicted residual ``(n, nv)``.
    """
    rows = len(columns.rows)
    floor, spread = np.zeros(rows), np.ones(rows)
    left = [np.zeros_like(r) for r in columns.residual]
    for j in range(rows):
        y = [r[:, j] for r in columns.residual]
        use = [u[:, j] for u in columns.usable]
        plain = [values[j] for values in columns.values]
        rich = [
            np.column_stack([x, state_features(columns, log, k, j)])
            for k, (x, log) in enumerate(zip(plain, logs, strict=True))
        ]
        tried = [held_out_ridge(x, y, use, blocks, folds) for x in (plain, rich)]
        predicted, mean_square = min(tried, key=lambda result: result[1])
        # A residual of exactly zero (a simulated robot without noise) would make every weight infinite.
        drive = max(float(np.std(np.concatenate([t[:, j] for t in columns.model_torque]))), 1e-12)
        floor[j] = max(np.sqrt(mean_square), 1e-6 * drive)
        for k, p in enumerate(predicted):
            left[k][:, j] = np.where(use[k], y[k] - p, 0.0)
        spread[j] = np.mean([autocorrelation_time(e[:, j][u]) for e, u in zip(left, use, strict=True)])
    return Weights(floor, spread), tuple(left)


def refined_noise(
    search: Search, chosen: frozenset[Term], weights: Weights, noise: tuple[Float[Array, "n nv"], ...]
) -> tuple[Weights, tuple[Float[Array, "n nv"], ...]]:
    """Noise of the rows on which the chosen effects leave less, on held-out blocks, than the free fits did."""
    problem = search.problem
    rest = residual_after(problem, held_out_torque(problem, chosen, search.evaluate(chosen)))
    floor, spread = weights.floor.copy(), weights.spread.copy()
    left = [part.copy() for part in noise]
    for j in range(len(floor)):
        use = [u[:, j] for u in problem.columns.usable]
        parts = [r[:, j][u] for r, u in zip(rest, use, strict=True)]
        rms = float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))
        if 0 < rms < floor[j]:
            floor[j] = rms
            spread[j] = np.mean([autocorrelation_time(e) for e in parts])
            for k, r in enumerate(rest):
                left[k][:, j] = np.where(use[k], r[:, j], 0.0)
    return Weights(floor, spread), tuple(left)
