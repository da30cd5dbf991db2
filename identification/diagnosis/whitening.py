"""Noise made white: each row through one short filter, so that every frequency counts by how little noise it has.

Encoder noise grows with the fourth power of frequency in a torque residual, disturbances fall off. A narrow band would
lose what friction leaves at high frequencies, a wide one would drown what inertias leave at low ones; whitened, a wide
band loses neither (generalised least squares with an autoregressive noise model).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from identification.diagnosis.columns import Columns
from identification.diagnosis.two_at_a_time import two_at_a_time

Array = np.ndarray

_ORDER = 8


def noise_filter(e: list[Float[Array, " n"]]) -> Float[Array, " m"]:
    """Finite filter ``1, -a_1 .. -a_8`` that whitens series of one noise, by the Yule-Walker equations."""
    count = sum(len(part) for part in e)
    lags = np.zeros(_ORDER + 1)
    for part in e:
        for lag in range(min(_ORDER + 1, len(part))):
            lags[lag] += part[lag:] @ part[: len(part) - lag]
    if count < 20 * _ORDER or lags[0] == 0:
        return np.array([1.0])
    # A millionth of the variance keeps the equations solvable for noise that is nothing but low frequencies.
    matrix = lags[np.abs(np.subtract.outer(np.arange(_ORDER), np.arange(_ORDER)))] + 1e-6 * lags[0] * np.eye(_ORDER)
    return np.concatenate([[1.0], -np.linalg.solve(matrix, lags[1:])])


def filtered(kernel: Float[Array, " m"], x: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """``x`` through a causal finite filter along time; the first samples see zeros before them."""
    out = kernel[0] * x
    for lag in range(1, len(kernel)):
        out[lag:] += kernel[lag] * x[:-lag]
    return out


def whitened(
    columns: Columns, noise: tuple[Float[Array, "n nv"], ...]
) -> tuple[Columns, tuple[Float[Array, "n nv"], ...]]:
    """The same columns, residual and modelled torque with the noise of each row white, and that noise.

    Args:
        columns: As computed.
        noise: What no model predicts of the residual, for each log ``(n, nv)``; zero where a sample is not usable.
    """
    rows = range(len(columns.rows))
    kernels = [noise_filter([part[:, j] for part in noise]) for j in rows]
    values, residual, torque, usable = [], [], [], []
    for log in range(len(columns.values)):
        own = columns.values[log]
        values.append(tuple(two_at_a_time(lambda j, own=own: filtered(kernels[j], own[j]), rows)))
        residual.append(np.column_stack([filtered(kernels[j], columns.residual[log][:, j]) for j in rows]))
        torque.append(np.column_stack([filtered(kernels[j], columns.model_torque[log][:, j]) for j in rows]))
        usable.append(np.column_stack([_reached(len(kernels[j]), columns.usable[log][:, j]) for j in rows]))
    white = replace(
        columns, values=tuple(values), residual=tuple(residual), model_torque=tuple(torque), usable=tuple(usable)
    )
    return white, whitened_noise(noise)


def whitened_noise(
    noise: tuple[Float[Array, "n nv"], ...], like: tuple[Float[Array, "n nv"], ...] | None = None
) -> tuple[Float[Array, "n nv"], ...]:
    """The noise of each log through the filters that whiten it, or another noise if ``like`` is given."""
    rows = range(noise[0].shape[1])
    kernels = [noise_filter([part[:, j] for part in (noise if like is None else like)]) for j in rows]
    return tuple(np.column_stack([filtered(kernels[j], part[:, j]) for j in rows]) for part in noise)


def _reached(length: int, usable: Bool[Array, " n"]) -> Bool[Array, " n"]:
    """Usable samples whose filter reaches back to usable samples only."""
    out = usable.copy()
    out[: length - 1] = False
    for lag in range(1, length):
        out[lag:] &= usable[:-lag]
    return out
