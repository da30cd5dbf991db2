"""Torque that is periodic in the joint position, for cogging and ripple: finds the orders of the waves in a residual.

The order of a wave is its number of periods in one turn of the joint, or in rad/m on a linear joint. The search for
orders is a periodogram of the residual torque over position. Parameters of an effect are all orders, then all
amplitudes, then all phases.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy import ndimage
from scipy.fft import next_fast_len
from scipy.optimize import minimize_scalar

from phantom_dyn.array_types import Array, Float
from phantom_dyn.effects.effect import Parameter
from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.rival import Shape
from phantom_dyn.effects.support.rows import moving_average, row_of
from phantom_dyn.model.robot import Robot

# Smallest number of periods that the joint passes in the recording, back and forth.
_PERIODS = 5
# Smallest number of these periods in which the joint is so slow that the wave is in the judged band.
_SLOW_PERIODS = 3
# Number of orders that are tried to find the lowest order with enough periods.
_TRIED = 60
# Time over which the residual is averaged [s].
_SECONDS = 0.01
# Highest frequency of a wave at high speed, as a share of the sampling rate.
_RATE_SHARE = 0.2
# Largest number of orders, to limit the work; significance and held-out data decide how many there are.
_MOST = 12
# Bins of position per period of the highest order.
_BINS = 8
_MOST_BINS = 2**16
# Points of the periodogram per resolved order.
_LINES = 4
# Resolved orders over which the median power is taken.
_BACKGROUND = 30
# Smallest power of a significant order, over the background; with noise only, one of ten thousand orders exceeds 9.
_SIGNIFICANT = 15.0
# Smallest power over that of the first order (3 % of its amplitude). Errors of the reading can cause smaller waves.
_LEAST_POWER = 0.001
# Number of samples that suffice to find an order.
_SAMPLES = 8000
# Eigenvalue of a Gram matrix, relative to the largest, below which its columns are dependent up to rounding.
_DEPENDENT = 1e-12
# Largest loss by rounding an order to a whole number, as a share of the sum of squares that the order explains.
_LOSS = 0.01


def order_range(operation: Operation, row: int) -> tuple[float, float]:
    """Lowest and highest order to search; the lowest is above the highest if the joint does not move.

    The lowest order has one period in the range of positions. The highest order is limited by the frequency of its
    wave: at high speed by a fifth of the sampling rate, in the slowest quarter of the recording by the averaging of the
    residual, in the slowest eighth by the judged band. With more orders, some would be significant by chance.
    """
    low, high = np.percentile(operation.q[:, row], [0.5, 99.5])
    slowest, slow, speed = (float(np.percentile(np.abs(operation.v[:, row]), share)) for share in (12.5, 25, 95))
    if high - low < 1e-6 or speed < 1e-9:
        return np.inf, 0.0
    finest = 2 * np.pi * _MOST_BINS / (_BINS * float(np.ptp(operation.q[:, row])))
    fastest = min(_RATE_SHARE / (operation.dt * speed), 0.5 / (_SECONDS * max(slow, 1e-9)))
    fastest = min(fastest, operation.band_hz / max(slowest, 1e-9))
    return 2 * np.pi / float(high - low), min(2 * np.pi * fastest, finest)


def comes_back(operation: Operation, row: int, order: float) -> bool:
    """True if the recording has five periods of a wave, in three of which its frequency is within the judged band.

    A wave with fewer periods cannot be separated from events that happen a few times.
    """
    path = np.abs(np.diff(operation.q[:, row]))
    slow = order * np.abs(operation.v[1:, row]) <= 2 * np.pi * operation.band_hz
    periods, slow_periods = (float(order * part.sum() / (2 * np.pi)) for part in (path, path[slow]))
    return periods >= _PERIODS and slow_periods >= _SLOW_PERIODS


def slowest_order(operation: Operation, row: int) -> float | None:
    """The lowest order of `order_range` with enough periods in the judged band; None if there is none."""
    low, high = order_range(operation, row)
    if low >= high:
        return None
    tried = np.geomspace(low, high, _TRIED)
    return next((float(order) for order in tried if comes_back(operation, row, float(order))), None)


def orders_in(
    operation: Operation,
    row: int,
    *,
    whole_numbers: bool,
    load: Float[Array, " N"] | None = None,
) -> tuple[tuple[float, ...], ...]:
    """Sets of orders to try for the residual torque of a joint.

    The first set has the order whose power is largest relative to that of its neighbours. Each further set adds the
    order for which this ratio is largest after a fit of the orders before, if it is significant. The last set has the
    order with the largest power, if it is another one: a low order may have no neighbours.

    Args:
        operation: The recording.
        row: Index of the joint.
        whole_numbers: True if orders are rounded to whole numbers that explain as much.
        load: Factor of the waves, shape ``(N,)``; then the first order has to be significant, too. None for waves that
            do not depend on the load; then there is always a first order.
    """
    low, high = order_range(operation, row)
    if low >= high:
        return ()
    step = _stride(operation.dt, len(operation.t))
    torque = moving_average(operation.residual[:, row], operation.dt, _SECONDS)[::step]
    # Normalised to a root mean square of about one, like the other columns.
    weight = None if load is None else load[::step] / max(float(np.sqrt(np.mean(load**2))), 1e-300)
    residual = _Residual(operation.q[::step, row], _background(operation, row, low)[::step], torque, low, weight)
    sets: list[tuple[float, ...]] = []
    orders: tuple[float, ...] = ()
    largest, most = 0.0, 0.0
    for _ in range(_MOST):
        n, power = _periodogram(residual.q, residual.without(orders), low, high, weight)
        prominence = _prominence(power, most, "nearest" if load is None else "reflect")
        peak = int(np.argmax(prominence))
        if load is not None and prominence[peak] < _SIGNIFICANT:
            break
        if not orders:
            largest, most = residual.placed((), float(n[np.argmax(power)]), whole_numbers), float(power[peak])
        elif prominence[peak] < _SIGNIFICANT:
            break
        found = residual.placed(orders, float(n[peak]), whole_numbers)
        if any(abs(found - other) < 0.5 * low for other in orders):
            break
        orders = (*orders, found)
        sets.append(orders)
    if sets and abs(largest - sets[0][0]) > 0.5 * low:
        sets.append((largest,))
    return tuple(sets)


def _stride(dt: float, samples: int) -> int:
    """Distance between two samples that are used: half the averaging time, and at most about `_SAMPLES` are used."""
    return max(int(0.5 * _SECONDS / dt), math.ceil(samples / _SAMPLES))


def _background(operation: Operation, row: int, low: float) -> Float[Array, "N k"]:
    """Columns of other causes of the residual: offset, friction, spring, inertia, torque constant, gravity."""
    q, v = operation.q[:, row], operation.v[:, row]
    columns = [np.ones(len(q)), v, np.sign(v), q - q.mean(), operation.a[:, row], operation.tau[:, row]]
    # Gravity has order one, which is searched only if the range is more than about a revolution.
    return np.column_stack([*columns, np.sin(q), np.cos(q)] if low > 1.5 else columns)


@dataclass(frozen=True)
class _Residual:
    """Residual torque of a joint over its position, with the columns that explain other parts of it.

    Attributes:
        q: Positions.
        plain: Columns of other causes.
        torque: Residual torque.
        resolution: Difference of two orders that the range of positions resolves.
        weight: Factor of the waves; None for one.
    """

    q: Float[Array, " N"]
    plain: Float[Array, "N k"]
    torque: Float[Array, " N"]
    resolution: float
    weight: Float[Array, " N"] | None = None

    def without(self, orders: tuple[float, ...]) -> Float[Array, " N"]:
        """Residual after a least-squares fit of other causes and waves of these orders."""
        columns = self._columns(orders)
        gram = columns.T @ columns
        return self.torque - columns @ np.linalg.lstsq(gram, columns.T @ self.torque, rcond=_DEPENDENT)[0]

    def _columns(self, orders: tuple[float, ...]) -> Float[Array, "N k"]:
        """Columns of other causes and waves, normalised to a root mean square of one."""
        size = 1.0 if self.weight is None else self.weight
        waves = [size * wave(n * self.q) for n in orders for wave in (np.sin, np.cos)]
        columns = np.column_stack([self.plain, *waves])
        return columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)

    def misfit(self, orders: tuple[float, ...]) -> float:
        """Sum of squares of the residual after a fit of other causes and waves of these orders."""
        residual = self.without(orders)
        return float(residual @ residual)

    def _basis(self, orders: tuple[float, ...]) -> Float[Array, "N r"]:
        """Orthonormal basis of the columns of other causes and waves of these orders."""
        columns = self._columns(orders)
        eigenvalues, vectors = np.linalg.eigh(columns.T @ columns)
        kept = eigenvalues > _DEPENDENT * eigenvalues[-1]
        return columns @ (vectors[:, kept] / np.sqrt(eigenvalues[kept]))

    def _misfit_beside(self, basis: Float[Array, "N r"], residual: Float[Array, " N"], order: float) -> float:
        """Sum of squares after a fit of one more order to ``residual``, which is orthogonal to ``basis``."""
        size = 1.0 if self.weight is None else self.weight
        waves = np.column_stack([size * np.sin(order * self.q), size * np.cos(order * self.q)])
        waves -= basis @ (basis.T @ waves)
        products = waves.T @ residual
        explained = products @ np.linalg.lstsq(waves.T @ waves, products, rcond=_DEPENDENT)[0]
        return float(residual @ residual - explained)

    def placed(self, known: tuple[float, ...], peak: float, whole_numbers: bool) -> float:
        """The order near ``peak`` that explains most in addition to the known ones.

        It is rounded to a whole number if ``whole_numbers`` is true and the rounding increases the sum of squares only
        within its noise, or by a small share of the explained sum of squares.
        """
        reach = 0.5 * self.resolution
        basis = self._basis(known)
        residual = self.torque - basis @ (basis.T @ self.torque)
        found = minimize_scalar(
            lambda n: self._misfit_beside(basis, residual, n),
            bounds=(peak - reach, peak + reach),
            method="bounded",
            options={"xatol": 1e-4 * reach},
        )
        order = float(found.x)
        whole = float(round(order))
        if not whole_numbers or whole < 1 or abs(whole - order) > self.resolution:
            return order
        residual = self.without((*known, order))
        least = float(residual @ residual)
        noise = 4.0 * least / _independent(residual)
        explained = self.misfit(known) - least
        return whole if self.misfit((*known, whole)) - least < max(_LOSS * explained, noise) else order


def _independent(residual: Float[Array, " N"]) -> float:
    """Number of independent samples, from the correlation of neighbours; at least one."""
    square = max(float(residual @ residual), 1e-300)
    correlation = float(np.clip(residual[1:] @ residual[:-1] / square, 0.0, 0.999))
    return max(len(residual) * (1 - correlation) / (1 + correlation), 1.0)


def _periodogram(
    q: Float[Array, " N"],
    residual: Float[Array, " N"],
    low: float,
    high: float,
    weight: Float[Array, " N"] | None = None,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Orders from ``low`` to ``high``, and for each the decrease of the residual's sum of squares by a fit of its wave.

    The residual is put into bins of position, so that a Fourier transform gives the fits of all orders at once. The fit
    has a wave and a constant, both multiplied by ``weight`` if it is given.
    """
    width = 2 * np.pi / (_BINS * high)
    bins = ((q - q.min()) / width).astype(int)
    length = int(next_fast_len(max(_LINES * (int(bins.max()) + 1), 4 * _BINS), real=True))  # type: ignore[arg-type]
    weight = np.ones(len(q)) if weight is None else weight
    square = weight**2
    centred = weight * residual - square * (float(weight @ residual) / float(square.sum()))
    wave = np.fft.rfft(np.bincount(bins, centred, length), length)
    count = np.fft.rfft(np.bincount(bins, square, length), length)
    last = length // _BINS
    k = np.arange(min(max(1, int(np.ceil(low * length * width / (2 * np.pi)))), last), last + 1)
    return 2 * np.pi * k / (length * width), _power(wave[k], count[k], count[2 * k], float(square.sum()))


