"""Levels, thresholds and runs behind bursts. Oracle: NumPy's convolution written out, SciPy's normal law, by hand."""

import numpy as np
import pytest
from scipy.stats import norm

from identification.diagnosis import decision_rules as rules
from identification.diagnosis.judge.bursts import (
    Causes,
    _level,
    _run_about,
    _threshold,
    _variance,
    _variance_coefficients,
    moving_torque,
)

ALL = np.ones(60, dtype=bool)


def test_a_level_is_the_mean_under_a_window_of_hann():
    # By hand: three samples weighted 1/2, 1, 1/2 about each; an impulse of 8 is 4 at its place.
    impulse = np.zeros(60)
    impulse[30] = 8.0
    expected = np.zeros(60)
    expected[29:32] = 2.0, 4.0, 2.0
    np.testing.assert_allclose(_level(impulse, ALL, 3), expected, atol=1e-12)


@pytest.mark.parametrize("count", [3, 10, 25])
def test_the_level_of_a_constant_is_that_constant_where_enough_is_there(count):
    # Brute force: the window has to lie to six tenths on the recording.
    window = np.hanning(count + 2)[1:-1]
    filled = np.convolve(np.ones(60), window, mode="same")
    level = _level(np.full(60, 0.3), ALL, count)
    np.testing.assert_allclose(level, np.where(filled > 0.6 * window.sum(), 0.3, 0.0), atol=1e-12)


def test_samples_that_may_not_be_used_have_no_level_and_no_weight():
    use = np.arange(60) != 30
    level = _level(np.where(use, 0.3, 0.0), use, 5)
    np.testing.assert_allclose(level[10:50], np.where(use, 0.3, 0.0)[10:50], atol=1e-12)


@pytest.mark.parametrize(("samples", "joints"), [(3000, 2), (3000, 1), (10, 1), (96, 1)])
def test_chance_exceeds_a_threshold_in_one_of_a_hundred_recordings(samples, joints):
    # SciPy: two tails of a normal law whose spread is that of the level, by as many looks as windows, joints and
    # lengths; a window longer than the record is looked at once.
    level = 10.0 * np.tile([1.0, -1.0], samples // 2)
    looks = max(samples * 0.02 / 0.5, 1.0) * joints * len(rules.BURST_LENGTHS)
    expected = norm.isf(0.5 * rules.BURST_LEVEL / looks, scale=10.0 / norm.ppf(0.75))
    assert _threshold(level, 0.5, 0.02, joints) == pytest.approx(max(expected, rules.BURST_RATIO), rel=1e-4)


def test_normal_noise_of_one_size_hardly_ever_comes_to_half_of_the_fixed_ratio(rng):
    # Ten minutes at 5 Hz each, by the shortest window, in which a mean averages least.
    use = np.ones(3000, dtype=bool)
    most = [np.abs(_level(rng.normal(size=3000), use, 3)).max() for _ in range(200)]
    assert np.percentile(most, 95) < rules.BURST_RATIO / rules.BURST_TIMES


def test_a_threshold_is_a_fixed_ratio_where_nothing_is_loud():
    assert _threshold(np.zeros(100), 0.5, 0.02, 2) == rules.BURST_RATIO


@pytest.mark.parametrize(("at", "run"), [(0, (0, 1)), (1, (0, 1)), (4, (4, 6)), (5, (4, 6)), (9, (8, 9))])
def test_a_run_ends_where_its_neighbours_are_outside(at, run):
    assert _run_about(np.array([1, 1, 0, 0, 1, 1, 1, 0, 1, 1], dtype=bool), at) == run


def test_a_run_may_be_everything():
    assert _run_about(np.ones(5, dtype=bool), 2) == (0, 4)


def test_a_peak_of_torque_reaches_two_periods_of_the_edge():
    # By hand: at 100 Hz and 5 Hz over twenty samples a period, so 41 in all; the change of a step is its half a sample
    # before and behind, 100 / (5 pi) times.
    torque = np.where(np.arange(300) >= 150, 1.0, 0.0)
    moving = moving_torque(torque - 3.0, 100.0, 5.0)
    change = (0.5 * 100.0 / (np.pi * 5.0)) ** 2
    assert moving[149] == pytest.approx(max(change + 0.25, change + 0.25), rel=1e-9)
    assert moving[128] == pytest.approx(0.25)
    assert moving[129] == pytest.approx(change + 0.25)
    assert moving[170] == pytest.approx(change + 0.25)
    assert moving[171] == pytest.approx(0.25)


@pytest.mark.parametrize("share", [0.5, 3.0])
def test_a_variance_that_grows_with_a_known_part_is_found(rng, share):
    # Known truth: Student's law of four degrees of freedom, whose squared scale is 1 + share x.
    part = rng.uniform(0, 2, (20_000, 1))
    residual = np.sqrt(1.0 + share * part[:, 0]) * rng.standard_t(4.0, 20_000)
    found = _variance_coefficients(residual, np.ones(20_000), part, np.zeros(1))
    np.testing.assert_allclose(found, share, rtol=0.1)


def test_variances_are_no_less_than_the_least(rng):
    found = _variance_coefficients(1e-3 * rng.normal(size=500), np.ones(500), np.ones((500, 2)), np.array([0.3, 0.0]))
    assert found[0] == pytest.approx(0.3)
    assert found[1] < 1e-3


def test_noise_is_read_where_torque_and_doubt_are_small(rng):
    # Known truth: noise of variance 4, and a residual of a hundred times that where torque or doubt is large.
    torque = np.where(np.arange(4000) % 4 == 0, 10.0, 0.0)
    known = np.where(np.arange(4000) % 4 == 1, 400.0, 0.0)
    residual = 2.0 * rng.normal(size=4000) * np.where(torque + known > 0, 10.0, 1.0)
    found = _variance(residual, Causes(known, torque, np.zeros(4000, dtype=bool)), np.ones(4000, dtype=bool))
    quiet = torque + known == 0
    np.testing.assert_allclose(found[quiet], 4.0, rtol=0.1)
    np.testing.assert_allclose(found[known > 0], 404.0, rtol=0.01)
