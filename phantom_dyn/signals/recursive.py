"""Recursive filters: what a low pass leaves of samples, with its delay or, forwards and backwards, without.

`scipy.signal` has the same. Importing it loads all of `scipy.stats` and takes half a second, as long as the rest of a
command's imports; it is the oracle of the tests.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float


def recursive(b: tuple[float, ...], a: tuple[float, ...], x: Float[Array, "N k"]) -> Float[Array, "N k"]:
    r"""Samples behind a rational filter that gives back a constant, and had the first of them for all time before.

    .. math:: y_n = \sum_i b_i x_{n-i} - \sum_{i>0} a_i y_{n-i}, \qquad \sum_i b_i = \sum_i a_i

    Args:
        b: Numerator in powers of 1/z.
        a: Denominator in powers of 1/z; the first is 1.
        x: Samples, one series a column.
    """
    from scipy.linalg import get_lapack_funcs

    beyond = x - x[0]
    driven = b[0] * beyond
    for lag in range(1, min(len(b), len(x))):
        driven[lag:] += b[lag] * beyond[:-lag]
    # The recursion is a triangular system of a few diagonals.
    diagonals = np.tile(np.array(a)[:, None], (1, len(x)))
    (solve,) = get_lapack_funcs(("tbtrs",), (driven,))
    y, _ = solve(diagonals, np.asfortranarray(driven), uplo="L", diag="U")
    return x[0] + y


def low_passed(x: Array, cutoff_hz: float, rate_hz: float, *, order: int, padding: int | None = None) -> Array:
    """Samples without what lies above a frequency, without delay: a Butterworth filter forwards and backwards.

    Its gain at ``cutoff_hz`` is a half. Before the first and after the last sample the series goes on as its own image
    in the point of its end, as in `scipy.signal.sosfiltfilt`.

    Args:
        x: Samples at a uniform rate, shape ``(N,)``, or ``(N, k)`` of one series a column.
        cutoff_hz: Below half of ``rate_hz``.
        rate_hz: Samples per second.
        order: Order of the filter that is used twice; even.
        padding: Samples of the image, fewer than ``N``; by default three for each coefficient.
    """
    columns = np.asarray(x, dtype=float).reshape(len(x), -1)
    ends = min(3 * (order + 1) if padding is None else padding, len(x) - 1)
    first, last = columns[0], columns[-1]
    y = np.concatenate([2 * first - columns[ends:0:-1], columns, 2 * last - columns[-2 : -ends - 2 : -1]])
    for _ in range(2):
        for b, a in _butterworth(order, cutoff_hz / rate_hz):
            y = recursive(b, a, y)
        y = y[::-1]
    return y[ends : len(y) - ends].reshape(np.shape(x))


def _butterworth(order: int, cutoff: float) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Sections of second order of a Butterworth low pass, from its bilinear transform; ``cutoff`` in samples' rates."""
    w = np.tan(np.pi * cutoff)
    sections = []
    for k in range(order // 2):
        damping = 2 * w * np.sin((2 * k + 1) * np.pi / (2 * order))
        scale = 1 + damping + w * w
        gain = w * w / scale
        sections.append(((gain, 2 * gain, gain), (1.0, 2 * (w * w - 1) / scale, (1 - damping + w * w) / scale)))
    return sections


def lagging(x: Float[Array, " N"], dt: float, time_constant: float) -> Float[Array, " N"]:
    """Samples behind a first-order lag of held inputs; the lag is at rest at the start."""
    step = float(-np.expm1(-dt / time_constant))
    return recursive((step,), (1.0, step - 1.0), x[:, None])[:, 0]


def low_pass_kernel(half: int, cutoff_hz: float, rate_hz: float) -> Float[Array, " 2*half+1"]:
    """Symmetric low pass of ``2 * half + 1`` samples: a windowed sinc (Hamming) that gives back a constant."""
    kernel = np.sinc(2 * cutoff_hz / rate_hz * np.arange(-half, half + 1)) * np.hamming(2 * half + 1)
    return kernel / kernel.sum()
