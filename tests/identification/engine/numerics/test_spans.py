"""Spans of columns. Oracle: NumPy's rank and least squares."""

from __future__ import annotations

import numpy as np

from identification.engine.numerics.spans import orthonormal, without


def test_a_basis_has_as_many_columns_as_there_are_directions(rng):
    x = rng.normal(size=(30, 3))
    matrix = np.column_stack([x, 1e6 * x[:, 0] - x[:, 1], np.zeros(30)])
    basis = orthonormal(matrix, 1e-9)
    assert basis.shape == (30, np.linalg.matrix_rank(matrix))
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)


def test_no_columns_have_an_empty_basis():
    assert orthonormal(np.zeros((5, 2)), 1e-9).shape == (5, 0)


def test_what_is_outside_of_a_span_is_what_least_squares_leaves(rng):
    x, y = rng.normal(size=(30, 4)), rng.normal(size=(30, 2))
    np.testing.assert_allclose(without(y, orthonormal(x, 1e-9)), y - x @ np.linalg.lstsq(x, y)[0], atol=1e-12)