def _power(wave: Array, once: Array, twice: Array, samples: float) -> Float[Array, " n"]:
    """Power of each order: the decrease of the sum of squares by a fit of sine and cosine (2x2 normal equations).

    Args:
        wave: Fourier sums of the residual at each order.
        once: Fourier sums of the squared weights at each order.
        twice: Fourier sums of the squared weights at twice each order.
        samples: Sum of the squared weights.
    """
    c, s = np.real(once), -np.imag(once)
    cc = 0.5 * (samples + np.real(twice)) - c * c / samples
    ss = 0.5 * (samples - np.real(twice)) - s * s / samples
    cs = -0.5 * np.imag(twice) - c * s / samples
    y_c, y_s = np.real(wave), -np.imag(wave)
    area = np.maximum(cc * ss - cs * cs, 1e-6 * samples**2)
    return (y_c**2 * ss - 2 * y_c * y_s * cs + y_s**2 * cc) / area


def _prominence(
    power: Float[Array, " n"], most: float, edges: Literal["nearest", "reflect"] = "nearest"
) -> Float[Array, " n"]:
    """Power of each order over the median power of its neighbours; zero if it is negligible relative to ``most``.

    Beyond the ends, the median filter repeats the end value (``nearest``) or mirrors the orders (``reflect``). The
    second avoids that a first value which is small by chance lowers the median of its neighbours.
    """
    background = np.maximum(_background_power(power, edges), 1e-3 * np.median(power) + 1e-300)
    return np.where(power < _LEAST_POWER * most, 0.0, power / background)


