"""Floors by sensors in place of those by predictors. Oracle: the floor of the sensors alone, by hand."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.fit.gap import measured_torque, sums
from identification.diagnosis.judge.floors import NONE, REPETITIONS, SENSORS, Floor, counted, sensed_floor, sensed_of
from identification.diagnosis.noise.sensor_floor import SensorFloor

BEFORE = Floor(np.array([5.0, 6.0]), np.array([4.0, 5.0]), np.array([6.0, 7.0]), ("predictors", "predictors"))
SENSED = SensorFloor(*(np.array([x, np.nan]) for x in (0.2, 0.1, 0.3, 0.2)), np.zeros(2))


@pytest.fixture
def floor(quiet):
    made = replace(sensed_of(quiet.problem), floor=SENSED)

    def of(before=BEFORE):
        nothing = tuple(np.zeros_like(part) for part in quiet.noise)
        return sensed_floor(before, made, quiet.problem, quiet.noise, nothing, nothing)

    return of


def test_the_floor_of_a_joint_whose_sensors_show_it_is_theirs(floor):
    found = floor()
    assert (found.value[0], found.low[0], found.source[0]) == (0.2, 0.1, SENSORS)


def test_a_joint_whose_sensors_show_nothing_keeps_an_upper_limit_and_says_so(floor):
    found = floor()
    assert (found.value[1], found.low[1], found.high[1], found.source[1]) == (6.0, 5.0, 7.0, NONE)


def test_a_joint_whose_noise_predictors_limit_further_than_sensors_keeps_that_limit(floor):
    low = replace(BEFORE, value=np.array([0.15, 6.0]), low=np.array([0.1, 5.0]))
    found = floor(low)
    assert (found.value[0], found.low[0], found.source[0]) == (0.15, 0.1, SENSORS)


def test_what_predictors_leave_is_the_value_inside_the_interval_of_the_sensors(floor):
    found = floor(replace(BEFORE, value=np.array([0.25, 6.0])))
    assert (found.value[0], found.low[0], found.source[0]) == (0.25, 0.1, SENSORS)


def test_repetitions_stay_the_best_source(floor):
    found = floor(replace(BEFORE, source=(REPETITIONS, "predictors")))
    assert (found.value[0], found.source[0]) == (5.0, REPETITIONS)


def test_the_upper_end_holds_what_derivatives_are_wrong_by(floor, quiet):
    # By hand: a thousandth of the torque beside the upper end of the sensors.
    torque = sums(quiet.problem, measured_torque(quiet.problem)).rms()[0]
    assert floor().high[0] == pytest.approx(np.hypot(0.3, 0.001 * torque))


def test_what_is_allowed_holds_the_discrepancy(floor):
    found = floor()
    assert np.all(found.discrepancy > 0)
    np.testing.assert_allclose(found.allowed, np.hypot(found.high, found.discrepancy))


def test_samples_count_where_blocks_are_judged_and_nowhere_else(quiet):
    # By hand: cores of the judged blocks are all that figures of a gap are made of.
    squares = sums(quiet.problem, tuple(np.ones_like(part) for part in quiet.noise))
    counts = sum(part.sum(axis=0) for part in counted(quiet.problem))
    np.testing.assert_allclose(counts, squares.counts.sum(axis=0))
