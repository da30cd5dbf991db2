"""Flexible predictor of residuals: ridge regression on random Fourier features of the joint's state.

Features are of position, velocity, direction, acceleration, modelled torque, displacement since the last reversal and
time. What it predicts on held-out blocks is structure, whatever its cause; what it cannot predict counts as noise.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from identification.data.log import Log
from identification.diagnosis.model.blocks import Block
from identification.diagnosis.model.columns import Columns
from phantom_dyn.random_streams import random_stream

Array = np.ndarray

_FEATURES = 120
_RIDGES = (1e-4, 1e-2, 1.0)


def displacement_since_reversal(q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " N"]:
    """How far a joint has moved since its velocity last changed sign, with the sign of the motion."""
    reversal = np.concatenate([[True], np.sign(v[1:]) != np.sign(v[:-1])])
    start = np.maximum.accumulate(np.where(reversal, np.arange(len(q)), 0))
    return q - q[start]


def state_features(columns: Columns, log: Log, index: int, row: int) -> Float[Array, "n f"]:
    """Random Fourier features of one joint's state on one log, standardised, ``(n, 120 + raw inputs)``."""
    at = log.samples
    motion = log.motion
    moved = displacement_since_reversal(motion.q[:, row], motion.v[:, row])
    scale = np.percentile(np.abs(motion.v[:, row]), 90) + 1e-12
    inputs = np.column_stack(
        [
            motion.q[at, row],
            motion.v[at, row],
            np.tanh(10 * motion.v[at, row] / scale),
            motion.a[at, row],
            columns.model_torque[index][:, row],
            moved[at],
            motion.t[at] - motion.t[0],
        ]
    )
    inputs = (inputs - inputs.mean(axis=0)) / (inputs.std(axis=0) + 1e-12)
    # The same features on every call: a fixed seed makes a diagnosis repeatable.
    rng = random_stream("random features")
    widths = np.where(np.arange(_FEATURES) % 2 == 0, 0.4, 1.2)
    # Each feature looks at two or three inputs, which is what friction, springs and load effects depend on.
    direction = rng.normal(size=(inputs.shape[1], _FEATURES)) * widths
    direction *= rng.random(direction.shape) < 2.5 / inputs.shape[1]
    waves = np.cos(inputs @ direction + rng.uniform(0, 2 * np.pi, _FEATURES))
    return np.column_stack([np.ones(len(at)), inputs, waves])


def ridge_predictions(
    x: list[Float[Array, "n k"]],
    y: list[Float[Array, " n"]],
    use: list[Array],
    blocks: tuple[Block, ...],
    folds: Int[Array, " B"],
    first: tuple[int, ...] = (),
) -> Iterator[tuple[list[Float[Array, " n"]], float]]:
    """Predictions of ``y`` from ``x``, each block by a ridge fit that has not seen it, and their mean squared error.

    One of each of three relative strengths of the ridge; columns are scaled to unit size first.

    Args:
        x: Features of each log.
        y: What to predict, of each log.
        use: Samples that count, of each log.
        blocks: Of the logs.
        folds: Of each block; -1 is predicted by the fit on all folds.
        first: Try so many of the first features alone as well.
    """
    size = np.sqrt(sum((a[m] ** 2).sum(axis=0) for a, m in zip(x, use, strict=True)))
    total = max(sum(int(m.sum()) for m in use), 1)
    scaled = [a / np.where(size > 0, size / np.sqrt(total), 1.0) for a in x]
    groups = int(folds.max(initial=-1)) + 1
    gram, product = np.zeros((groups, len(size), len(size))), np.zeros((groups, len(size)))
    for fold, block in zip(folds.tolist(), blocks, strict=True):
        if fold < 0:
            continue
        part = slice(block.start, block.stop)
        m = use[block.log][part]
        xb = scaled[block.log][part]
        xb = xb if m.all() else xb[m]
        gram[fold] += xb.T @ xb
        product[fold] += xb.T @ y[block.log][part][m]
    for count in (*first, len(size)):
        kept = np.flatnonzero(size[:count] > 1e-9 * max(size[:count].max(), 1e-300))
        sub = gram[:, kept[:, None], kept], product[:, kept]
        for ridge in _RIDGES:
            yield _judged(scaled, kept, sub, ridge * total * 1e-2, y, use, blocks, folds)


def _judged(
    scaled: list[Float[Array, "n k"]],
    kept: Int[Array, " m"],
    products: tuple[Float[Array, "F m m"], Float[Array, "F m"]],
    ridge: float,
    y: list[Float[Array, " n"]],
    use: list[Array],
    blocks: tuple[Block, ...],
    folds: Int[Array, " B"],
) -> tuple[list[Float[Array, " n"]], float]:
    """Predictions with one ridge from some of the features, and their mean squared error; products are by fold."""
    gram, product = products
    whole, everything = gram.sum(axis=0), product.sum(axis=0)
    whole[np.diag_indices_from(whole)] += ridge
    predicted = [np.zeros_like(v) for v in y]
    squared, samples = 0.0, 0
    for fold in np.unique(folds):
        a, b = (whole, everything) if fold < 0 else (whole - gram[fold], everything - product[fold])
        w = np.zeros(scaled[0].shape[1])
        w[kept] = np.linalg.solve(a, b)
        for k in np.flatnonzero(folds == fold):
            block = blocks[k]
            part = slice(block.start, block.stop)
            predicted[block.log][part] = scaled[block.log][part] @ w
            core = slice(block.core, block.stop)
            m = use[block.log][core]
            error = (y[block.log][core] - predicted[block.log][core])[m]
            squared += float(error @ error)
            samples += len(error)
    return predicted, squared / max(samples, 1)
