"""Orders of waves over a joint's position, and their periodogram."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from phantom_dyn.effects.operation import Operation
from phantom_dyn.effects.support.position_waves import (
    _background,
    _background_power,
    _independent,
    _periodogram,
    _power,
    _prominence,
    _Residual,
    _stride,
    comes_back,
    order_range,
    orders_in,
    slowest_order,
)
from phantom_dyn.motion import Motion


def turning(arm, q: np.ndarray, v: np.ndarray, dt: float, residual: np.ndarray | None = None) -> Operation:
    """``tilt`` along given positions and speeds, with what the last fit has left on it."""
    states = np.zeros((3, len(q), 3))
    states[0, :, 1], states[1, :, 1] = q, v
    operation = Operation.of(arm, Motion(dt * np.arange(len(q)), *states))
    left = np.zeros_like(operation.q)
    left[:, 1] = 0.0 if residual is None else residual
    return operation.after_fit(operation.expected, left)


def test_orders_begin_with_one_period_over_99_per_cent_of_the_positions(arm):
    # Closed form: of a ramp over three radians 0.5 % are left out at either end.
    q = np.linspace(0.0, 3.0, 2001)
    assert order_range(turning(arm, q, np.full(2001, 3.0 / 20.0), 0.01), 1)[0] == pytest.approx(2 * np.pi / 2.97)


def test_orders_end_at_a_fifth_of_the_sampling_rate_at_the_speed_of_the_fastest_twentieth(arm):
    # Closed form: speeds from 0 to 4 rad/s alike, 3.8 at 95 %: 20 periods a second at 100 Hz.
    v = np.linspace(-4.0, 4.0, 2001)
    assert order_range(turning(arm, np.linspace(0.0, 3.0, 2001), v, 0.01), 1)[1] == pytest.approx(
        2 * np.pi * 20.0 / 3.8, rel=1e-3
    )


def test_orders_end_where_ten_milliseconds_average_a_wave_out_in_the_slowest_quarter(arm):
    # Closed form: 1 rad/s at 25 %, 50 periods a second; at 1 kHz a fifth of the rate at 3.8 rad/s is above that.
    v = np.linspace(-4.0, 4.0, 4001)
    assert order_range(turning(arm, np.linspace(0.0, 3.0, 4001), v, 0.001), 1)[1] == pytest.approx(
        2 * np.pi * 50.0, rel=1e-3
    )


def test_orders_end_at_eight_bins_a_period_of_65536_over_the_whole_range(arm):
    # Closed form: over 500 rad that is order 2 pi 8192 / 500; a fifth of 100 Hz at 1 rad/s would be 2 pi 20.
    q = np.linspace(0.0, 500.0, 50_001)
    assert order_range(turning(arm, q, np.ones(50_001), 0.01), 1)[1] == pytest.approx(2 * np.pi * 8192 / 500.0)


@pytest.mark.parametrize(
    ("q", "v"),
    [(np.linspace(0, 1e-7, 50), np.ones(50)), (np.linspace(0, 1, 50), np.full(50, 1e-10)), (np.ones(1), np.ones(1))],
    ids=["no way", "no speed", "one sample"],
)
def test_a_joint_that_does_not_move_has_its_lowest_order_above_the_highest(arm, q, v):
    assert order_range(turning(arm, q, v, 0.01), 1) == (np.inf, 0.0)


@pytest.mark.parametrize(
    ("dt", "samples", "step"),
    [(0.004, 5000, 1), (0.001, 5000, 5), (0.002, 5000, 2), (0.02, 50, 1), (0.004, 16_000, 2), (0.004, 16_001, 3)],
)
def test_every_sample_counts_down_to_two_in_ten_milliseconds_and_eight_thousand_in_all(dt, samples, step):
    assert _stride(dt, samples) == step


def test_offset_friction_spring_scale_and_inertia_are_no_waves(arm):
    q, v = np.linspace(-1.0, 2.0, 31), np.linspace(-1.0, 1.0, 31)
    operation = turning(arm, q, v, 0.01)
    expected = [np.ones(31), v, np.sign(v), q - 0.5, 0 * q, operation.tau[:, 1]]
    np.testing.assert_allclose(_background(operation, 1, 1.5), np.column_stack(expected), atol=1e-12)


def test_over_less_than_a_revolution_gravity_is_no_wave_either(arm):
    q = np.linspace(-1.0, 2.0, 31)
    columns = _background(turning(arm, q, np.ones(31), 0.01), 1, 1.6)
    np.testing.assert_allclose(columns[:, 6:], np.column_stack([np.sin(q), np.cos(q)]))


@pytest.fixture
def waved(rng) -> _Residual:
    """A wave of order 15.4 and amplitude 0.02, one of order 40, an offset, and noise of 0.002."""
    q = np.linspace(-1.0, 2.0, 1500) + 0.3 * rng.random(1500)
    torque = 0.02 * np.sin(15.4 * q) + 0.01 * np.cos(40.0 * q) + 0.3 + 0.002 * rng.normal(size=1500)
    return _Residual(q, np.column_stack([np.ones(1500), 1e4 * q]), torque, 2.0)


def test_what_waves_leave_is_what_least_squares_leave(waved):
    # NumPy on the columns as they are.
    q = waved.q
    columns = np.column_stack([waved.plain, *(wave(n * q) for n in (15.0, 40.0) for wave in (np.sin, np.cos))])
    left = waved.torque - columns @ np.linalg.lstsq(columns, waved.torque, rcond=None)[0]
    np.testing.assert_allclose(waved.without((15.0, 40.0)), left, atol=1e-8)
    assert waved.misfit((15.0, 40.0)) == pytest.approx(left @ left)


def test_an_order_is_placed_beside_those_that_are_known(waved):
    # Known truth: 15.4, sought from a point of the periodogram half an order off.
    assert waved.placed((40.0,), 15.9, False) == pytest.approx(15.4, abs=0.01)
    assert waved.placed((40.0,), 14.9, True) == pytest.approx(15.4, abs=0.01)


def test_an_order_is_placed_within_half_of_what_the_range_resolves(waved):
    assert waved.placed((40.0,), 17.9, False) > 16.9
    assert waved.placed((40.0,), 16.3, False) == pytest.approx(15.4, abs=0.01)


def test_an_order_is_a_whole_number_where_that_explains_as_much(waved):
    # Known truth: 40; the free estimate scatters about it.
    assert waved.placed((15.4,), 40.3, True) == 40.0
    free = waved.placed((15.4,), 40.3, False)
    assert free != 40.0
    assert free == pytest.approx(40.0, abs=0.05)


@pytest.mark.parametrize(("order", "whole"), [(7.02, True), (7.2, False)])
def test_a_whole_number_may_leave_a_hundredth_of_what_the_order_explains(order, whole):
    # Closed form without noise: an order off by d over a range L leaves (d L)^2 / 12 of a wave whose phase is fitted:
    # 0.0012 and 0.12 at L = 6 (the amplitude is fitted too, which changes little).
    q = np.linspace(0.0, 6.0, 4000)
    residual = _Residual(q, np.ones((4000, 1)), np.sin(order * q), 1.0)
    assert (residual.placed((), order, True) == 7.0) is whole


def test_no_order_is_zero():
    q = np.linspace(0.0, 6.0, 4000)
    residual = _Residual(q, np.ones((4000, 1)), np.sin(0.49 * q), 1.0)
    assert residual.placed((), 0.49, True) == pytest.approx(0.49, abs=1e-3)


def test_noise_decides_less_where_its_neighbours_are_alike(rng):
    # Known truth: an order of 7.06 under noise whose neighbours are alike, so that few samples are independent: a whole
    # number is not worse by more than that. Under white noise of the same size it is.
    q, memory = np.linspace(0.0, 6.0, 4000), 0.98
    white = rng.normal(size=4000)
    alike = np.zeros(4000)
    for k in range(1, 4000):
        alike[k] = memory * alike[k - 1] + np.sqrt(1 - memory**2) * white[k]
    found = [
        _Residual(q, np.ones((4000, 1)), np.sin(7.1 * q) + size * noise, 1.0).placed((), 7.1, True)
        for noise, size in ((white, 0.5), (alike / alike.std(), 0.5))
    ]
    assert found[0] != 7.0
    assert found[1] == 7.0


@pytest.mark.parametrize(
    ("left", "count"),
    # By hand: neighbours that have nothing in common, or less; a correlation of 1/2 among nine; three that are alike.
    [([1, 0, 1, 0, 1], 5.0), ([1, -1, 1, -1], 4.0), ([1, 1, 0] * 3, 3.0), ([2, 2, 2], 1.0), ([0, 0], 2.0)],
)
def test_samples_whose_neighbours_are_alike_count_as_fewer(left, count):
    assert _independent(np.array(left, dtype=float)) == pytest.approx(count)


def test_two_orders_are_further_apart_than_half_of_what_the_range_resolves(arm):
    # Known truth: two waves closer than that; what a single order leaves of them is next to it.
    t = 0.004 * np.arange(5000)
    q, v = 1.5 * np.sin(0.9 * t), 1.35 * np.cos(0.9 * t)
    rest = np.sin(30.0 * q) + np.sin(31.2 * q + 1.0)
    operation = turning(arm, q, v, 0.004, rest)
    low = order_range(operation, 1)[0]
    shapes = orders_in(operation, 1, whole_numbers=False)
    assert 2.0 < low < 2.2
    assert all(abs(a - b) >= 0.5 * low for shape in shapes for a, b in combinations(shape, 2))


def test_the_order_with_most_power_is_tried_beside_the_one_that_stands_out(arm):
    # Known truth: a strong slow wave, which has no neighbours to stand out from, and a weak fast one.
    t = 0.004 * np.arange(5000)
    q, v = 1.5 * np.sin(0.9 * t) + 0.9 * np.sin(2.3 * t), 1.35 * np.cos(0.9 * t) + 2.07 * np.cos(2.3 * t)
    shapes = orders_in(
        turning(arm, q, v, 0.004, 0.2 * np.sin(3.0 * q) + 0.02 * np.sin(60.0 * q)), 1, whole_numbers=True
    )
    assert {order for shape in shapes for order in shape} >= {3.0, 60.0}


@pytest.mark.parametrize(("periods", "often"), [(4.99, False), (5.01, True)])
def test_the_way_of_a_wave_is_made_forth_and_back(arm, periods, often):
    # By hand: two radians forth and two back.
    q = np.interp(np.arange(401), [0, 200, 400], [0.0, 2.0, 0.0])
    assert comes_back(turning(arm, q, np.gradient(q), 0.01), 1, periods * 2 * np.pi / 4.0) is often


@pytest.mark.parametrize(("periods", "often"), [(2.9, False), (3.1, True)])
def test_a_wave_has_to_turn_three_times_where_it_lies_in_the_judged_band(arm, periods, often):
    # By hand: two radians at 1 rad/s, where the wave has 0.8 of the band's frequency, and twenty at 10 rad/s, far
    # above it.
    order = periods * 2 * np.pi / 2.0
    v = np.repeat([1.0, 10.0], [201, 200])
    q = np.concatenate([np.linspace(0.0, 2.0, 201), 2.0 + 0.1 * np.arange(1, 201)])
    operation = replace(turning(arm, q, v, 0.01), band_hz=order / 0.8 / (2 * np.pi))
    assert comes_back(operation, 1, order) is often


def test_the_slowest_order_turns_five_times_and_a_tenth_less_does_not(arm):
    # By hand: on a way of four radians, the lowest of sixty orders with five periods.
    q = np.interp(np.arange(4001), [0, 2000, 4000], [0.0, 2.0, 0.0])
    operation = turning(arm, q, np.gradient(q) / 0.01, 0.01)
    order = slowest_order(operation, 1)
    assert order is not None
    assert 5.0 <= order * 4.0 / (2 * np.pi) < 5.5


def test_a_joint_that_moves_only_fast_has_no_slowest_order(arm):
    q = np.interp(np.arange(4001), [0, 2000, 4000], [0.0, 2.0, 0.0])
    operation = replace(turning(arm, q, np.gradient(q) / 0.01, 0.01), band_hz=1e-3)
    assert slowest_order(operation, 1) is None


def power_by_least_squares(q: np.ndarray, rest: np.ndarray, n: float) -> float:
    """Sum of squares that a sine and a cosine explain of the residual beside its mean."""
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
def test_the_power_of_an_order_is_what_its_waves_explain(uneven, n):
    q, rest = uneven
    wave = np.array([np.sum((rest - rest.mean()) * np.exp(-1j * n * q))])
    once, twice = (np.array([np.sum(np.exp(-1j * k * n * q))]) for k in (1, 2))
    assert _power(wave, once, twice, len(q))[0] == pytest.approx(power_by_least_squares(q, rest, n), rel=1e-9)


def test_the_periodogram_is_the_power_of_its_orders_up_to_the_width_of_a_bin(uneven):
    # A bin is an eighth of the shortest period: gathering takes 2.5 % off that wave's power, less off slow ones.
    q, rest = uneven
    orders, power = _periodogram(q, rest, 1.6, 20.0)
    exact = np.array([power_by_least_squares(q, rest, n) for n in orders[::7]])
    np.testing.assert_allclose(power[::7], exact, atol=0.06 * exact.max())


def test_the_periodogram_is_the_power_of_its_orders_where_positions_lie_on_its_bins(rng):
    # Up to order 10 bins are 2 pi / 80 wide, from the first position on.
    q = 0.7 + 2 * np.pi / 80 * (rng.integers(0, 60, 900) + 1e-9)
    q[0] = 0.7
    rest = np.sin(9.0 * q + 0.4) + rng.normal(size=900)
    orders, power = _periodogram(q, rest, 1.6, 10.0)
    np.testing.assert_allclose(power[:-1], [power_by_least_squares(q, rest, n) for n in orders[:-1]], rtol=1e-6)


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
