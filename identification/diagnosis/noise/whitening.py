"""Autoregressive whitening of each row (generalised least squares): every frequency is weighted by its noise.

Encoder noise grows with the fourth power of frequency in a torque residual, disturbances fall off. A narrow band would
lose what friction leaves at high frequencies, a wide one would drown what inertias leave at low ones; whitened, a wide
band loses neither.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from identification.diagnosis.columns.residual_columns import Columns
from identification.diagnosis.columns.session import Series
from identification.engine.numerics.two_threads import in_two_threads
from phantom_dyn.array_types import Array, Bool, Float

_ORDER = 8
_LOST = 0.5  # share of the usable samples, at most, that a filter may take for looking back
_ROWS = 64


def noise_filter(e: list[Float[Array, " n"]], order: int = _ORDER) -> Float[Array, " m"]:
    """Finite filter ``1, -a_1 .. -a_order`` that whitens series of one noise, by the Yule-Walker equations."""
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
    """Order of a filter that leaves most of the usable samples: in a swing of a leg there are few in a row.

    Args:
        usable: Of one joint, for each log.
    """
    ends = [np.flatnonzero(np.diff(np.concatenate([[False], part, [False]]))) for part in usable]
    runs = np.concatenate([np.diff(at)[::2] for at in ends])
    return max(m for m in range(_ORDER + 1) if np.minimum(runs, m).sum() <= _LOST * runs.sum())


def filtered(kernel: Float[Array, " m"], x: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """``x`` through a causal finite filter along time; the first samples see zeros before them."""
    out = kernel[0] * x
    # A few rows at a time stay in the processor's cache until all lags are done.
    for start in range(0, len(x), _ROWS):
        stop = min(start + _ROWS, len(x))
        for lag in range(1, min(len(kernel), stop)):
            first = max(start, lag)
            out[first:stop] += kernel[lag] * x[first - lag : stop - lag]
    return out


def whitened(columns: Columns, noise: Series) -> tuple[Columns, Series]:
    """The same columns, residual and modelled torque with the noise of each row white, and that noise.

    Samples in doubt count less, as if their noise were larger by that.

    Args:
        columns: Not whitened yet.
        noise: What no model predicts of the residual, for each log ``(n, nv)``; zero where a sample is not usable.
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
    """Filters that make the noise of each row white, and how much each sample counts.

    Attributes:
        kernels: Of each row.
        trust: For each log, ``(n, nv)``.
    """

    kernels: list[Float[Array, " m"]]
    trust: list[Float[Array, "n nv"]]

    def columns(self, values: tuple[Float[Array, "n k"], ...], log: int) -> tuple[Float[Array, "n k"], ...]:
        """Columns of one log, row by row."""

        def white(j: int) -> Array:
            out = filtered(self.kernels[j], values[j])
            out *= self.trust[log][:, j : j + 1]
            return out

        return tuple(in_two_threads(white, range(len(values))))

    def series(self, parts: Series) -> Series:
        """Series of all logs, ``(n, nv)`` each."""
        return tuple(_white(self.kernels, part) * own for part, own in zip(parts, self.trust, strict=True))

    def before(self, e: Float[Array, " n"], log: int, row: int, start: int) -> tuple[Float[Array, " m"], int]:
        """What a column has to be multiplied with so that ``e`` is multiplied with the white column.

        Args:
            e: From one sample on.
            log: Of the column.
            row: Of the column.
            start: The first sample of ``e``.

        Returns:
            The series, and its first sample: the filter looks back.
        """
        kernel = self.kernels[row]
        back = np.convolve(e * self.trust[log][start : start + len(e), row], kernel[::-1])
        early = max(len(kernel) - 1 - start, 0)
        return back[early:], start - len(kernel) + 1 + early


def whitening_of(columns: Columns, noise: Series) -> Whitening:
    """What makes the noise of columns white, see `whitened`; their values are not needed."""
    kernels = [
        noise_filter([part[:, j] for part in noise], longest_order([use[:, j] for use in columns.usable]))
        for j in range(noise[0].shape[1])
    ]
    return Whitening(kernels, _trust(columns, kernels, noise))


