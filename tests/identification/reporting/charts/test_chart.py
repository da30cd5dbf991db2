"""Charts as SVG, and thinned curves."""

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from identification.reporting.charts.chart import Panel, chart
from identification.reporting.charts.chart_marks import (
    Cloud,
    Curve,
    Frame,
    cloud_svg,
    curve_svg,
    decade_ticks,
    tick_words,
    ticks,
)
from identification.reporting.charts.thinning import (
    binned_median,
    gap_starts,
    largest_residual_section,
    scatter_choice,
    thinned,
)

SVG = "{http://www.w3.org/2000/svg}"

# One unit is ten points to the right and ten upwards, from the lower left corner at (0, 100).
FRAME = Frame((0.0, 10.0), (0.0, 10.0), (0.0, 100.0), (100.0, 0.0))


def line(*points: tuple[float, float], **more) -> Curve:
    x, y = np.array(points, dtype=float).T
    return Curve(x, y, "red", 1.0, **more)


def texts(svg: str) -> list[str]:
    return ["".join(element.itertext()) for element in ET.fromstring(svg).iter(f"{SVG}text")]


@pytest.mark.parametrize(
    ("low", "high", "most", "expected"),
    [
        (0.0, 10.0, 5, [0, 2, 4, 6, 8, 10]),
        (-1.1, 1.1, 5, [-1, -0.5, 0, 0.5, 1]),
        (0.0, 1.0, 4, [0, 0.25, 0.5, 0.75, 1]),
        (1e-6, 9e-6, 4, [2e-6, 4e-6, 6e-6, 8e-6]),
    ],
)
def test_ticks_are_round_numbers_within_the_range(low, high, most, expected):
    np.testing.assert_allclose(ticks(low, high, most), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("values", "words", "power"),
    [
        ([-0.5, 0.0, 0.5], ["\u22120.5", "0.0", "0.5"], ""),
        ([0.25, 0.5], ["0.25", "0.50"], ""),
        ([100, 200], ["100", "200"], ""),
        ([2e-5, 4e-5], ["2", "4"], "×10⁻⁵"),
        ([1e6, 2e6], ["1", "2"], "×10⁶"),
    ],
)
def test_numbers_beside_an_axis_have_the_decimals_of_their_step(values, words, power):
    assert tick_words(np.array(values, dtype=float)) == (words, power)


def test_a_curve_goes_through_its_points():
    assert 'd="M0.0 100.0L50.0 90.0L100.0 0.0"' in curve_svg(line((0, 0), (5, 1), (10, 10)), FRAME)


def test_a_value_that_is_not_finite_interrupts_a_curve():
    assert 'd="M0.0 100.0M20.0 80.0L30.0 70.0"' in curve_svg(line((0, 0), (1, np.nan), (2, 2), (3, 3)), FRAME)


def test_points_of_a_cloud_on_one_place_are_drawn_once():
    # In halves of a point: (20, 180), then 20 to the right and 40 up.
    x, y = np.array([2.0, 1.0, 1.0, np.nan]), np.array([3.0, 1.0, 1.0, 1.0])
    assert 'd="m20 180h0m20-40h0"' in cloud_svg(Cloud(x, y, "red", 1.0), FRAME)


def numbers(svg: str) -> list[float]:
    return [float(text.replace("\u2212", "-")) for text in texts(svg) if re.fullmatch(r"\u2212?[\d.]+", text)]


def test_panels_of_the_same_scale_show_the_range_of_all():
    panels = tuple(Panel("y", (line((0, -size), (1, size)),)) for size in (1.0, 4.0))
    assert numbers(chart(panels, "x", (6.0, 4.0), "two", same_scale=True)).count(2.5) == 2
    assert numbers(chart(panels, "x", (6.0, 4.0), "two")).count(2.5) == 1


def test_the_band_about_zero_is_within_the_range():
    # Twice as high as the curve, so the curve's axis has numbers beyond it.
    panel = Panel("y", (line((0, 0), (1, 1)),), band=2.0)
    assert {-2.0, 2.0} <= set(numbers(chart((panel,), "x", (6.0, 4.0), "one")))


def test_names_are_escaped():
    svg = chart((Panel("<a>", (line((0, 0), (1, 1), label="b & c"),)),), "x", (6.0, 4.0), 'a "title"')
    assert {"<a>", "b & c"} <= set(texts(svg))
    assert ET.fromstring(svg).get("aria-label") == 'a "title"'


def test_a_constant_has_axes_with_numbers_about_it():
    found = numbers(chart((Panel("y", (line((0, 3), (1, 3)),)),), "x", (6.0, 4.0), "flat"))
    assert min(number for number in found if number > 1.0) > 2.5
    assert 3.0 in found


def test_a_chart_of_nothing_is_drawn():
    empty = Curve(np.zeros(0), np.zeros(0), "red", 1.0)
    assert re.search(r"<text[^>]*>x</text>", chart((Panel("y", (empty,)),), "x", (6.0, 4.0), "empty"))


