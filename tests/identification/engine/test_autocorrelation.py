"""How long noise remembers. Oracle: NumPy's correlation written out, closed forms of autoregressions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.engine.autocorrelation import autocorrelation_time, lagged_products, positive_sequence


def time_by_hand(e: np.ndarray) -> float:
    """Twice the sum of autocorrelations of pairs of lags up to the first negative pair, less one."""
    e = e - e.mean()
    r = np.correlate(e, e, "full")[len(e) - 1 :][: len(e) // 2] / (e @ e)
    out = -1.0
    for k in range(0, len(r) - 1, 2):
        if r[k] + r[k + 1] <= 0:
            break
        out += 2.0 * (r[k] + r[k + 1])
    return max(out, 1.0)


def test_products_by_lag_are_those_of_numpy(rng):
    e = rng.normal(size=31)
    np.testing.assert_allclose(lagged_products(e), np.correlate(e, e, "full")[30:], atol=1e-12)


def test_lags_end_before_the_first_pair_that_is_negative_together():
    # By hand: the pairs sum up to 1.5, 0.1 and -0.1.
    np.testing.assert_array_equal(
        positive_sequence(np.array([2.0, 1.0, 0.4, -0.2, -0.1, -0.1, 4.0, 4.0])), [1, 0.5, 0.2, -0.1]
    )


@pytest.mark.parametrize("samples", [8, 9, 11, 30, 200])
def test_the_autocorrelation_time_is_the_sum_over_pairs_of_lags(rng, samples):
    for _ in range(10):
        e = np.cumsum(rng.normal(size=samples)) + 5.0
        assert autocorrelation_time(e) == pytest.approx(time_by_hand(e))


def test_seven_samples_have_time_one():
    line = np.arange(8.0)
    assert autocorrelation_time(line[:7]) == 1.0
    assert autocorrelation_time(line) == pytest.approx(time_by_hand(line)) != 1.0


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_the_autocorrelation_time_of_a_first_order_law_is_its_closed_form(rng, phi):
    # Closed form: (1 + phi) / (1 - phi) for e_t = phi e_(t-1) + w_t.
    e = lfilter([1.0], [1.0, -phi], rng.normal(size=60000))
    assert autocorrelation_time(e) == pytest.approx((1 + phi) / (1 - phi), rel=0.2)


def test_noise_that_alternates_counts_as_white_at_least(rng):
    e = lfilter([1.0], [1.0, 0.8], rng.normal(size=5000))
    assert autocorrelation_time(e) == 1.0


@pytest.mark.parametrize("e", [np.zeros(100), np.ones(5)], ids=["zeros", "few samples"])
def test_a_series_that_tells_nothing_has_time_one(e):
    assert autocorrelation_time(e) == 1.0
