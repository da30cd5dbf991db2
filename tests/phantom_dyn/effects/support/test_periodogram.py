"""Power of an order in a residual over position. Oracle: least squares on the samples themselves."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.effects.support.cogging_orders import _background_power, _periodogram, _power, _prominence


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


def test_the_periodogram_is_the_power_of_its_orders_where_positions_lie_on_its_bins(rng):
    # Up to order 10 bins are 2 pi / 80 wide, from the first position on.
    q = 0.7 + 2 * np.pi / 80 * (rng.integers(0, 60, 900) + 1e-9)
    q[0] = 0.7
    rest = np.sin(9.0 * q + 0.4) + rng.normal(size=900)
    orders, power = _periodogram(q, rest, 1.6, 10.0)
    np.testing.assert_allclose(power[:-1], [taken_out(q, rest, n) for n in orders[:-1]], rtol=1e-6)


def test_the_periodogram_of_weighted_waves_is_what_these_take_out_beside_the_weight(uneven, rng):
    # Oracle: least squares on the weight and the weighted waves; bins as above.
    q, rest = uneven
    weight = rng.normal(size=len(q)) + 0.5
    orders, power = _periodogram(q, weight * rest, 1.6, 20.0, weight)
    columns = [np.column_stack([weight, weight * np.sin(n * q), weight * np.cos(n * q)]) for n in orders[::7]]

    def left(x: np.ndarray) -> float:
        return float(np.sum((weight * rest - x @ np.linalg.lstsq(x, weight * rest, rcond=None)[0]) ** 2))

    exact = np.array([left(x[:, :1]) - left(x) for x in columns])
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


@pytest.mark.parametrize(
    ("low", "orders"), [(1.3, np.arange(7, 51) / 5), (1.4, np.arange(7, 51) / 5), (0.01, np.arange(1, 51) / 5)]
)
def test_orders_are_the_multiples_of_a_quarter_of_what_the_range_resolves(low, orders):
    # By hand: up to order 10 a bin is 2 pi / 80 wide; 100 bins resolve 2 pi / (100 bins) = 0.8, four points each 0.2.
    q = np.linspace(0.0, 99.5 * 2 * np.pi / 80, 500)
    np.testing.assert_allclose(_periodogram(q, np.sin(3 * q), low - 1e-9, 10.0)[0], orders)


def test_a_range_of_few_bins_has_four_orders():
    # By hand: four bins of an eighth of a period are seen as 32, of which 4 are the highest order, 8.
    q = np.linspace(0.0, 3.5 * 2 * np.pi / 64, 50)
    np.testing.assert_allclose(_periodogram(q, np.sin(3 * q), 0.1, 8.0)[0], [2.0, 4.0, 6.0, 8.0])


def test_where_the_lowest_order_is_above_the_highest_that_one_is_left():
    q = np.linspace(0.0, 3.5 * 2 * np.pi / 64, 50)
    np.testing.assert_allclose(_periodogram(q, np.sin(3 * q), 30.0, 8.0)[0], [8.0])


def test_the_power_of_an_order_does_not_see_a_constant(uneven):
    q, rest = uneven
    np.testing.assert_allclose(_periodogram(q, rest + 7.0, 1.6, 20.0)[1], _periodogram(q, rest, 1.6, 20.0)[1])


def test_positions_on_two_levels_have_a_finite_power():
    # Two levels tell one number beside their mean: sine and cosine are the same there.
    wave, once, twice = (np.array([20.0 * (1 - 1j)]), np.array([20.0 * (1 - 1j)]), np.array([20.0 * (1 + 1) + 0j]))
    assert np.isfinite(_power(wave, once, twice, 40)).all()


@pytest.mark.parametrize("rising", [True, False])
def test_the_background_is_the_median_of_sixty_neighbours_on_either_side(rising):
    # Closed form: a step reaches the median of 121 where 61 of them lie behind it, that is at the step itself.
    step = np.where(np.arange(400) >= 200, 5.0, 1.0)
    step = step if rising else step[::-1].copy()
    np.testing.assert_array_equal(_background_power(step), step)


def test_prominence_is_power_over_that_of_the_neighbours():
    # By hand: neighbours of 2, a line of 60, and one of 1, which is less than a thousandth of 2000.
    power = np.full(500, 2.0)
    power[[100, 300]] = 60.0, 1.0
    expected = np.ones(500)
    expected[100], expected[300] = 30.0, 0.5
    np.testing.assert_allclose(_prominence(power, 900.0), expected)
    expected[300] = 0.0
    np.testing.assert_allclose(_prominence(power, 1500.0), expected)


def test_an_order_stands_out_by_a_thousand_medians_at_most():
    # By hand: without any power beside it a line of 5 is held against a thousandth of the median of all, 1.
    power = np.concatenate([np.zeros(150), np.ones(250)])
    power[50] = 5.0
    assert _prominence(power, 0.0)[50] == pytest.approx(5000.0)
    assert _prominence(np.zeros(300), 0.0).max() == 0.0
