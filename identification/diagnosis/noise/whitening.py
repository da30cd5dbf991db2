"""Autoregressive whitening of each row (generalised least squares): every frequency is weighted by its noise.

In a torque residual the power of encoder noise grows with the fourth power of frequency; that of disturbances falls. A
narrow band would lose what high frequencies tell about friction. In a wide band their noise would hide what low
frequencies tell about inertias. A wide band that is whitened keeps both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.motion.standstill import noise_share
from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.session import Series
from identification.diagnosis.noise.certain_samples import certain_variance, root_weights
from identification.engine.numerics.two_threads import in_two_threads
from phantom_dyn.array_types import Array, Bool, Float

_ORDER = 8  # coefficients of a filter: four are too few, a real servo with a load is then diagnosed differently
_LOST = 0.5  # largest share of the usable samples that the start of a filter may cost
_ROWS = 64  # samples that are filtered at a time


def noise_filter(e: list[Float[Array, " n"]], order: int = _ORDER) -> Float[Array, " m"]:
    """Finite filter ``1, -a_1 .. -a_order`` that whitens series of the same noise, by the Yule-Walker equations."""
    count = sum(len(part) for part in e)
    lags = np.zeros(order + 1)
    for part in e:
        for lag in range(min(order + 1, len(part))):
            lags[lag] += part[lag:] @ part[: len(part) - lag]
    if count < 20 * _ORDER or lags[0] == 0:
        return np.array([1.0])
    # A millionth of the variance keeps the equations solvable for noise that is nothing but low frequencies.
    matrix = lags[np.abs(np.subtract.outer(np.arange(order), np.arange(order)))] + 1e-6 * lags[0] * np.eye(order)
    return np.concatenate([[1.0], -np.linalg.solve(matrix, lags[1:])])


def longest_order(usable: list[Bool[Array, " n"]]) -> int:
    """Largest order of a filter, up to `_ORDER`, that costs no more than `_LOST` of the usable samples; 0 without any.

    Each run of usable samples loses as many as the order. Runs are short where only the swings of a leg are judged.

    Args:
        usable: Usable samples of one joint, for each log.
    """
    ends = [np.flatnonzero(np.diff(np.concatenate([[False], part, [False]]))) for part in usable]
    runs = np.concatenate([np.diff(at)[::2] for at in ends])
    if not len(runs):
        return 0
    return max(m for m in range(_ORDER + 1) if np.minimum(runs, m).sum() <= _LOST * runs.sum())


def filtered(kernel: Float[Array, " m"], x: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """``x`` through a causal finite filter along time; the first samples see zeros before them."""
    out = kernel[0] * x
    # A few samples at a time stay in the processor's cache until all lags are done.
    for start in range(0, len(x), _ROWS):
        stop = min(start + _ROWS, len(x))
        for lag in range(1, min(len(kernel), stop)):
            first = max(start, lag)
            out[first:stop] += kernel[lag] * x[first - lag : stop - lag]
    return out


def whitened(columns: Columns, noise: Series) -> tuple[Columns, Series]:
    """Columns, residual and modelled torque filtered so that the noise of each row is white, and that noise.

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
        usable=_usable_white(filters, columns),
    )
    return made, filters.series(noise)


@dataclass(frozen=True)
class Whitening:
    """Filters that make the noise of each row white, and weights of the samples.

    Attributes:
        kernels: Filter of each row.
        weights: Factor of each sample, for each log ``(n, nv)``.
    """

    kernels: list[Float[Array, " m"]]
    weights: list[Float[Array, "n nv"]]

    def columns(self, values: tuple[Float[Array, "n k"], ...], log: int) -> tuple[Float[Array, "n k"], ...]:
        """Whitened columns of one log, row by row."""

        def white(j: int) -> Array:
            out = filtered(self.kernels[j], values[j])
            out *= self.weights[log][:, j : j + 1]
            return out

        return tuple(in_two_threads(white, range(len(values))))

    def series(self, parts: Series) -> Series:
        """Whitened series of all logs, ``(n, nv)`` each."""
        return tuple(
            np.column_stack([filtered(kernel, part[:, j]) for j, kernel in enumerate(self.kernels)]) * weights
            for part, weights in zip(parts, self.weights, strict=True)
        )

    def transposed(self, e: Float[Array, " n"], log: int, row: int, start: int) -> tuple[Float[Array, " m"], int]:
        """The series whose product with any column equals that of ``e`` with the whitened column.

        Args:
            e: A series from one sample on.
            log: Log of the column.
            row: Row of the column.
            start: Index of the first sample of ``e``.

        Returns:
            The series, and the index of its first sample, which is earlier by the length of the filter.
        """
        kernel = self.kernels[row]
        back = np.convolve(e * self.weights[log][start : start + len(e), row], kernel[::-1])
        early = max(len(kernel) - 1 - start, 0)
        return back[early:], start - len(kernel) + 1 + early


def whitening_of(columns: Columns, noise: Series) -> Whitening:
    """Filters that make the noise of columns white, and the factor of each sample; values of columns are not used.

    The factor is the root of the share of noise in the variance of noise and uncertain friction together, scaled to a
    mean square of one on each row.

    Args:
        columns: Columns before whitening.
        noise: Unpredictable part of the residual, for each log; zero where a sample is not usable.
    """
    kernels = noise_filters(columns, noise)
    friction = [
        np.column_stack([friction_variance(columns, log, row, kernel) for row, kernel in enumerate(kernels)])
        for log in range(len(noise))
    ]
    variance = np.array(
        [noise_variance(columns, [part[:, j] for part in noise], j, kernel) for j, kernel in enumerate(kernels)]
    )
    return Whitening(kernels, _mean_square_one(columns, [noise_share(variance, part) for part in friction]))


