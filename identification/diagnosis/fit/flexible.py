"""Flexible predictor of residuals: ridge regression on random Fourier features of the joint's state.

The state is position, velocity, direction, acceleration, modelled torque, displacement since the last reversal and
time. The part of a residual that the predictor explains on held-out blocks is structure, whatever its cause. The
remaining part counts as noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identification.data.log import Log
from identification.diagnosis.columns.residual_columns import Columns
from identification.engine.products.blocks import Block
from phantom_dyn.array_types import Array, Float, Int
from phantom_dyn.random_streams import random_stream

_WAVES = 120  # number of random waves: each depends on two or three of the inputs
# Strengths of the ridge, in per cent of the sum of squares of one scaled feature: the first hardly shrinks any
# coefficient, the last shrinks all but those of the strongest features.
_RIDGES = (1e-4, 1e-2, 1.0)


def displacement_since_reversal(q: Float[Array, " N"], v: Float[Array, " N"]) -> Float[Array, " N"]:
    """Displacement of a joint since its velocity last changed sign, with the sign of the motion."""
    reversal = np.concatenate([[True], np.sign(v[1:]) != np.sign(v[:-1])])
    start = np.maximum.accumulate(np.where(reversal, np.arange(len(q)), 0))
    return q - q[start]


def state_features(columns: Columns, log: Log, index: int, row: int) -> Float[Array, "n f"]:
    """A constant, the standardised state of one joint in one log, and random waves of the state, ``(n, f)``.

    For a joint without a drive the modelled torque is not used, because it is the negative residual.

    Args:
        columns: Columns with the modelled torque of all logs.
        log: One of the logs.
        index: Its index.
        row: Index of the joint.
    """
    at = log.samples
    driven = columns.operations[0].robot.actuators[row].actuated
    torque = [columns.model_torque[index][:, row]] if driven else []
    motion = log.motion
    moved = displacement_since_reversal(motion.q[:, row], motion.v[:, row])
    scale = np.percentile(np.abs(motion.v[:, row]), 90) + 1e-12
    inputs = np.column_stack(
        [
            motion.q[at, row],
            motion.v[at, row],
            np.tanh(10 * motion.v[at, row] / scale),
            motion.a[at, row],
            *torque,
            moved[at],
            motion.t[at] - motion.t[0],
        ]
    )
    inputs = (inputs - inputs.mean(axis=0)) / (inputs.std(axis=0) + 1e-12)
    # Every call uses the same random features, so that a diagnosis is repeatable.
    rng = random_stream("random features")
    # One half of the waves changes slowly with the inputs, the other half quickly.
    widths = np.where(np.arange(_WAVES) % 2 == 0, 0.4, 1.2)
    # Each wave depends on two or three inputs, as friction, springs and load effects do.
    frequencies = rng.normal(size=(inputs.shape[1], _WAVES)) * widths
    frequencies *= rng.random(frequencies.shape) < 2.5 / inputs.shape[1]
    waves = np.cos(inputs @ frequencies + rng.uniform(0, 2 * np.pi, _WAVES))
    return np.column_stack([np.ones(len(at)), inputs, waves])


def ridge_predictions(
    x: list[Float[Array, "n k"]],
    y: list[Float[Array, " n"]],
    use: list[Array],
    blocks: tuple[Block, ...],
    folds: Int[Array, " B"],
    first: tuple[int, ...] = (),
) -> Iterator[tuple[list[Float[Array, " n"]], float]]:
    """Predictions of ``y`` from ``x``, each block by a ridge fit to other blocks, and their mean squared error.

    There is one prediction for each strength of the ridge. The features are scaled to unit size first.

    Args:
        x: Features of each log.
        y: Series to predict, one for each log.
        use: True for the samples of each log that are used.
        blocks: Blocks of the logs.
        folds: Fold of each block; a block of fold -1 is predicted by the fit on all folds.
        first: Numbers of leading features; each of them gives additional predictions, from these features alone.
    """
    size = np.sqrt(sum((part[used] ** 2).sum(axis=0) for part, used in zip(x, use, strict=True)))
    total = max(sum(int(used.sum()) for used in use), 1)
    scale = np.where(size > 0, size / np.sqrt(total), 1.0)
    scaled = [part / scale for part in x]
    training = _training_data(scaled, y, use, blocks, folds)
    ridges = [ridge * total * 1e-2 for ridge in _RIDGES]
    # Coefficients for each number of features and each ridge: of the fits without each fold, then of the fit to all.
    which = np.unique(folds)
    fits = np.zeros((int(folds.max(initial=-1)) + 2, len(size), 1 + len(first), len(ridges)))
    for k, count in enumerate((*first, len(size))):
        kept = np.flatnonzero(size[:count] > 1e-9 * max(size[:count].max(), 1e-300))
        if not len(kept):  # no feature varies
            continue
        ridge_fits = _by_samples if len(training.y) < len(kept) else _by_features
        fits[which[:, None], kept, k] = ridge_fits(training, kept, ridges, which)
    predicted = [np.zeros((len(series), fits[0, 0].size)) for series in y]
    squared, samples = np.zeros(fits[0, 0].size), 0
    for fold, block in zip(folds.tolist(), blocks, strict=True):
        part = slice(block.start, block.stop)
        # All fits in one product, so that the features are read once. Fold -1 comes last.
        predicted[block.log][part] = scaled[block.log][part] @ fits[fold].reshape(len(size), -1)
        core = slice(block.core, block.stop)
        used = use[block.log][core]
        error = (y[block.log][core, None] - predicted[block.log][core])[used]
        squared += (error**2).sum(axis=0)
        samples += len(error)
    for k, loss in enumerate(squared / max(samples, 1)):
        yield [part[:, k] for part in predicted], float(loss)


@dataclass(frozen=True)
class _TrainingData:
    """Training data: features and values of all samples, the fold of each, and the number of folds."""

    x: Float[Array, "n k"]
    y: Float[Array, " n"]
    fold: Int[Array, " n"]
    folds: int

    @cached_property
    def products(self) -> tuple[Float[Array, "F k k"], Float[Array, "F k"]]:
        """Features times features and times values, of each fold."""
        parts = [(self.x[own], self.y[own]) for own in (self.fold == fold for fold in range(self.folds))]
        return np.stack([x.T @ x for x, _ in parts]), np.stack([x.T @ y for x, y in parts])


def _training_data(
    x: list[Float[Array, "n k"]],
    y: list[Float[Array, " n"]],
    use: list[Array],
    blocks: tuple[Block, ...],
    folds: Int[Array, " B"],
) -> _TrainingData:
    """The used samples of all blocks that fits may use."""
    fold_of = [np.full(len(series), -1) for series in y]
    for fold, block in zip(folds.tolist(), blocks, strict=True):
        fold_of[block.log][block.start : block.stop] = fold
    in_folds = [used & (fold >= 0) for used, fold in zip(use, fold_of, strict=True)]
    features, values, fold = (
        np.concatenate([part[used] for part, used in zip(parts, in_folds, strict=True)]) for parts in (x, y, fold_of)
    )
    return _TrainingData(features, values, fold, int(folds.max(initial=-1)) + 1)


def _by_features(
    training: _TrainingData, kept: Int[Array, " m"], ridges: list[float], folds: Int[Array, " G"]
) -> Float[Array, "G m R"]:
    """Coefficients of ridge fits that leave out one fold each (-1 leaves out none), from products of the features."""
    gram, product = training.products
    gram, product = gram[:, kept[:, None], kept], product[:, kept]
    total_gram, total_product = gram.sum(axis=0), product.sum(axis=0)
    out = np.empty((len(folds), len(kept), len(ridges)))
    for own, fold in zip(out, folds, strict=True):
        a, b = (total_gram, total_product) if fold < 0 else (total_gram - gram[fold], total_product - product[fold])
        for k, ridge in enumerate(ridges):
            own[:, k] = _with_ridge(a, ridge, b)
    return out


def _by_samples(
    training: _TrainingData, kept: Int[Array, " m"], ridges: list[float], folds: Int[Array, " G"]
) -> Float[Array, "G m R"]:
    """Coefficients as in `_by_features`, from products of samples: a smaller matrix if samples are fewer."""
    x = training.x[:, kept]
    products = x @ x.T
    out = np.empty((len(folds), len(kept), len(ridges)))
    for own, fold in zip(out, folds, strict=True):
        used = np.flatnonzero(training.fold != fold)
        for k, ridge in enumerate(ridges):
            own[:, k] = x[used].T @ _with_ridge(products[np.ix_(used, used)], ridge, training.y[used])
    return out


def _with_ridge(a: Float[Array, "m m"], ridge: float, b: Float[Array, " m"]) -> Float[Array, " m"]:
    """Solution of ``(a + ridge) x = b`` for products ``a``."""
    from scipy.linalg import cho_factor, cho_solve

    ridged = a.copy()
    ridged[np.diag_indices_from(ridged)] += ridge
    # The matrix is symmetric; its transpose has the memory order that needs no copy.
    return cho_solve(cho_factor(ridged.T, overwrite_a=True, check_finite=False), b, check_finite=False)
