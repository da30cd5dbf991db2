"""Curves about a moment. Oracles: the values that went in, and NumPy's interpolation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from identification.viewing.charts import MOST_PARTS, MOST_POINTS, Chart, charts_of

T = np.arange(10_000) / 1000.0


@pytest.fixture
def chart():
    return Chart("sine", ("a", "b"), ("#000000", "#ffffff"), T, np.column_stack([np.sin(T), 2 * np.cos(T)]))


def test_a_line_marks_the_moment_over_the_whole_height(chart):
    drawn = chart.about(3.0004, 1.0)
    marked = drawn[np.isfinite(drawn[:, 3])]
    np.testing.assert_allclose(marked[:, 0], 3.0004)
    assert marked[:, 3].tolist() == list(chart.limits)


def test_the_curves_are_the_values_on_both_sides_of_the_line(chart):
    drawn = chart.about(3.0004, 1.0)
    known = np.isfinite(drawn[:, 1])
    np.testing.assert_allclose(drawn[known, 1], np.sin(drawn[known, 0]), atol=1e-12)
    assert np.diff(drawn[known, 0]).max() < 0.0011


def test_only_the_asked_seconds_are_drawn_in_order(chart):
    t = chart.about(5.0, 2.0)[:, 0]
    assert (t[0], t[-1]) == pytest.approx((4.0, 6.0), abs=0.002)
    assert (np.diff(t) >= 0).all()


def test_a_long_stretch_is_thinned_and_keeps_its_extremes(chart):
    drawn = chart.about(5.0, np.inf)
    assert len(drawn) <= MOST_POINTS + 2
    np.testing.assert_array_equal([np.nanmin(drawn[:, 2]), np.nanmax(drawn[:, 2])], [chart.values[:, 1].min(), 2.0])


def test_before_the_first_sample_there_is_no_curve(chart):
    drawn = chart.about(-1.0, 1.0)
    assert np.isnan(drawn[:, 1:3]).all()


def test_a_stretch_that_is_left_out_parts_a_curve_into_lines_of_their_own(chart):
    values = chart.values.copy()
    values[(T > 4.0) & (T < 5.0)] = np.nan
    broken = replace(chart, values=values)
    drawn = broken.about(4.5, 3.0)
    assert (broken.parts, drawn.shape[1]) == (2, 6)
    for column, inside in ((1, (3.0, 4.0)), (2, (5.0, 6.0))):
        t = drawn[np.isfinite(drawn[:, column]), 0]
        np.testing.assert_allclose((t.min(), t.max()), inside, atol=0.002)
        np.testing.assert_array_equal(drawn[np.isfinite(drawn[:, column]), column], np.sin(t))


def test_a_curve_without_values_leaves_the_others_as_they_are(chart):
    values = chart.values.copy()
    values[:, 0] = np.nan
    drawn = replace(chart, values=values).about(5.0, 0.5)
    assert np.isfinite(drawn[:, 2]).sum() == pytest.approx(501, abs=2)


def test_many_gaps_take_a_limited_number_of_lines(chart):
    values = chart.values.copy()
    values[::100] = np.nan
    broken = replace(chart, values=values)
    drawn = broken.about(5.0, np.inf)
    assert drawn.shape[1] == 2 + 2 * MOST_PARTS
    assert np.isfinite(drawn[:, 1 : 1 + MOST_PARTS]).sum(axis=1).max() == 1


def test_the_limits_leave_room_about_all_values(chart):
    low, high = chart.limits
    assert low < -2.0 < 2.0 < high < 2.5


def test_the_limits_of_nothing_are_still_an_axis():
    assert Chart("", ("a",), ("#000000",), T, np.full((len(T), 1), np.nan)).limits == (-1.0, 1.0)


def test_the_position_error_is_that_of_the_simulated_copies(replay):
    errors = charts_of(replay, 1)[2].values
    np.testing.assert_array_equal(errors[:, 0], replay.copies[1].q[:, 1] - replay.copies[0].q[:, 1])


def test_the_charts_of_a_joint_name_it_with_its_unit(replay):
    torque, left, position = (chart.title for chart in charts_of(replay, 1))
    assert (torque, position) == ("elbow: torque [N m]", "elbow: simulated less measured position [rad]")
    assert left == "elbow: measured less modelled torque [N m]"
