"""Noise of samples in which a joint moves: closed forms, and known noise beside a standstill."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.noise.certain_samples import certain_variance, root_weights


def test_without_doubt_it_is_the_mean_square(rng):
    squares = rng.normal(size=300) ** 2
    assert certain_variance(squares, np.zeros(300)) == pytest.approx(squares.mean())


def test_equal_doubt_of_all_samples_changes_nothing(rng):
    squares = rng.normal(size=300) ** 2
    assert certain_variance(squares, np.full(300, 7.0)) == pytest.approx(squares.mean())


def test_the_noise_of_a_moving_joint_is_found_beside_a_standstill(rng):
    # Known truth: noise of 0.1; in three quarters of the samples friction between -5 and 5 is added.
    still = np.arange(800) % 4 != 0
    noise = 0.1 * rng.normal(size=800) + np.where(still, rng.uniform(-5.0, 5.0, 800), 0.0)
    found = certain_variance(noise**2, np.where(still, 25.0, 0.0))
    assert np.sqrt(found) == pytest.approx(0.1, rel=0.2)


def test_a_tenth_of_the_samples_does_not_decide_alone(rng):
    # Of ten samples of a hundred the noise would be a hundredth: they are fewer than the share that may decide.
    sure = np.arange(100) < 10
    squares = np.where(sure, 1e-4, 1.0)
    assert certain_variance(squares, np.where(sure, 0.0, 1e4)) > 0.1


def test_no_samples_have_no_variance():
    assert certain_variance(np.zeros(0), np.zeros(0)) == 0.0


def test_a_sample_has_the_weight_of_its_noise_in_noise_and_friction(quiet, rng):
    # Closed form: the noise is 2 where the joint moves; at standstill its friction has a deviation of 6.
    columns = quiet.columns
    still = np.arange(len(columns.usable[0])) % 2 == 1
    noise = np.where(still, 6.0, 2.0) * np.where(np.arange(len(still)) % 4 < 2, 1.0, -1.0)
    standing = np.column_stack([np.where(still, 6.0e3, 0.0), np.zeros(len(still))])
    made = replace(columns, standstill_std=(standing,), usable=(np.ones_like(columns.usable[0]),))
    (weights,) = root_weights(made, [noise], 0)
    np.testing.assert_allclose(weights[~still], 1.0)
    np.testing.assert_allclose(weights[still] ** 2, 4.0 / (4.0 + 3.6e7), rtol=0.05)
    np.testing.assert_array_equal(root_weights(made, [noise], 1)[0], 1.0)
