from __future__ import annotations

import numpy as np
import pytest

from identification.next_experiment.candidates import SmallReversals
from phantom_dyn.errors import ParameterError

FAMILY = SmallReversals(9.0, stops=3, reversals=4)


def test_every_shape_begins_and_ends_at_rest():
    np.testing.assert_allclose(FAMILY.values(np.array([0.0, 9.0]))[1:], 0.0, atol=1e-12)


def test_velocity_and_acceleration_are_the_slopes():
    # Oracle: central differences.
    t, h = np.linspace(0.01, 8.99, 901), 1e-6
    before, at, after = (FAMILY.values(t + step) for step in (-h, 0.0, h))
    np.testing.assert_allclose(at[1], (after[0] - before[0]) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(at[2], (after[1] - before[1]) / (2 * h), atol=1e-4)


def test_every_stop_is_held_with_reversals_of_the_size_that_was_asked_for():
    # Closed form: a triangle of unit amplitude about each posture, the slow one on the second joint.
    postures = np.array([[0.0, 1.0], [0.5, -1.0], [-0.3, 0.2]])
    weights = FAMILY.weights(postures, np.full((3, 2), 0.05), np.array([False, True]))
    t = np.linspace(0.0, 9.0, 4501)
    q = FAMILY.values(t)[0] @ weights
    for k, posture in enumerate(postures):
        here = q[(t > 3.0 * k + 1.4) & (t < 3.0 * k + 2.6)]
        np.testing.assert_allclose(here.max(axis=0) - posture, 0.05, rtol=0.03)
        np.testing.assert_allclose(posture - here.min(axis=0), 0.05, rtol=0.03)


def test_the_slower_triangle_turns_half_as_often():
    t = np.linspace(0.0, 3.0, 3001)
    v = SmallReversals(3.0, stops=1, reversals=6).values(t)[1]
    quick, slow = (np.sum(np.diff(np.sign(column[(t > 0.9) & (t < 3.0)])) != 0) for column in v[:, 1:3].T)
    assert quick == pytest.approx(2 * slow, abs=2)


@pytest.mark.parametrize("duration", [0.0, np.nan, -1.0])
def test_a_motion_without_a_length_is_refused(duration):
    with pytest.raises(ParameterError, match="was asked for: give more than 0"):
        SmallReversals(duration)


def test_a_motion_without_reversals_is_refused():
    with pytest.raises(ParameterError, match="4 postures with 1 reversals were asked for: give at least 1 with 2"):
        SmallReversals(5.0, reversals=1)


def test_the_farthest_posture_is_reached_at_the_largest_speed_or_acceleration():
    # Oracle: the shapes themselves, along the way alone.
    farthest = FAMILY.farthest(np.array([1.3, 100.0]), np.array([1e6, 7.0]))
    weights = FAMILY.weights(np.outer([0.0, 1.0, 1.0], farthest), np.zeros((3, 2)), np.array([False, True]))
    values = FAMILY.values(np.linspace(0.0, FAMILY.duration, 100001)) @ weights
    assert np.abs(values[1]).max(axis=0)[0] == pytest.approx(1.3, rel=1e-4)
    assert np.abs(values[2]).max(axis=0)[1] == pytest.approx(7.0, rel=1e-3)
