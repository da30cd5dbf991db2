from __future__ import annotations

import numpy as np

from identification.diagnosis.judge.floors import Floor, floor_of

FLOOR = Floor(np.array([0.1, 0.2]), np.array([0.08, 0.16]), np.array([0.12, 0.24]), ("above_band", "predictors"))


def test_the_floor_is_what_no_model_predicts_and_lies_inside_its_interval(quiet):
    # Known truth: the recording's torque has white noise of 0.02 N m and a band of less than half the rate.
    floor = floor_of(quiet.problem, quiet.noise, np.zeros(2))
    assert np.all(floor.low <= floor.value)
    assert np.all(floor.value <= floor.high)
    assert np.all(floor.high < 2.0 * floor.low)


def test_the_floor_of_a_fine_encoder_is_that_of_what_rounding_leaves():
    # Closed form: squares of independent noises add.
    fine = FLOOR.without(np.array([0.0, 0.03]))
    np.testing.assert_allclose(fine.value, [0.1, 0.1])
    np.testing.assert_allclose(fine.high / fine.value, FLOOR.high / FLOOR.value)


def test_the_floor_of_a_fine_encoder_is_three_tenths_of_the_noise_at_least():
    np.testing.assert_allclose(FLOOR.without(np.array([0.0099, 5.0])).value, [0.03, 0.06])


def test_without_a_coarse_reading_the_floor_stays():
    assert FLOOR.without(np.zeros(2)) is FLOOR
