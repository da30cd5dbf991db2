"""Errors of poses that no fit has seen, and noise in time. Oracle: NumPy's least squares without each block; the
correlation that was put in."""

from __future__ import annotations

import numpy as np
import pytest

from identification.geometry.equations import Equations
from identification.geometry.held_out import blocks_of, left_of_rows
from identification.geometry.whitened import Noise, noise_of, whitened


@pytest.fixture
def equations(rng) -> Equations:
    """Two hundred poses with three nuisances and four terms."""
    rows = 600
    nuisance, columns = rng.standard_normal((rows, 3)), rng.standard_normal((rows, 4))
    left = nuisance @ [1.0, 2.0, 3.0] + columns @ [0.5, 0, 0, 0] + 0.1 * rng.standard_normal(rows)
    return Equations(left, nuisance, columns, (), np.repeat(np.arange(200), 3), np.zeros(rows, dtype=int))


UNITS, NAMES = ("m",) * 4, ("a", "b", "c", "d")


def _whitened(equations: Equations):
    block, kept = equations.pose // 20, np.ones(600, dtype=bool)
    return whitened(equations, np.zeros(4), Noise(np.ones(2), np.ones(2), 500.0), block, kept, (UNITS, NAMES))


def test_losses_are_those_of_fits_that_have_not_seen_the_block(equations):
    found = _whitened(equations)
    matrix, y, block = np.hstack([equations.nuisance, equations.columns[:, [0, 2]]]), equations.left, found.block
    expected = []
    for b in range(10):
        values = np.linalg.lstsq(matrix[block != b], y[block != b])[0]
        expected.append(np.sum((y[block == b] - matrix[block == b] @ values) ** 2))
    np.testing.assert_allclose(blocks_of(found).losses((0, 2)), expected, rtol=1e-8)


def test_what_is_left_of_each_pose_squares_up_to_the_losses(equations):
    found = _whitened(equations)
    blocks = blocks_of(found)
    left = left_of_rows(found, blocks, (1,))
    sums = [np.sum(left[found.block == b] ** 2) for b in range(10)]
    np.testing.assert_allclose(blocks.losses((1,)), sums, rtol=1e-8)


def test_noise_is_what_all_columns_together_leave(equations):
    noise = noise_of(equations, UNITS, NAMES, np.zeros(2, dtype=bool), np.ones(600, dtype=bool))
    assert noise.sigma[0] == pytest.approx(0.1, rel=0.1)
    assert noise.free == pytest.approx(600 - 7)


def test_noise_that_lasts_counts_for_as_many_poses_fewer(equations, rng):
    # First order with 0.8 from pose to pose: variances of means grow by (1 + 0.8) / (1 - 0.8) = 9.
    slow = np.zeros((4000, 3))
    for k in range(1, 4000):
        slow[k] = 0.8 * slow[k - 1] + rng.standard_normal(3)
    n = 12000
    long = Equations(
        slow.ravel(), np.ones((n, 1)), np.zeros((n, 4)), (), np.repeat(np.arange(4000), 3), np.zeros(n, dtype=int)
    )
    noise = noise_of(long, UNITS, NAMES, np.ones(2, dtype=bool), np.ones(n, dtype=bool))
    assert noise.slow[0] == pytest.approx(9.0, rel=0.3)
