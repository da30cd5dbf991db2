"""Recursive filters: low passes with delay, or without delay (forwards and backwards).

`scipy.signal` has the same filters, and tests compare with it. It is not used here, because its import loads all of
`scipy.stats` and takes half a second, as long as all other imports of a command.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float


def recursive_filter(b: tuple[float, ...], a: tuple[float, ...], x: Float[Array, "N k"]) -> Float[Array, "N k"]:
    r"""Output of a recursive filter with unit gain at zero frequency.

    Before the first sample the input is assumed to be constant.

    .. math:: y_n = \sum_i b_i x_{n-i} - \sum_{i>0} a_i y_{n-i}, \qquad \sum_i b_i = \sum_i a_i

    Args:
        b: Numerator in powers of 1/z.
        a: Denominator in powers of 1/z; its first coefficient is 1.
        x: Samples, one series in each column.
    """
    from scipy.linalg import get_lapack_funcs

    change = x - x[0]
    driven = b[0] * change
    for lag in range(1, min(len(b), len(x))):
        driven[lag:] += b[lag] * change[:-lag]
    # The recursion is a triangular system of equations with a few diagonals.
    diagonals = np.tile(np.array(a)[:, None], (1, len(x)))
    (solve,) = get_lapack_funcs(("tbtrs",), (driven,))
    y, _ = solve(diagonals, np.asfortranarray(driven), uplo="L", diag="U")
    return x[0] + y


def low_passed(x: Array, cutoff_hz: float, rate_hz: float, *, order: int, padding: int | None = None) -> Array:
    """Low-passed samples without delay: a Butterworth filter that is applied forwards and backwards.

    Its gain at ``cutoff_hz`` is a half. At both ends the series is extended by its point reflection about the end
    sample (odd extension), as in `scipy.signal.sosfiltfilt`.

    Args:
        x: Samples at a uniform rate, shape ``(N,)``, or ``(N, k)`` with one series in each column.
        cutoff_hz: Cut-off frequency [Hz], below half of ``rate_hz``.
        rate_hz: Samples per second.
        order: Order of the filter, which is applied twice; even.
        padding: Number of samples of the extension at each end, fewer than ``N``; by default ``3 * (order + 1)``.
    """
    columns = np.asarray(x, dtype=float).reshape(len(x), -1)
    ends = min(3 * (order + 1) if padding is None else padding, len(x) - 1)
    first, last = columns[0], columns[-1]
    y = np.concatenate([2 * first - columns[ends:0:-1], columns, 2 * last - columns[-2 : -ends - 2 : -1]])
    for _ in range(2):
        for b, a in _butterworth(order, cutoff_hz / rate_hz):
            y = recursive_filter(b, a, y)
        y = y[::-1]
    return y[ends : len(y) - ends].reshape(np.shape(x))


def _butterworth(order: int, cutoff: float) -> list[tuple[tuple[float, ...], tuple[float, ...]]]:
    """Second-order sections of a Butterworth low pass by bilinear transform; ``cutoff`` as a share of the rate."""
    w = np.tan(np.pi * cutoff)
    sections = []
    for k in range(order // 2):
        damping = 2 * w * np.sin((2 * k + 1) * np.pi / (2 * order))
        scale = 1 + damping + w * w
        gain = w * w / scale
        sections.append(((gain, 2 * gain, gain), (1.0, 2 * (w * w - 1) / scale, (1 - damping + w * w) / scale)))
    return sections


def lagging(x: Float[Array, " N"], dt: float, time_constant: float) -> Float[Array, " N"]:
    """Output of a first-order lag whose input is constant between samples; it starts in the steady state."""
    step = float(-np.expm1(-dt / time_constant))
    return recursive_filter((step,), (1.0, step - 1.0), x[:, None])[:, 0]


def lagging_linear(x: Float[Array, " N"], dt: float, time_constant: float) -> Float[Array, " N"]:
    """Output of a first-order lag whose input is linear between samples; it starts in the steady state."""
    if time_constant <= 0:
        return x
    steps = dt / time_constant
    decay = np.exp(-steps)
    old, new = (1.0 - decay) / steps - decay, 1.0 - (1.0 - decay) / steps
    return recursive_filter((new, old), (1.0, -decay), x[:, None])[:, 0]


def low_pass_kernel(half: int, cutoff_hz: float, rate_hz: float) -> Float[Array, " 2*half+1"]:
    """Symmetric low pass with ``2 * half + 1`` coefficients: a sinc with a Hamming window, unit gain at 0 Hz."""
    kernel = np.sinc(2 * cutoff_hz / rate_hz * np.arange(-half, half + 1)) * np.hamming(2 * half + 1)
    return kernel / kernel.sum()
