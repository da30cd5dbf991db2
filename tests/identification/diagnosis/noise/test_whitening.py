from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.signal import lfilter

from identification.diagnosis.noise.certain_samples import certain_samples
from identification.diagnosis.noise.noise_floor import estimate_noise
from identification.diagnosis.noise.whitening import (
    Whitening,
    at_least_sensor_noise,
    autocovariance,
    filtered,
    prediction_filters,
    whitened,
    whitening_of,
)


def autoregressive(rng: np.random.Generator, coefficients: list[float], count: int) -> np.ndarray:
    """Noise ``e_t = a_1 e_(t-1) + a_2 e_(t-2) + w_t`` with white ``w`` of size one."""
    return lfilter([1.0], [1.0, *(-a for a in coefficients)], rng.normal(size=count + 500))[500:]


def filter_of(*parts: np.ndarray) -> np.ndarray:
    """The filter of noise all samples of which are certain, beyond the first ones."""
    return prediction_filters(autocovariance([*parts]), np.ones(20, dtype=bool))[-1]


def autocorrelation(e: np.ndarray, lags: int) -> np.ndarray:
    return np.array([e[k:] @ e[: len(e) - k] for k in range(1, lags + 1)]) / (e @ e)


@pytest.mark.parametrize("coefficients", [[1.2, -0.5], [0.3, 0.4], [-0.6, -0.2]])
def test_noise_of_a_known_law_becomes_white(rng, coefficients):
    # Known truth: second-order autoregressive noise; white noise keeps 95 % of its autocorrelations in 2/sqrt(n).
    law = autocovariance([autoregressive(rng, coefficients, 6000)])
    e = filtered(prediction_filters(law, np.ones(6000, dtype=bool)), autoregressive(rng, coefficients, 6000))
    rho = autocorrelation(e, 40)
    assert np.mean(np.abs(rho) < 2 / np.sqrt(len(e))) > 0.85
    assert np.abs(rho).max() < 4 / np.sqrt(len(e))


def test_the_filter_is_one_less_the_law_of_the_noise(rng):
    # Closed form: the whitening filter of the law is 1, -a_1, -a_2, 0, ...
    found = filter_of(autoregressive(rng, [1.2, -0.5], 20000))
    np.testing.assert_allclose(found, [1.0, -1.2, 0.5, *np.zeros(6)], atol=4 / np.sqrt(20000))


def test_recordings_of_one_noise_share_its_filter(rng):
    found = filter_of(*(autoregressive(rng, [1.2, -0.5], 5000) for _ in range(4)))
    np.testing.assert_allclose(found[:3], [1.0, -1.2, 0.5], atol=4 / np.sqrt(20000))


@pytest.mark.parametrize("e", [np.zeros(1000), np.ones(20)], ids=["no noise", "few samples"])
def test_noise_that_tells_nothing_is_left_as_it_is(e):
    np.testing.assert_array_equal(filter_of(e), [1.0])


def test_filtering_is_that_of_scipy(rng):
    kernel, x = rng.normal(size=6), rng.normal(size=(300, 2))
    np.testing.assert_allclose(filtered(np.tile(kernel, (300, 1)), x), lfilter(kernel, [1.0], x, axis=0), atol=1e-13)


@pytest.mark.parametrize("start", [0, 3, 50])
def test_a_series_times_white_columns_is_the_filtered_series_times_the_columns(rng, start):
    # Oracle: the white columns themselves; the filter looks back before the first sample of the series.
    filters = Whitening([[rng.normal(size=(80, 6))]], [rng.random((80, 1))])
    x, e = rng.normal(size=(80, 4)), rng.normal(size=30)
    (white,) = filters.columns((x,), 0)
    series, first = filters.transposed(e, 0, 0, start)
    np.testing.assert_allclose(series @ x[first : first + len(series)], e @ white[start : start + 30], atol=1e-12)


def test_filtering_leaves_its_input_alone(rng):
    x = rng.normal(size=30)
    before = x.copy()
    filtered(np.tile([1.0, 0.5], (30, 1)), x)
    np.testing.assert_array_equal(x, before)


def test_a_linear_relation_survives_on_every_row(quiet, rng):
    # Residual = columns @ theta before, so after: the same filter, and the same counts of samples, on both sides.
    thetas = [rng.normal(size=len(row)) for row in quiet.columns.rows]
    plain = np.column_stack([x @ theta for x, theta in zip(quiet.columns.values[0], thetas, strict=True)])
    white, _ = whitened(replace(quiet.columns, residual=(plain,)), (quiet_noise(quiet),))
    for j, theta in enumerate(thetas):
        expected = white.residual[0][:, j]
        np.testing.assert_allclose(white.values[0][j] @ theta, expected, atol=1e-9 * np.abs(expected).max())


def quiet_noise(quiet) -> np.ndarray:
    return estimate_noise(quiet.session, quiet.columns)[0][0]


@pytest.mark.parametrize("gap", [1, 3, 12])
def test_after_uncertain_samples_noise_is_predicted_from_the_certain_ones_within_reach(gap):
    # Oracle: conditional expectation of a normal distribution with the covariance of the noise.
    law = 0.8 ** np.arange(9) + 0.5 * (np.arange(9) == 0)
    certain = np.ones(80, dtype=bool)
    certain[40 : 40 + gap] = False
    filters = prediction_filters(law, certain)
    for n in (40 + gap, 42 + gap, 60 + gap):
        lags = np.array([lag for lag in range(1, 9) if certain[n - lag]], dtype=int)
        expected = np.eye(9)[0]
        expected[lags] = -np.linalg.solve(toeplitz(law)[np.ix_(lags, lags)], law[lags])
        np.testing.assert_allclose(filters[n] / filters[n, 0], expected, atol=1e-9)


