"""Lower triangles of symmetric matrices: against the matrices written out."""

from __future__ import annotations

import numpy as np
import pytest

from identification.engine.products.triangles import diagonal, places_in, square, triangle


@pytest.fixture
def whole(rng) -> np.ndarray:
    """Two symmetric matrices of seven lines."""
    x = rng.normal(size=(2, 7, 7))
    return x + x.transpose(0, 2, 1)


@pytest.mark.parametrize("size", [1, 2, 6, 7])
def test_a_triangle_written_out_is_the_matrix(whole, size):
    np.testing.assert_array_equal(square(triangle(whole, places_in(7, size))), whole[:, :size, :size])


def test_some_lines_are_those_of_the_matrix_in_any_order(whole):
    chosen = np.array([5, 0, 3])
    np.testing.assert_array_equal(square(triangle(whole, places_in(7, 7)), chosen), whole[:, chosen[:, None], chosen])


def test_the_diagonal_is_that_of_the_matrix(whole):
    chosen = np.array([6, 2])
    np.testing.assert_array_equal(diagonal(triangle(whole, places_in(7, 7)), chosen), whole[:, chosen, chosen])
