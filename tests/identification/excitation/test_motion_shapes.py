from __future__ import annotations

import numpy as np
import pytest

from identification.excitation.motion_shapes import BSplines, FourierSeries, TrianglesAndSines
from phantom_dyn.errors import ParameterError

FAMILIES = [FourierSeries(4.0, 3), BSplines(4.0, 5), BSplines(4.0, 1), TrianglesAndSines(4.0), FourierSeries(4.0, 2)]


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_any_sum_begins_and_ends_at_rest(shapes, rng):
    values = shapes.values(np.array([0.0, 4.0]))
    weights = rng.normal(size=values.shape[2])
    np.testing.assert_allclose(values[1:] @ weights, 0.0, atol=1e-12)


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_velocity_and_acceleration_are_the_slopes(shapes):
    # Oracle: central differences.
    t, h = np.linspace(0.01, 3.99, 801), 1e-6
    before, at, after = (shapes.values(t + step) for step in (-h, 0.0, h))
    np.testing.assert_allclose(at[1], (after[0] - before[0]) / (2 * h), atol=1e-7)
    # The slope of a triangle's acceleration jumps at the ends of a turn.
    np.testing.assert_allclose(at[2], (after[1] - before[1]) / (2 * h), atol=2e-4)


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_the_first_shape_is_a_posture(shapes):
    first = shapes.values(np.linspace(0.0, 4.0, 5))[:, :, 0]
    np.testing.assert_array_equal(first, [[1.0] * 5, [0.0] * 5, [0.0] * 5])


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_no_shape_is_a_sum_of_the_others(shapes):
    positions = shapes.values(np.linspace(0.0, 4.0, 500))[0]
    assert np.linalg.matrix_rank(positions) == positions.shape[1]


@pytest.mark.parametrize("shapes", FAMILIES, ids=repr)
def test_samples_show_the_peak_speed_within_a_per_cent(shapes, rng):
    weights = rng.normal(size=shapes.values(np.zeros(1)).shape[2])
    peaks = [
        np.abs(shapes.values(np.linspace(0.0, 4.0, n))[1] @ weights).max()
        for n in (shapes.samples, 50 * shapes.samples)
    ]
    assert peaks[0] > 0.99 * peaks[1]


def test_fourier_series_hold_what_harmonics_at_rest_allow():
    # Two weights of each harmonic less two conditions, as the motion is periodic, and the posture.
    assert FourierSeries(4.0, 5).values(np.zeros(1)).shape[2] == 2 * 5 - 2 + 1


def test_between_its_turns_a_triangle_adds_no_acceleration_to_the_sines():
    # Closed form: its turns take 0.15 of 4 s about 0, 2 and 4 s; what is left is one sine and one cosine.
    t = np.linspace(0.31, 1.69, 200)
    moving = TrianglesAndSines(4.0, triangles=1, harmonics=1).values(t)[2, :, 1:]
    sines = np.column_stack([np.sin(0.5 * np.pi * t), np.cos(0.5 * np.pi * t)])
    _, left, *_ = np.linalg.lstsq(sines, moving, rcond=None)
    assert np.abs(moving).max() > 0.1
    np.testing.assert_allclose(left, 0.0, atol=1e-20)


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan, np.inf])
def test_a_duration_that_is_none_is_refused(duration):
    with pytest.raises(ParameterError, match=r"A motion of \S+ s was asked for: give more than 0\."):
        FourierSeries(duration)


def test_one_harmonic_cannot_be_at_rest():
    with pytest.raises(ParameterError, match="A motion of 1 harmonics was asked for: give at least 2"):
        FourierSeries(4.0, 1)


def test_a_spline_without_a_piece_is_refused():
    with pytest.raises(ParameterError, match="A motion of 0 pieces was asked for: give at least 1"):
        BSplines(4.0, 0)
