"""The filter that keeps some samples, against scipy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import firwin, oaconvolve

from phantom_dyn._kernels.fir import filtered

KERNEL = np.array(firwin(31, 0.2), dtype=float)


@pytest.mark.parametrize("step", [1, 3, 7])
def test_samples_that_are_kept_are_those_of_a_whole_convolution(step):
    rng = np.random.default_rng(4)
    x, kernel = rng.normal(size=(200, 3)), KERNEL
    whole = np.array(oaconvolve(x, kernel[:, None], mode="valid", axes=0))
    np.testing.assert_allclose(filtered(kernel, x, step), whole[::step], atol=1e-14)


def test_a_record_shorter_than_the_kernel_has_no_sample_inside():
    assert filtered(KERNEL, np.ones((30, 2)), 2).shape == (0, 2)


@pytest.mark.parametrize("step", [1, 4])
def test_a_column_does_not_depend_on_its_neighbours(step):
    # Oracle: the column alone, to the last digit; a product of all columns rounds by how many there are.
    x = np.random.default_rng(5).normal(size=(1000, 7))
    together = filtered(KERNEL, x, step)
    for column in range(7):
        np.testing.assert_array_equal(together[:, column], filtered(KERNEL, x[:, [column]], step)[:, 0])
