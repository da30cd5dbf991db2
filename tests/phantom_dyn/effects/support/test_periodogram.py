"""Power of an order in a residual over position. Oracle: least squares on the samples themselves."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.support.cogging_orders import _periodogram, _power


def taken_out(q: np.ndarray, rest: np.ndarray, n: float) -> float:
    """Squares that a sine and a cosine take out of the residual beside its mean, by least squares."""
    mean = np.ones((len(q), 1))
    waves = np.column_stack([mean, np.sin(n * q), np.cos(n * q)])
    left = [np.sum((rest - x @ np.linalg.lstsq(x, rest, rcond=None)[0]) ** 2) for x in (mean, waves)]
    return float(left[0] - left[1])


@pytest.fixture
def uneven(rng) -> tuple[np.ndarray, np.ndarray]:
    """Positions that gather at the ends of a swing over four radians, and a residual with a wave of order 9."""
    q = 2.0 * np.sin(rng.uniform(-1.5, 1.5, 3000)) + 0.3
    return q, 0.5 + 0.2 * np.sin(9.0 * q + 0.4) + 0.1 * rng.normal(size=3000)


@pytest.mark.parametrize("n", [1.3, 2.0, 9.0, 17.5])
def test_the_power_of_an_order_is_what_its_waves_take_out(uneven, n):
    q, rest = uneven
    wave = np.array([np.sum((rest - rest.mean()) * np.exp(-1j * n * q))])
    once, twice = (np.array([np.sum(np.exp(-1j * k * n * q))]) for k in (1, 2))
    assert _power(wave, once, twice, len(q))[0] == pytest.approx(taken_out(q, rest, n), rel=1e-9)


def test_the_periodogram_is_the_power_of_its_orders_up_to_the_width_of_a_bin(uneven):
    # A bin is an eighth of the shortest period: gathering takes 2.5 % off that wave's power, less off slow ones.
    q, rest = uneven
    orders, power = _periodogram(q, rest, 1.6, 20.0)
    exact = np.array([taken_out(q, rest, n) for n in orders[::7]])
    np.testing.assert_allclose(power[::7], exact, atol=0.06 * exact.max())


def test_the_periodogram_peaks_at_the_order_of_the_wave(uneven):
    orders, power = _periodogram(*uneven, 1.6, 20.0)
    assert orders[np.argmax(power)] == pytest.approx(9.0, abs=0.2)


def test_the_periodogram_covers_the_orders_that_are_asked_for_finely_enough(uneven):
    # A range of four radians resolves 2 pi / 4; four points an order are asked for.
    orders, _ = _periodogram(*uneven, 1.6, 20.0)
    steps = np.diff(orders)
    np.testing.assert_allclose(steps, steps[0])
    assert steps[0] <= 2.0 * np.pi / np.ptp(uneven[0]) / 4.0
    assert abs(orders[0] - 1.6) <= steps[0]
    assert abs(orders[-1] - 20.0) <= 2.0 * steps[0]
