"""Torques that are waves over the position of a joint: their numbers, their columns, and where no recording shows them.

The numbers are all orders, then all amplitudes, then all phases; an order counts periods in one turn of the joint, in
rad/m on a linear one. Cogging and ripple share them; see `cogging_orders` for how orders are found.
"""

from __future__ import annotations

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

_TURNS = 5  # periods on the whole way of a joint, forth and back
_SLOW_TURNS = 3  # of these where the joint is so slow that the wave lies in the judged band
_TRIED = 60  # orders between the lowest and the highest, to find the slowest that turns often enough
_SECONDS = 0.01  # the residual is averaged over this long
_RATE_SHARE = 0.2  # the wave is at most this share of the sampling rate at speed
_MOST = 12  # a bound on the work; what stands out, and then the held-out data, say how many there are
_BINS = 8  # per period of the highest order
_MOST_BINS = 2**16
_LINES = 4  # points of the periodogram per resolved order
_BACKGROUND = 30  # resolved orders over which the background is taken
_SIGNIFICANT = 15.0  # power over background; for noise it exceeds 9 about once in ten thousand orders
_LEAST_POWER = 0.001  # of the first order's, 3 % of its amplitude: less is what the reading's own error leaves
_SAMPLES = 8000  # enough to place an order
_DEPENDENT = (
    1e-12  # relative to the largest: of products of columns that depend on each other nothing but rounding is left
)
_LOSS = 0.01  # share of what an order explains that a whole number may leave


def order_range(operation: Operation, row: int) -> tuple[float, float]:
    """Lowest and highest order to look for: a period over the range, a fifth of the sampling rate at speed.

    A wave that the averaging takes out even in the slowest quarter of the recording is not looked for either, nor one
    that is above the judged band in the slowest eighth: among so many orders some stand out by chance. Where the joint
    does not move, the lowest is above the highest.
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
    """True if a wave turns five times, some of them where a joint is slow enough for it to lie in the judged band.

    What turns less often cannot be separated from what happens a few times; that it comes back in enough of the
    recording is for the gates to say.
    """
    way = np.abs(np.diff(operation.q[:, row]))
    slow = order * np.abs(operation.v[1:, row]) <= 2 * np.pi * operation.band_hz
    turns, slow_turns = (float(order * part.sum() / (2 * np.pi)) for part in (way, way[slow]))
    return turns >= _TURNS and slow_turns >= _SLOW_TURNS


def slowest_order(operation: Operation, row: int) -> float | None:
    """The lowest order that may be looked for and turns often enough in the judged band; None if there is none."""
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
    """Sets of orders to try for the residual torque of a joint, from the recording.

    The first holds the order that stands out most from its neighbours; the next ones add what stands out most once
    those before are taken out, if it is significant. The last one holds the order with most power, if it is another:
    a slow one has no neighbours to stand out from. A whole number is taken where it explains as much, if
    ``whole_numbers`` are to be expected.

    Args:
        operation: The recording.
        row: The joint.
        whole_numbers: True if orders are likely to be whole.
        load: What the waves are multiplied by, shape ``(N,)``: then even the first order has to be significant. None:
            nothing, and there is always a first order.
    """
    low, high = order_range(operation, row)
    if low >= high:
        return ()
    step = _stride(operation.dt, len(operation.t))
    torque = moving_average(operation.residual[:, row], operation.dt, _SECONDS)[::step]
    # Of size one, as the columns beside.
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
    """Every which sample places an order: two in the time that is averaged over, and no more than are enough."""
    return max(int(0.5 * _SECONDS / dt), -(-samples // _SAMPLES))


def _background(operation: Operation, row: int, low: float) -> Float[Array, "N k"]:
    """What else the residual may hold: an offset, friction, a spring, a scale of the torque, an inertia, gravity."""
    q, v = operation.q[:, row], operation.v[:, row]
    columns = [np.ones(len(q)), v, np.sign(v), q - q.mean(), operation.a[:, row], operation.tau[:, row]]
    # Over less than a revolution, no order looked for is as slow as gravity.
    return np.column_stack([*columns, np.sin(q), np.cos(q)] if low > 1.5 else columns)


@dataclass(frozen=True)
class _Residual:
    """Residual torque over position, what else it may hold, the order that its range resolves, the load of waves."""

    q: Float[Array, " N"]
    plain: Float[Array, "N k"]
    torque: Float[Array, " N"]
    resolution: float
    weight: Float[Array, " N"] | None = None

    def without(self, orders: tuple[float, ...]) -> Float[Array, " N"]:
        """Residual after a least squares fit of background and orders."""
        columns = self._columns(orders)
        gram = columns.T @ columns
        return self.torque - columns @ np.linalg.lstsq(gram, columns.T @ self.torque, rcond=_DEPENDENT)[0]

    def _columns(self, orders: tuple[float, ...]) -> Float[Array, "N k"]:
        """Background and waves, each of size one."""
        size = 1.0 if self.weight is None else self.weight
        waves = [size * wave(n * self.q) for n in orders for wave in (np.sin, np.cos)]
        columns = np.column_stack([self.plain, *waves])
        return columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)

    def misfit(self, orders: tuple[float, ...]) -> float:
        """Sum of squares of the residual."""
        left = self.without(orders)
        return float(left @ left)

    def _basis(self, orders: tuple[float, ...]) -> Float[Array, "N r"]:
        """Orthonormal columns that background and orders make."""
        columns = self._columns(orders)
        size, turned = np.linalg.eigh(columns.T @ columns)
        kept = size > _DEPENDENT * size[-1]
        return columns @ (turned[:, kept] / np.sqrt(size[kept]))

    def _misfit_beside(self, plain: Float[Array, "N r"], left: Float[Array, " N"], order: float) -> float:
        """Sum of squares of what one more order leaves of ``left``, which is orthogonal to ``plain``."""
        size = 1.0 if self.weight is None else self.weight
        waves = np.column_stack([size * np.sin(order * self.q), size * np.cos(order * self.q)])
        waves -= plain @ (plain.T @ waves)
        common = waves.T @ left
        return float(left @ left - common @ np.linalg.lstsq(waves.T @ waves, common, rcond=_DEPENDENT)[0])

    def placed(self, known: tuple[float, ...], peak: float, whole_numbers: bool) -> float:
        """The order near ``peak`` that leaves least beside those that are known; whole if that leaves no more."""
        reach = 0.5 * self.resolution
        plain = self._basis(known)
        left = self.torque - plain @ (plain.T @ self.torque)
        found = minimize_scalar(
            lambda n: self._misfit_beside(plain, left, n),
            bounds=(peak - reach, peak + reach),
            method="bounded",
            options={"xatol": 1e-4 * reach},
        )
        order = float(found.x)
        whole = float(round(order))
        if not whole_numbers or whole < 1 or abs(whole - order) > self.resolution:
            return order
        left = self.without((*known, order))
        least = float(left @ left)
        noise = 4.0 * least / _independent(left)
        explained = self.misfit(known) - least
        return whole if self.misfit((*known, whole)) - least < max(_LOSS * explained, noise) else order


def _independent(left: Float[Array, " N"]) -> float:
    """How many samples are independent of each other, by the correlation of neighbours; one at least."""
    memory = float(np.clip(left[1:] @ left[:-1] / max(float(left @ left), 1e-300), 0.0, 0.999))
    return max(len(left) * (1 - memory) / (1 + memory), 1.0)


def _periodogram(
    q: Float[Array, " N"],
    residual: Float[Array, " N"],
    low: float,
    high: float,
    weight: Float[Array, " N"] | None = None,
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """Orders between ``low`` and ``high``, and the squares that sine and cosine of each take out of the residual.

    With a ``weight`` waves and mean are multiplied by it.
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
    """Power of each order, from the sums of the residual's wave and of the plain wave at once and twice the order."""
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
    """Power of each order over that of its neighbours; zero where it is next to nothing beside ``most``.

    Beyond the ends neighbours repeat the last one, or all of them once more: one that is small by chance makes others
    near it stand out, unless all are repeated.
    """
    background = np.maximum(_background_power(power, edges), 1e-3 * np.median(power) + 1e-300)
    return np.where(power < _LEAST_POWER * most, 0.0, power / background)


