"""Times in sentences. Oracle: the times themselves."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.times import time_text, when


@pytest.mark.parametrize(
    ("time", "text"),
    [(0.0, "0"), (2e-5, "2e-05"), (1.0400001, "1.04"), (123.4567, "123.457"), (2000.0, "2000"), (86400.25, "86400.25")],
)
def test_a_time_has_six_digits(time, text):
    assert time_text(time) == text


@pytest.mark.parametrize("time", [1.7e9, 1.7e9 + 0.123, 1732589710.5])
def test_a_time_since_1970_is_told_to_the_millisecond(time):
    assert float(time_text(time)) == pytest.approx(time, abs=1e-3)
    assert "e" not in time_text(time)


def test_of_many_times_the_first_five_are_named():
    assert when(np.arange(7) / 2) == "at t = 0, 0.5, 1, 1.5, 2 s and 2 more"