def test_errors_of_all_predictions_have_one_variance(rng):
    # Closed form: the variance of a filtered noise is k C k, with the covariance C of the noise.
    law = 0.8 ** np.arange(9) + 0.5 * (np.arange(9) == 0)
    filters = prediction_filters(law, rng.random(200) < 0.6)
    variances = np.einsum("nk,kl,nl->n", filters, toeplitz(law), filters)
    np.testing.assert_allclose(variances, variances[0], rtol=1e-9)


def test_no_sample_is_lost_after_a_standstill(quiet):
    # By hand: the friction of a standing joint is uncertain by a hundred times the noise, and only there.
    standing = np.zeros_like(quiet.columns.residual[0])
    standing[100:110] = 100.0
    noise = np.random.default_rng(3).normal(size=standing.shape)
    columns = replace(quiet.columns, standstill_std=(standing,), reversal_std=(np.zeros_like(standing),))
    weights = whitening_of(columns, (noise,)).weights[0][:, 0]
    np.testing.assert_array_equal(weights < 0.5 * weights.max(), standing[:, 0] > 0.0)


def test_a_sample_is_certain_if_it_is_usable_and_friction_at_standstill_is_below_the_noise(quiet):
    usable, standing = np.ones((4, 2), dtype=bool), np.zeros((4, 2))
    usable[1, 0], standing[2:, 0] = False, [0.9, 1.1]
    columns = replace(quiet.columns, usable=(usable,), standstill_std=(standing,))
    np.testing.assert_array_equal(certain_samples(columns, 0, 0, 1.0), [True, False, True, False])


def test_the_filter_solves_the_equations_of_yule_and_walker(rng):
    # SciPy's Levinson recursion on the lags of NumPy's correlation, with a millionth of the variance on the diagonal;
    # a series shorter than the filter has but its own lags.
    parts = [np.cumsum(rng.normal(size=n)) for n in (400, 300, 5)]
    lags = sum(np.correlate(e, e, "full")[len(e) - 1 :][:9] for e in parts[:2])
    lags[:5] += np.correlate(parts[2], parts[2], "full")[4:]
    expected = solve_toeplitz(np.concatenate([[lags[0] * (1 + 1e-6)], lags[1:8]]), lags[1:])
    np.testing.assert_allclose(filter_of(*parts), [1.0, *-expected], rtol=1e-6)


@pytest.mark.parametrize(("samples", "known"), [(159, False), (160, True)])
def test_a_hundred_and_sixty_samples_tell_the_law_of_a_noise(rng, samples, known):
    e = autoregressive(rng, [0.9], samples)
    assert (len(autocovariance([e[:100], e[100:]])) > 1) is known


def test_noise_that_is_nothing_leaves_everything_as_it_is(quiet):
    # A noise of zero has no law and no size: samples in doubt count alike.
    columns = quiet.columns
    nothing = tuple(np.zeros_like(part) for part in columns.residual)
    white, left = whitened(replace(columns, reversal_std=nothing), nothing)
    np.testing.assert_allclose(white.residual[0], columns.residual[0])
    assert not left[0].any()


def test_another_series_is_whitened_by_the_law_of_the_noise(quiet, rng):
    # One law for both: twice the noise comes out twice as large, itself as `whitened` makes it.
    columns, noise = quiet.columns, quiet_noise(quiet)
    white = whitened(columns, (noise,))[1][0]
    filters = whitening_of(columns, (noise,))
    np.testing.assert_allclose(filters.series((noise,))[0], white)
    np.testing.assert_allclose(filters.series((2.0 * noise,))[0], 2.0 * white)


def test_two_recordings_are_whitened_by_one_law(quiet):
    # The same recording twice has the law that it has once.
    columns, noise = quiet.columns, quiet_noise(quiet)
    names = ("values", "residual", "model_torque", "usable", "reversal_std", "standstill_std", "operations")
    twice = replace(columns, **{name: 2 * getattr(columns, name) for name in names})
    once, both = whitened(columns, (noise,))[0], whitened(twice, (noise, noise))[0]
    for log in range(2):
        np.testing.assert_allclose(both.residual[log], once.residual[0], rtol=1e-9)
        np.testing.assert_allclose(both.model_torque[log], once.model_torque[0], rtol=1e-9)
        np.testing.assert_allclose(both.values[log][1], once.values[0][1], rtol=1e-9)


def test_a_smooth_rest_that_weighs_less_than_the_sensors_gets_their_noise(quiet, rng):
    # A sine follows from two samples before it: white it is next to nothing, however large it is.
    columns = quiet.columns
    noise = quiet_noise(quiet)
    smooth = noise.copy()
    smooth[:, 0] = np.sin(0.05 * np.arange(len(noise)))
    sensed = 0.01 * rng.normal(size=noise.shape)
    (found,) = at_least_sensor_noise(columns, (smooth,), (sensed,))
    np.testing.assert_allclose(found[:, 0], smooth[:, 0] + sensed[:, 0], atol=0.1 * sensed[:, 0].std())


def test_a_noise_above_that_of_the_sensors_stays_as_it_is(quiet, rng):
    # White noise ten times as large as that of the sensors.
    noise = rng.normal(size=quiet.columns.residual[0].shape)
    (found,) = at_least_sensor_noise(quiet.columns, (noise,), (0.1 * rng.normal(size=noise.shape),))
    np.testing.assert_array_equal(found, noise)