def _background_power(
    power: Float[Array, " n"], edges: Literal["nearest", "reflect"] = "nearest"
) -> Float[Array, " n"]:
    """Median power of the neighbours of each order."""
    return ndimage.median_filter(power, 2 * (_BACKGROUND * _LINES // 2) + 1, mode=edges)


# Largest plausible order: that of a hundred pole pairs behind a gear of a thousand.
_HIGHEST_ORDER = 1e5


def wave_parameters(robot: Robot, joint: str | None, amplitude: Parameter) -> tuple[Parameter, ...]:
    """Parameters of waves, lists of equal length: order, the given amplitude, phase."""
    order = Parameter(
        "order",
        "rad/m" if robot.prismatic[row_of(robot, joint)] else "1",
        0.0,
        plausible=(0.0, _HIGHEST_ORDER),
        plausible_because="slots, poles and teeth times a gear ratio are fewer",
        listed=True,
    )
    phase = Parameter(
        "phase",
        "rad",
        -np.pi,
        np.pi,
        plausible=(-np.pi, np.pi),
        plausible_because="a wave may begin anywhere",
        listed=True,
    )
    return order, replace(amplitude, listed=True), phase


def sines_and_cosines(q: Float[Array, " N"], orders: Shape) -> tuple[Float[Array, "N m"], tuple[str, ...]]:
    """Sine and cosine of every order at positions, and their names."""
    waves = np.stack([wave(n * q) for n in orders for wave in (np.sin, np.cos)], axis=-1)
    return waves, tuple(f"{wave}_{k + 1}" for k in range(len(orders)) for wave in ("sine", "cosine"))


def wave_numbers(coefficients: Array, orders: Shape) -> Array:
    """Orders, amplitudes and phases from the coefficients of sines and cosines."""
    sine, cosine = coefficients[0::2], coefficients[1::2]
    return np.concatenate([orders, np.hypot(sine, cosine), np.arctan2(cosine, sine)])


def each_wave(theta: Array) -> list[tuple[float, float, float]]:
    """Order, amplitude and phase of each wave."""
    return [(float(n), float(a), float(p)) for n, a, p in np.reshape(np.asarray(theta, dtype=float), (3, -1)).T]


def waves_at(q: Float[Array, " N"], theta: Array) -> Float[Array, " N"]:
    """Sum of all waves at positions [rad or m]."""
    orders, amplitudes, phases = np.split(np.asarray(theta, dtype=float), 3)
    return sum_of_waves(q[:, None], orders, amplitudes, phases)


def sum_of_waves(q, orders, amplitudes, phases):
    """Sum of all waves at one position, or at many, shape ``(N, 1)``; simulations compile it for one.

    Args:
        q: Position [rad or m].
        orders: Cycles per revolution (rad/m on a linear joint), shape ``(k,)``.
        amplitudes: Largest values, shape ``(k,)``.
        phases: Phases [rad], shape ``(k,)``.
    """
    return np.dot(np.sin(q * orders + phases), amplitudes)


def unseen_waves(operation: Operation, joint: str | None, name: str) -> str | None:
    """Reason in words why a recording cannot show any wave of a joint; None if it can.

    A wave needs five periods in the recording, and in three of them a frequency within the judged band.

    Args:
        operation: The recording.
        joint: Name of the joint.
        name: Name of the effect in words.
    """
    row = row_of(operation.robot, joint)
    low, high = order_range(operation, row)
    if low >= high:
        return f"{joint} travels less than one period of any {name} that its sampling rate can show"
    if slowest_order(operation, row) is None:
        return (
            f"no {name} of {joint} turns five times, three of them where the joint is slow enough for it to lie in the "
            "judged band"
        )
    return None
