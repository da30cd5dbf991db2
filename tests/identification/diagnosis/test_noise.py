from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from identification.diagnosis.noise import autocorrelation_time, estimate_noise, rms, smaller_noise, weights_of


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


def test_the_root_mean_square_is_over_all_series():
    assert rms([np.array([3.0]), np.array([4.0, 0.0])]) == pytest.approx(np.sqrt(25 / 3))


def test_no_samples_have_no_size():
    assert rms([np.zeros(0)]) == 0.0


def test_the_floor_is_the_noise_that_was_added(lab, planar2):
    # Known truth: white noise of 0.05 at 200 Hz, of which the band lets its share of the power through.
    robot, level = planar2, 0.05
    prepared = lab.prepared(robot, (lab.recording(robot, lab.motion(2, seconds=30.0), noise=level),), white=False)
    band = prepared.logs[0].band
    expected = level * np.sqrt(np.sum(band.kernel**2))
    np.testing.assert_allclose(prepared.weights.floor, expected, rtol=0.15)


def test_the_noise_holds_nothing_of_an_effect_of_the_catalogue(lab, planar2):
    # The same noise with and without friction that the model lacks.
    motion = lab.motion(2, seconds=20.0)
    floors = []
    for torque in (0.0, -0.5 * np.sign(motion.v)):
        prepared = lab.prepared(planar2, (lab.recording(planar2, motion, torque),), white=False)
        floors.append(prepared.weights.floor)
    np.testing.assert_allclose(floors[1], floors[0], rtol=0.1)


def test_noise_is_zero_where_samples_are_not_used(quiet):
    noise = estimate_noise(quiet.columns, quiet.logs, quiet.blocks, quiet.folds)[0]
    assert not noise[~quiet.columns.usable[0]].any()


def test_a_robot_without_noise_keeps_finite_weights(quiet):
    weights = weights_of(quiet.columns, (np.zeros_like(quiet.columns.residual[0]),))
    np.testing.assert_allclose(weights.floor, 1e-6 * quiet.columns.model_torque[0].std(axis=0))
    np.testing.assert_array_equal(weights.spread, 1.0)


def test_an_explanation_that_leaves_less_than_the_noise_replaces_it(lab, planar2):
    # Known truth: no gap and noise of 0.05; a noise that is taken three times too large comes down again.
    prepared = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2)),))
    given = tuple(3 * part for part in prepared.noise)
    noise, ratio = smaller_noise(prepared.search, frozenset(), given)
    band = prepared.logs[0].band
    assert ratio < 0.5
    left = noise[0][prepared.columns.usable[0][:, 1], 1]
    assert np.std(left) == pytest.approx(0.05 * np.sqrt(np.sum(band.kernel**2)), rel=0.15)


def test_an_explanation_that_leaves_more_than_the_noise_changes_nothing(quiet):
    small = tuple(0.2 * part for part in quiet.noise)
    noise, ratio = smaller_noise(quiet.search, frozenset(), small)
    assert ratio == 1.0
    np.testing.assert_array_equal(noise[0], small[0])
