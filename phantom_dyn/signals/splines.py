"""Splines through samples at a uniform rate, with the ends of not-a-knot: derivatives of motions, values in between.

`scipy.interpolate` has the same for any times; importing it loads its optimisers, sparse matrices and spatial trees,
which takes longer than a check of a recording does. It is the oracle of the tests.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from phantom_dyn.array_types import Array, Float

_DEGREE = 5
_REACH = 8  # samples from an end from which on all knots near a sample are samples
# Of a quintic spline at a sample, from its coefficients there and at the two neighbours on either side.
_VALUE = np.array([1.0, 26.0, 66.0, 26.0, 1.0]) / 120
_SLOPE = np.array([-1.0, -10.0, 0.0, 10.0, 1.0]) / 24
_BEND = np.array([1.0, 2.0, -6.0, 2.0, 1.0]) / 6


def quintic_derivatives(x: Float[Array, "N k"], rate_hz: float) -> tuple[Float[Array, "N k"], Float[Array, "N k"]]:
    """First and second derivative [per s, per s^2] of the quintic spline through samples, one series a column."""
    if len(x) < 2 * _REACH + 3:
        from scipy.interpolate import make_interp_spline

        t = np.arange(len(x)) / rate_hz
        spline = make_interp_spline(t, x, k=_DEGREE)
        return spline(t, 1), spline(t, 2)
    from scipy.linalg import get_lapack_funcs

    (solve,) = get_lapack_funcs(("gbsv",), (x,))
    _, _, coefficients, _ = solve(_DEGREE, _DEGREE, _diagonals(len(x)), x, overwrite_ab=True)
    slope, bend = (_at_samples(coefficients, inner, order) for inner, order in ((_SLOPE, 1), (_BEND, 2)))
    return slope * rate_hz, bend * rate_hz**2


def _diagonals(count: int) -> Float[Array, "16 N"]:
    """Values of all basis functions at all samples, as LAPACK stores a band with room for its factors."""
    band = np.zeros((3 * _DEGREE + 1, count))
    for offset, value in zip(range(-2, 3), _VALUE, strict=True):
        # Row i, column i + offset.
        band[2 * _DEGREE - offset, max(offset, 0) : count + min(offset, 0)] = value
    for row, values in enumerate(_at_start()[0]):
        for first, sign in ((0, 1), (count - 1, -1)):
            i = first + sign * row
            for j, value in enumerate(values):
                k = first + sign * j
                if abs(i - k) <= _DEGREE:
                    band[2 * _DEGREE + i - k, k] = value
    return band


def _at_samples(coefficients: Float[Array, "N k"], inner: Float[Array, " 5"], order: int) -> Float[Array, "N k"]:
    """A derivative at all samples, from the coefficients; ``inner`` is what it takes of them far from the ends."""
    count = len(coefficients)
    out = np.zeros(coefficients.shape)
    for offset, share in enumerate(inner):
        out[2:-2] += share * coefficients[offset : count - 4 + offset]
    ends = _at_start()[order]
    out[:_REACH] = ends @ coefficients[: ends.shape[1]]
    # Seen from the other end time runs backwards.
    out[: -_REACH - 1 : -1] = (-1) ** order * ends @ coefficients[: -ends.shape[1] - 1 : -1]
    return out


@cache
def _at_start() -> Float[Array, "3 8 c"]:
    """Basis functions and their first two derivatives at the first samples, one step apart."""
    knots = np.concatenate([np.zeros(_DEGREE + 1), np.arange(3.0, _REACH + _DEGREE + 4)])
    count = _REACH + 2
    out = np.zeros((3, _REACH, count))
    for sample in range(_REACH):
        # By degrees, from the intervals on; a derivative is a difference of basis functions one degree lower.
        basis = [np.where((knots[:-1] <= sample) & (sample < knots[1:]), 1.0, 0.0)]
        for degree in range(1, _DEGREE + 1):
            basis.append(_one_degree_more(basis[-1], knots, degree, sample))
        first = _derived(basis[_DEGREE - 1], knots, _DEGREE)
        second = _derived(_derived(basis[_DEGREE - 2], knots, _DEGREE - 1), knots, _DEGREE)
        for order, values in enumerate((basis[_DEGREE], first, second)):
            out[order, sample] = values[:count]
    return out


def _one_degree_more(lower: Array, knots: Array, degree: int, x: float) -> Array:
    """Basis functions of a degree at ``x`` from those of one degree less (Cox and de Boor)."""
    left, right = _inverse(knots[degree:-1] - knots[: -degree - 1]), _inverse(knots[degree + 1 :] - knots[1:-degree])
    return (x - knots[: -degree - 1]) * left * lower[:-1] + (knots[degree + 1 :] - x) * right * lower[1:]


def _derived(lower: Array, knots: Array, degree: int) -> Array:
    """Derivatives of basis functions of a degree from what one degree less has in their place."""
    left, right = _inverse(knots[degree:-1] - knots[: -degree - 1]), _inverse(knots[degree + 1 :] - knots[1:-degree])
    return degree * (left * lower[:-1] - right * lower[1:])


def _inverse(lengths: Array) -> Array:
    """One over each length, zero for none."""
    return np.where(lengths > 0, 1.0 / np.where(lengths > 0, lengths, 1.0), 0.0)


@dataclass(frozen=True)
class Cubic:
    """A cubic spline through samples at a uniform rate; before the first and behind the last its ends go on.

    Attributes:
        start: Time of the first sample [s].
        step: From one sample to the next [s].
        x: Samples.
        slope: Its derivative at them, per step.
    """

    start: float
    step: float
    x: Float[Array, " N"]
    slope: Float[Array, " N"]

    @staticmethod
    def through(x: Float[Array, " N"], start: float, step: float) -> Cubic:
        """The spline through at least four samples."""
        from scipy.linalg import get_lapack_funcs

        (solve,) = get_lapack_funcs(("gtsv",), (x,))
        rise = np.diff(x)
        right = np.concatenate(
            [[(5 * rise[0] + rise[1]) / 2], 3 * (rise[1:] + rise[:-1]), [(5 * rise[-1] + rise[-2]) / 2]]
        )
        below, diagonal, above = np.ones(len(x) - 1), np.full(len(x), 4.0), np.ones(len(x) - 1)
        diagonal[[0, -1]], above[0], below[-1] = 1.0, 2.0, 2.0
        slope = solve(below, diagonal, above, right)[3]
        return Cubic(start, step, x, slope)

    def __call__(self, t: Array) -> Array:
        """Values at times [s]."""
        k, share, rise, first, last = self._pieces(t)
        return self.x[k] + share * (first + share * (3 * rise - 2 * first - last + share * (first + last - 2 * rise)))

    def derivative(self, t: Array) -> Array:
        """Derivative [per s] at times [s]."""
        _, share, rise, first, last = self._pieces(t)
        bend = 2 * (3 * rise - 2 * first - last) + 3 * share * (first + last - 2 * rise)
        return (first + share * bend) / self.step

    def _pieces(self, t: Array) -> tuple[Array, Array, Array, Array, Array]:
        """Piece of each time, how far it is in it, and the piece's rise and slopes."""
        at = (t - self.start) / self.step
        k = np.clip(np.floor(at).astype(int), 0, len(self.x) - 2)
        return k, at - k, self.x[k + 1] - self.x[k], self.slope[k], self.slope[k + 1]
