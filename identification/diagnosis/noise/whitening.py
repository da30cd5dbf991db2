"""Autoregressive whitening of each row (generalised least squares), so that each frequency is weighted by its noise.

A row is one joint's torque. Whitening filters the residual and all columns of a row with one filter, after which the
row's noise is white: it has the same power at all frequencies. A sample is certain if its friction is known, because
the joint moves.

In a torque residual the power of encoder noise grows with the fourth power of frequency, and that of disturbances
falls. A narrow band would lose what high frequencies show of friction. In a wide band without whitening, the noise at
high frequencies would hide what low frequencies show of inertias. A wide band with whitening keeps both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.motion.standstill import noise_share
from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.session import Series
from identification.diagnosis.noise.certain_samples import (
    certain_samples,
    certain_variance,
    moving_variance,
    root_weights,
    roots_of_shares,
)
from identification.engine.autocorrelation import lagged_products
from identification.engine.numerics.two_threads import in_two_threads
from phantom_dyn.array_types import Array, Bool, Float, Int

_ORDER = 8  # number of samples that predict the next; four are too few for a real servo with a load
_SAMPLES_AT_A_TIME = 64  # number of samples that are filtered together: few enough for the processor's cache


def row_autocovariance(columns: Columns, noise: Sequence[Float[Array, " n"]], row: int) -> Float[Array, " m"]:
    """Autocovariance of a row's noise while its joint moves, at lags 0 to `_ORDER`, or at lag 0 alone.

    Only lag 0 is estimated if there are too few samples, or if the noise is zero.

    Args:
        columns: Usable samples, and the standard deviation of friction at standstill.
        noise: Noise of the row, for each log.
        row: Index of the row.
    """
    variance = moving_variance(columns, noise, row)
    roots = roots_of_shares(columns, row, variance)
    lags = autocovariance([part * root for part, root in zip(noise, roots, strict=True)])
    return lags * (variance / lags[0])


def autocovariance(e: Sequence[Float[Array, " n"]]) -> Float[Array, " m"]:
    """Lagged products, summed over several series of one noise, at lags 0 to `_ORDER`; ``[1.0]`` if short or zero."""
    lags = np.zeros(_ORDER + 1)
    for part in e:
        own = lagged_products(part)[: _ORDER + 1]
        lags[: len(own)] += own
    if sum(len(part) for part in e) < 20 * _ORDER or lags[0] == 0:
        return np.array([1.0])
    # An added millionth of the variance keeps the equations solvable for noise that has only low frequencies.
    lags[0] *= 1.0 + 1e-6
    return lags


def row_filters(columns: Columns, log: int, row: int, covariances: Float[Array, " m"]) -> Float[Array, "n m"]:
    """Filters that whiten a row's noise in one log; only samples with certain friction predict others."""
    return prediction_filters(covariances, certain_samples(columns, log, row, covariances[0]))


def prediction_filters(covariances: Float[Array, " m"], certain: Bool[Array, " n"]) -> Float[Array, "n m"]:
    """For each sample, coefficients of a filter that whitens a noise, for this sample and those before it.

    The output of the filter is the sample minus its best linear prediction from the certain samples before it
    (Yule-Walker equations). Samples after an uncertain one can be used, too, because the uncertain one does not predict
    them. Predictions from fewer samples have larger errors, so filters are scaled to errors of the same variance.

    Args:
        covariances: Autocovariance of the noise, at lags from 0 to the largest lag of a prediction.
        certain: True for samples that may predict others.
    """
    reach = len(covariances) - 1
    if reach == 0:
        return np.ones((len(certain), 1))
    padded = np.concatenate([np.zeros(reach, dtype=bool), certain])
    # For each sample, which of the samples before it are certain, the last one first.
    before = np.lib.stride_tricks.sliding_window_view(padded, reach)[: len(certain), ::-1]
    patterns, which = np.unique(before, axis=0, return_inverse=True)
    least = _prediction(covariances, np.arange(1, reach + 1))[1]
    filters = np.zeros((len(patterns), reach + 1))
    for row, pattern in zip(filters, patterns, strict=True):
        lags = np.flatnonzero(pattern) + 1
        coefficients, variance = _prediction(covariances, lags)
        row[0], row[lags] = 1.0, -coefficients
        row *= np.sqrt(least / variance)
    return filters[which.ravel()]