def no_less_than_sensed(columns: Columns, noise: Series, sensed: Series) -> Series:
    """Noise of each row, filled up with that of the sensors where what weighs the fits is less than these make of it.

    What predictors leave may be smooth, or lie where friction is in doubt: white, and with such samples counting
    little, it is then smaller than the noise of the sensors is.

    Args:
        columns: Not whitened yet.
        noise: What no predictor foresees of each log's torque; zero where a sample is not usable.
        sensed: The noise of the sensors in it.
    """
    filters = whitening_of(columns, noise)
    use = _usable_white(filters, columns)
    own, least = (
        sum(np.sum(np.where(u, part, 0.0) ** 2, axis=0) for part, u in zip(filters.series(series), use, strict=True))
        for series in (noise, sensed)
    )
    lacking = np.sqrt(np.maximum(1.0 - own / np.maximum(least, 1e-300), 0.0))
    return tuple(part + lacking * more for part, more in zip(noise, sensed, strict=True))


def whitened_noise(
    columns: Columns,
    noise: Series,
    like: Series | None = None,
) -> Series:
    """The noise of each log as `whitened` makes it, or another series if ``like`` is the noise."""
    return whitening_of(columns, noise if like is None else like).series(noise)


def _white(kernels: list[Float[Array, " m"]], series: Float[Array, "n nv"]) -> Float[Array, "n nv"]:
    return np.column_stack([filtered(kernel, series[:, j]) for j, kernel in enumerate(kernels)])


def doubt_of(columns: Columns, log: int, row: int, kernel: Float[Array, " m"]) -> Float[Array, " n"]:
    """Variance of the whitened torque of a row where friction is in doubt: at reversals, and where a joint stands.

    A reversal shifts a step in time, and filters make of it what they make of a step. What a standing joint holds may
    be anything from sample to sample, so it counts at the most that the filter can make of it.
    """
    shifted = filtered(kernel, columns.doubt[log][:, row])
    return shifted**2 + filtered(np.abs(kernel), columns.standing[log][:, row]) ** 2


def _trust(columns: Columns, kernels: list[Float[Array, " m"]], noise: Series) -> list[Float[Array, "n nv"]]:
    """Weight of each sample, its noise over noise and doubt together, of mean square one on each row."""
    white = [_white(kernels, part) ** 2 for part in noise]
    doubt = [
        np.column_stack([doubt_of(columns, log, row, kernel) for row, kernel in enumerate(kernels)])
        for log in range(len(noise))
    ]
    total = sum(np.where(use, w, 0.0).sum(axis=0) for w, use in zip(white, columns.usable, strict=True))
    count = sum(use.sum(axis=0) for use in columns.usable)
    variance = np.maximum(total / np.maximum(count, 1), 1e-300)
    share = [variance / (variance + d) for d in doubt]
    mean = sum(np.where(use, s, 0.0).sum(axis=0) for s, use in zip(share, columns.usable, strict=True))
    mean = np.maximum(mean / np.maximum(count, 1), 1e-300)
    # Of a row without usable samples none counts, whatever its weight.
    return [np.where(count > 0, np.sqrt(s / mean), 1.0) for s in share]


def _usable_white(filters: Whitening, columns: Columns) -> tuple[Bool[Array, "n nv"], ...]:
    """Usable samples of each log after whitening."""
    return tuple(
        np.column_stack([_reached(len(kernel), use) for kernel, use in zip(filters.kernels, part.T, strict=True)])
        for part in columns.usable
    )


def _reached(length: int, usable: Bool[Array, " n"]) -> Bool[Array, " n"]:
    """Usable samples whose filter reaches back to usable samples only."""
    out = usable.copy()
    out[: length - 1] = False
    for lag in range(1, length):
        out[lag:] &= usable[:-lag]
    return out