def weights_without_filter(columns: Columns, noise: Series) -> Series:
    """Factor of each sample where no filter is used: lower at standstill, where friction may have any value.

    The squares are in proportion to the weights of the figures of a gap (`fit.gap.sample_weights`).
    """
    roots = [root_weights(columns, [part[:, j] for part in noise], j) for j in range(noise[0].shape[1])]
    share = [np.column_stack([of_row[log] ** 2 for of_row in roots]) for log in range(len(noise))]
    return tuple(_mean_square_one(columns, share))


def noise_filters(columns: Columns, noise: Series) -> list[Float[Array, " m"]]:
    """Filter of each row that makes its noise white, from the samples in which the joint moves."""
    kernels = []
    for j in range(noise[0].shape[1]):
        own = [part[:, j] for part in noise]
        roots = root_weights(columns, own, j)
        most = longest_order([use[:, j] & (root**2 > 0.5) for use, root in zip(columns.usable, roots, strict=True)])
        kernels.append(noise_filter([part * root for part, root in zip(own, roots, strict=True)], most))
    return kernels


def at_least_sensor_noise(columns: Columns, noise: Series, sensed: Series) -> Series:
    """Noise of each log's torque, increased to that of the sensors on rows where it would be smaller once whitened.

    The unpredictable part of a torque may be smooth, or lie in samples with uncertain friction. It is then smaller than
    the noise of the sensors once it is whitened and these samples have their low weight.

    Args:
        columns: Columns before whitening.
        noise: Unpredictable part of each log's torque; zero where a sample is not usable.
        sensed: Noise of the sensors in the torque.
    """
    filters = whitening_of(columns, noise)
    use = _usable_white(filters, columns)
    own, least = (squares_by_row(filters.series(series), use) for series in (noise, sensed))
    lacking = np.sqrt(np.maximum(1.0 - own / np.maximum(least, 1e-300), 0.0))
    return tuple(part + lacking * more for part, more in zip(noise, sensed, strict=True))


def squares_by_row(series: Series, usable: Sequence[Bool[Array, "n nv"]]) -> Float[Array, " nv"]:
    """Sum of squares of each row over the usable samples of all logs."""
    parts = zip(series, usable, strict=True)
    return np.asarray(sum(np.sum(np.where(use, part, 0.0) ** 2, axis=0) for part, use in parts))


def friction_variance(columns: Columns, log: int, row: int, kernel: Float[Array, " m"]) -> Float[Array, " n"]:
    """Variance of the whitened torque of a row due to uncertain friction, at reversals and at standstill, by sample.

    At a reversal the time of the step of friction is uncertain: that error is filtered. The static friction of a joint
    at standstill may change from sample to sample, so the largest possible output of the filter is taken.
    """
    return filtered(kernel, columns.reversal_std[log][:, row]) ** 2 + standstill_variance(columns, log, row, kernel)


def standstill_variance(columns: Columns, log: int, row: int, kernel: Float[Array, " m"]) -> Float[Array, " n"]:
    """The part of `friction_variance` that is due to standstill."""
    return filtered(np.abs(kernel), columns.standstill_std[log][:, row]) ** 2


def noise_variance(
    columns: Columns, noise: Sequence[Float[Array, " n"]], row: int, kernel: Float[Array, " m"]
) -> float:
    """Variance of the whitened noise of a row over the samples in which the joint moves; above zero.

    Args:
        columns: Usable samples, and the static friction at standstill.
        noise: Noise of the row, for each log.
        row: Index of the row.
        kernel: Filter that whitens the noise.
    """
    use = [part[:, row] for part in columns.usable]
    white = [filtered(kernel, part)[u] ** 2 for part, u in zip(noise, use, strict=True)]
    still = [standstill_variance(columns, log, row, kernel)[u] for log, u in enumerate(use)]
    return max(certain_variance(np.concatenate(white), np.concatenate(still)), 1e-300)


def _mean_square_one(columns: Columns, share: list[Float[Array, "n nv"]]) -> list[Float[Array, "n nv"]]:
    """Weights of samples, the roots of shares, with a mean square of one over the usable samples of each row."""
    count = sum(use.sum(axis=0) for use in columns.usable)
    mean = sum(np.where(use, s, 0.0).sum(axis=0) for s, use in zip(share, columns.usable, strict=True))
    mean = np.maximum(mean / np.maximum(count, 1), 1e-300)
    # On a row without usable samples the weight has no effect.
    return [np.where(count > 0, np.sqrt(s / mean), 1.0) for s in share]


def _usable_white(filters: Whitening, columns: Columns) -> tuple[Bool[Array, "n nv"], ...]:
    """Usable samples of each log after whitening."""
    return tuple(
        np.column_stack([_with_history(len(kernel), use) for kernel, use in zip(filters.kernels, part.T, strict=True)])
        for part in columns.usable
    )


def _with_history(length: int, usable: Bool[Array, " n"]) -> Bool[Array, " n"]:
    """True at usable samples that follow enough usable ones for a filter of ``length`` coefficients."""
    out = usable.copy()
    out[: length - 1] = False
    for lag in range(1, length):
        out[lag:] &= usable[:-lag]
    return out