def _prediction(covariances: Float[Array, " m"], lags: Int[Array, " k"]) -> tuple[Float[Array, " k"], float]:
    """Coefficients of the best linear prediction from samples at the given lags, and the variance of its error."""
    a = np.linalg.solve(covariances[np.abs(lags[:, None] - lags)], covariances[lags])
    return a, float(covariances[0] - a @ covariances[lags])


def filtered(filters: Float[Array, "n m"], x: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """``x`` after a causal filter whose coefficients differ from sample to sample; before the first, ``x`` is zero."""
    weights = filters.reshape(*filters.shape, *(1,) * (x.ndim - 1))
    out = weights[:, 0] * x
    for start in range(0, len(x), _SAMPLES_AT_A_TIME):
        stop = min(start + _SAMPLES_AT_A_TIME, len(x))
        for lag in range(1, min(filters.shape[1], stop)):
            first = max(start, lag)
            out[first:stop] += weights[first:stop, lag] * x[first - lag : stop - lag]
    return out


def whitened(columns: Columns, noise: Series) -> tuple[Columns, Series]:
    """Columns whose values, residual and modelled torque are filtered so that the noise is white, and this white noise.

    Samples with uncertain friction get a lower weight, as if their noise were larger.

    Args:
        columns: Columns before whitening.
        noise: Unpredictable part of the residual, for each log ``(n, nv)``; zero where a sample is not usable.
    """
    filters = whitening_of(columns, noise)
    made = replace(
        columns,
        values=tuple(filters.columns(own, log) for log, own in enumerate(columns.values)),
        residual=filters.series(columns.residual),
        model_torque=filters.series(columns.model_torque),
    )
    return made, filters.series(noise)


@dataclass(frozen=True)
class Whitening:
    """Filters that make the noise of each row white, and weights of the samples.

    Attributes:
        filters: Coefficients of the filter of each sample, ``filters[row][log] (n, m)``.
        weights: Factor of each sample, for each log ``(n, nv)``.
    """

    filters: list[list[Float[Array, "n m"]]]
    weights: list[Float[Array, "n nv"]]

    def columns(self, values: tuple[Float[Array, "n k"], ...], log: int) -> tuple[Float[Array, "n k"], ...]:
        """Whitened columns of one log, row by row."""

        def white(j: int) -> Array:
            out = filtered(self.filters[j][log], values[j])
            out *= self.weights[log][:, j : j + 1]
            return out

        return tuple(in_two_threads(white, range(len(values))))

    def series(self, parts: Series) -> Series:
        """Whitened series of all logs, ``(n, nv)`` each."""
        return tuple(
            np.column_stack([filtered(row[log], part[:, j]) for j, row in enumerate(self.filters)]) * weights
            for log, (part, weights) in enumerate(zip(parts, self.weights, strict=True))
        )

    def transposed(self, e: Float[Array, " n"], log: int, row: int, start: int) -> tuple[Float[Array, " m"], int]:
        """A series whose product with any column equals the product of ``e`` with the whitened column.

        Args:
            e: A part of a series.
            log: Index of the log.
            row: Index of the row.
            start: Index of the first sample of ``e`` in the log.

        Returns:
            The series, and the index of its first sample, which is earlier by the length of the filter.
        """
        stop = start + len(e)
        filters, weighted = self.filters[row][log][start:stop], e * self.weights[log][start:stop, row]
        reach = filters.shape[1] - 1
        back = np.zeros(reach + len(e))
        for lag in range(reach + 1):
            back[reach - lag : reach - lag + len(e)] += filters[:, lag] * weighted
        # Products with samples before the start of the log are left out.
        missing = max(reach - start, 0)
        return back[missing:], start - reach + missing


def whitening_of(columns: Columns, noise: Series) -> Whitening:
    """Filters that make the noise of each row white, and weights of the samples; values of columns are not used.

    The weight is the square root of ``noise / (noise + friction)``, the variances of noise and of uncertain friction,
    scaled to a mean square of one on each row.

    Args:
        columns: Columns before whitening.
        noise: Unpredictable part of the residual, for each log; zero where a sample is not usable.
    """
    by_row = [[part[:, j] for part in noise] for j in range(noise[0].shape[1])]
    covariances = [row_autocovariance(columns, own, j) for j, own in enumerate(by_row)]
    filters = [[row_filters(columns, log, j, own) for log in range(len(noise))] for j, own in enumerate(covariances)]
    friction = [
        np.column_stack([friction_variance(columns, log, j, row[log]) for j, row in enumerate(filters)])
        for log in range(len(noise))
    ]
    variance = np.array([noise_variance(columns, own, j, filters[j]) for j, own in enumerate(by_row)])
    return Whitening(filters, _mean_square_one(columns, [noise_share(variance, part) for part in friction]))


def weights_without_filter(columns: Columns, noise: Series) -> Series:
    """Weights of the samples, if no filter is used: lower at standstill, where friction may have any value.

    Their squares are proportional to the weights in `identification.diagnosis.fit.gap.sample_weights`.
    """
    roots = [root_weights(columns, [part[:, j] for part in noise], j) for j in range(noise[0].shape[1])]
    share = [np.column_stack([of_row[log] ** 2 for of_row in roots]) for log in range(len(noise))]
    return tuple(_mean_square_one(columns, share))


def at_least_sensor_noise(columns: Columns, noise: Series, sensed: Series) -> Series:
    """Noise of each log's torque, with sensor noise added to rows whose whitened noise would be smaller than this.

    The unpredictable part of a torque may be smooth, or occur mainly in samples with uncertain friction. After
    whitening, and with the low weights of these samples, it may then be smaller than the noise of the sensors.

    Args:
        columns: Columns before whitening.
        noise: Unpredictable part of each log's torque; zero where a sample is not usable.
        sensed: Noise of the sensors in the torque, from `sensor_floor.sensed_noise`.
    """
    filters = whitening_of(columns, noise)
    own, least = (squares_by_row(filters.series(series), columns.usable) for series in (noise, sensed))
    lacking = np.sqrt(np.maximum(1.0 - own / np.maximum(least, 1e-300), 0.0))
    return tuple(part + lacking * more for part, more in zip(noise, sensed, strict=True))


def squares_by_row(series: Series, usable: Sequence[Bool[Array, "n nv"]]) -> Float[Array, " nv"]:
    """Sum of squares of each row over the usable samples of all logs."""
    parts = zip(series, usable, strict=True)
    return np.asarray(sum(np.sum(np.where(use, part, 0.0) ** 2, axis=0) for part, use in parts))


def friction_variance(columns: Columns, log: int, row: int, filters: Float[Array, "n m"]) -> Float[Array, " n"]:
    """Variance of a row's whitened torque from uncertain friction at reversals and at standstill, for each sample.

    At a reversal, the time at which friction changes sign is uncertain. This error is filtered like the torque. The
    static friction at standstill may change from sample to sample, so the largest possible output of the filter is
    used.
    """
    return filtered(filters, columns.reversal_std[log][:, row]) ** 2 + standstill_variance(columns, log, row, filters)


def standstill_variance(columns: Columns, log: int, row: int, filters: Float[Array, "n m"]) -> Float[Array, " n"]:
    """Variance of a row's whitened torque from uncertain friction at standstill, for each sample."""
    return filtered(np.abs(filters), columns.standstill_std[log][:, row]) ** 2


def noise_variance(
    columns: Columns, noise: Sequence[Float[Array, " n"]], row: int, filters: list[Float[Array, "n m"]]
) -> float:
    """Variance of the whitened noise of a row over the samples in which the joint moves; above zero.

    Args:
        columns: Usable samples, and the standard deviation of friction at standstill.
        noise: Noise of the row, for each log.
        row: Index of the row.
        filters: Filters that whiten the noise, for each log.
    """
    use = [part[:, row] for part in columns.usable]
    white = [filtered(own, part)[u] ** 2 for own, part, u in zip(filters, noise, use, strict=True)]
    still = [standstill_variance(columns, log, row, filters[log])[u] for log, u in enumerate(use)]
    return max(certain_variance(np.concatenate(white), np.concatenate(still)), 1e-300)


def _mean_square_one(columns: Columns, share: list[Float[Array, "n nv"]]) -> list[Float[Array, "n nv"]]:
    """Weights of samples: roots of shares, scaled to a mean square of one over the usable samples of each row."""
    count = sum(use.sum(axis=0) for use in columns.usable)
    mean = sum(np.where(use, part, 0.0).sum(axis=0) for part, use in zip(share, columns.usable, strict=True))
    mean = np.maximum(mean / np.maximum(count, 1), 1e-300)
    # On a row without usable samples the weight has no effect.
    return [np.where(count > 0, np.sqrt(part / mean), 1.0) for part in share]
