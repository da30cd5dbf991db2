"""Windows that move over samples, against scipy.ndimage, whose import a command does without."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from phantom_dyn.signals.windows import highest, lowest, moving_mean, moving_median

WIDTHS = [1, 2, 3, 4, 7, 8, 64, 101, 299, 300, 301, 1000]


@pytest.fixture
def x(rng):
    return np.cumsum(rng.normal(size=300))


@pytest.mark.parametrize("width", WIDTHS)
def test_extremes_are_those_of_scipy(x, width):
    np.testing.assert_array_equal(highest(x, width), ndimage.maximum_filter1d(x, width))
    np.testing.assert_array_equal(lowest(x, width), ndimage.minimum_filter1d(x, width))


@pytest.mark.parametrize("width", WIDTHS)
def test_extremes_of_columns_and_of_truth_are_those_of_scipy(x, width):
    true = np.column_stack([x > np.quantile(x, 0.95), x < 0.0])
    wanted = ndimage.maximum_filter1d(true.astype(np.uint8), width, axis=0) > 0
    np.testing.assert_array_equal(highest(true, width), wanted)


@pytest.mark.parametrize("width", WIDTHS[:-1])
def test_the_mean_is_that_of_scipy(x, width):
    np.testing.assert_allclose(moving_mean(x, width), ndimage.uniform_filter1d(x, width, mode="nearest"), atol=1e-10)


@pytest.mark.parametrize("edges", ["nearest", "reflect"])
@pytest.mark.parametrize("width", [1, 3, 65, 299, 901])
def test_the_median_is_that_of_scipy(x, width, edges):
    np.testing.assert_array_equal(moving_median(x, width, edges), ndimage.median_filter(x, width, mode=edges))


def test_one_sample_is_its_own_window():
    one = np.array([3.0])
    for found in (highest(one, 5), lowest(one, 5), moving_mean(one, 1), moving_median(one, 5)):
        np.testing.assert_array_equal(found, one)
