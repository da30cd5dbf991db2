from __future__ import annotations

import math

import pytest

from identification.diagnosis.result import Value
from identification.words.numbers_and_names import NO_BREAK, number, percent, value_words, with_std


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.001, "under 1 %"), (-0.001, "under 1 %"), (0.0, "0 %"), (-0.2, "-20 %"), (1.3, "130 %"), (math.nan, "–")],
)
def test_a_share_is_never_rounded_to_none_or_all(share, text):
    assert percent(share).replace(NO_BREAK, " ") == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (Value(0.051, 0.0006, "N m"), "0.05100 ± 0.00060 N m"),
        (Value(95.1, 1.234, "kg"), "95.1 ± 1.2 kg"),
        (Value(-12.0, 340.0, "N"), "-12 ± 340 N"),
        (Value(1.02, 0.004, "1"), "1.0200 ± 0.0040"),
        (Value(2.5e-6, 3e-7, "kg m^2"), "(2.50 ± 0.30)e-6 kg m^2"),
        (Value(0.25, math.nan, "N m"), "0.25 N m"),
        (Value(0.25, 0.0, "N m"), "0.25 N m"),
        (Value([6.0, 12.0], [0.0, 0.1], "1/rev"), "6, 12.00 ± 0.10 1/rev"),
    ],
)
def test_a_value_is_shown_to_the_second_digit_of_its_deviation(value, text):
    assert value_words(value) == text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (5873.4, 3, "5870"),
        (1704.0, 2, "1700"),
        (123456.0, 3, "123000"),
        (2.5e7, 3, "2.5e+07"),
        (0.0607, 2, "0.061"),
        (6.07e-5, 3, "6.07e-05"),
        (-1234.5, 3, "-1230"),
        (float("inf"), 3, "–"),
    ],
)
def test_a_number_has_no_exponent_where_it_reads_better_without(value, digits, text):
    assert number(value, digits) == text


def test_a_number_that_rounds_to_zero_has_no_sign():
    assert with_std(-0.001, 0.15) == "0.00 ± 0.15"