def test_bars_reach_half_an_interval_to_either_side():
    svg = curve_svg(line((5, 4), (8, 6), half=np.array([1.0, 2.0])), FRAME)
    assert 'd="M50.0 50.0V70.0M80.0 20.0V60.0"' in svg


def test_a_mark_shows_its_own_words():
    svg = curve_svg(line((5, 4), (6, np.nan), (8, 6), marked=True, tips=("a", "b", "<c>")), FRAME)
    assert re.findall(r'd="M([\d. ]+)h0".*?<title>(.*?)</title>', svg) == [
        ("50.0 60.0", "a"),
        ("80.0 40.0", "&lt;c&gt;"),
    ]


def test_bars_are_within_the_range():
    panel = Panel("y", (line((0, 1), (1, 1), half=np.array([3.0, 3.0])),))
    assert {-2.0, 4.0} <= set(numbers(chart((panel,), "x", (6.0, 4.0), "one")))


def test_names_stand_in_place_of_numbers_and_only_as_many_as_there_is_room_for():
    panel = Panel("y", (line(*((k, k) for k in range(40))),))
    days = chart((panel,), "x", (6.0, 4.0), "one", x_names=tuple(f"day{k}" for k in range(40)))
    shown = [words for words in texts(days) if words.startswith("day")]
    assert shown[:2] == ["day0", "day4"]
    two = chart((panel,), "x", (6.0, 4.0), "one", x_names=("before", "after"))
    assert {"before", "after"} <= set(texts(two))


@pytest.mark.parametrize(
    ("low", "high", "most", "words"),
    [
        (0.0, 1.0, 5, ["1", "2", "5", "10"]),
        (-1.1, 2.2, 5, ["0.1", "1", "10", "100"]),
        (-3.0, 3.0, 4, ["0.001", "0.1", "10", "1e+03"]),
    ],
)
def test_ticks_of_a_logarithmic_axis_are_round(low, high, most, words):
    # By hand.
    places, found = decade_ticks(low, high, most)
    assert found == words
    np.testing.assert_allclose(10.0**places, [float(word) for word in words])


def test_a_power_law_is_a_straight_line_on_logarithmic_axes():
    # Closed form: y = x^2 through 1, 10 and 100, so that the second point is half-way in both directions.
    panel = Panel("y", (line((1, 1), (10, 100), (100, 10000)),))
    svg = chart((panel,), "x", (6.0, 4.0), "one", logarithmic=True)
    (path,) = re.findall(r'd="M([\d. L]+)" fill="none" stroke="red"', svg)
    points = np.array([part.split() for part in path.split("L")], dtype=float)
    np.testing.assert_allclose(points[1], (points[0] + points[2]) / 2, atol=0.1)


def test_a_thinned_curve_keeps_a_spike_of_one_sample():
    y = np.zeros(20000)
    y[7777] = 5.0
    assert len(thinned(y)) <= 1000
    assert 7777 in thinned(y)


def test_a_short_curve_is_kept_whole():
    assert thinned(np.arange(10.0)).tolist() == list(range(10))


def test_a_jump_in_time_starts_a_new_stretch():
    assert gap_starts(np.array([0.0, 0.1, 0.2, 5.0, 5.1])).tolist() == [3]


def test_one_sample_has_no_jump():
    assert gap_starts(np.array([0.0])).tolist() == []


def test_the_eventful_stretch_holds_the_burst_and_stays_in_one_recording():
    t = np.concatenate([np.arange(0, 30, 0.01), np.arange(100, 130, 0.01)])
    residual = np.zeros(len(t))
    residual[np.searchsorted(t, 112.0) : np.searchsorted(t, 115.0)] = 1.0
    shown = t[largest_residual_section(t, residual, 10.0)]
    assert shown[0] <= 112.0
    assert shown[-1] >= 114.98
    assert 9.9 < shown[-1] - shown[0] <= 10.0


def test_a_recording_shorter_than_the_stretch_is_shown_whole():
    t = np.arange(0, 3, 0.01)
    assert largest_residual_section(t, np.ones(300), 10.0) == slice(0, 300)


def test_a_full_stretch_goes_before_a_short_but_violent_recording():
    t = np.concatenate([np.arange(0, 1, 0.01), np.arange(100, 130, 0.01)])
    assert t[largest_residual_section(t, np.where(t < 50, 9.0, 1.0), 10.0)][0] >= 100


def test_the_cloud_has_usable_samples_only_and_not_too_many():
    finite = np.arange(50000) % 2 == 0
    chosen = scatter_choice(finite)
    assert len(chosen) == 3000
    assert finite[chosen].all()


def test_the_median_over_velocity_mixes_no_two_directions():
    v = np.linspace(-1.03, 1.0, 4001)
    _, medians = binned_median(v, np.sign(v))
    assert set(medians) == {-1.0, 1.0}


def test_without_motion_there_is_no_median():
    assert len(binned_median(np.zeros(100), np.ones(100))[0]) == 0


def test_few_samples_get_few_bins_so_that_each_has_a_median():
    x = np.linspace(-1, 1, 150)
    centres, medians = binned_median(x, x)
    assert len(centres) >= 8
    assert medians == pytest.approx(centres, abs=0.1)