def _background_power(
    power: Float[Array, " n"], edges: Literal["nearest", "reflect"] = "nearest"
) -> Float[Array, " n"]:
    """Median power of the neighbours of each order."""
    return ndimage.median_filter(power, 2 * (_BACKGROUND * _LINES // 2) + 1, mode=edges)


# Periods in a turn of the joint (rad/m of a linear one): more than a hundred pole pairs behind a gear of a thousand.
_MOST_TURNS = 1e5


def wave_parameters(robot: Robot, joint: str | None, amplitude: Parameter) -> tuple[Parameter, ...]:
    """Lists of equal length: order, the amplitude that is given, phase."""
    order = Parameter(
        "order",
        "rad/m" if robot.prismatic[row_of(robot, joint)] else "1",
        0.0,
        plausible=(0.0, _MOST_TURNS),
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
    """Orders, amplitudes and phases of given coefficients of sines and cosines."""
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
    """The same at one position, or at many, shape ``(N, 1)``; kernels compile it for one.

    Args:
        q: Position [rad or m].
        orders: Cycles per revolution (rad/m on a linear joint), shape ``(k,)``.
        amplitudes: Largest values, shape ``(k,)``.
        phases: Phases [rad], shape ``(k,)``.
    """
    return np.dot(np.sin(q * orders + phases), amplitudes)


def unseen_waves(operation: Operation, joint: str | None, name: str) -> str | None:
    """Why a recording shows no wave of a joint, in words; None where it may.

    Some wave has to turn five times, and three of them slowly enough for the judged band.

    Args:
        operation: The recording.
        joint: Its joint.
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
