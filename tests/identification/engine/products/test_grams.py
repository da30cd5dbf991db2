"""Gram matrices by block and fold: against products of the samples themselves."""

from __future__ import annotations

import numpy as np
import pytest

from identification.engine.products.blocks import Block
from identification.engine.products.grams import Weights, all_row_grams, row_grams, summed
from identification.engine.products.triangles import square


@pytest.fixture(scope="module")
def two(lab, planar2):
    """Two recordings of different length; no fit sees the second."""
    recordings = (
        lab.recording(planar2, lab.motion(2, 1, seconds=16.0)),
        lab.recording(planar2, lab.motion(2, 2, seconds=7.0), seed=1),
    )
    return lab.prepared(planar2, recordings, held_out=1)


def test_a_weight_counts_noise_and_its_colour():
    weights = Weights(np.array([0.1, 2.0]), np.array([1.0, 5.0]))
    np.testing.assert_allclose(weights.per_sample, [100.0, 0.05])


def samples(two, row: int, block: Block, first: int) -> tuple[np.ndarray, np.ndarray]:
    """Usable columns and residual of one row, from some sample of a block on."""
    part = slice(first, block.stop)
    use = two.white.usable[block.log][part, row]
    return two.white.values[block.log][row][part][use], two.white.residual[block.log][part, row][use]


@pytest.mark.parametrize("row", [0, 1])
def test_products_of_a_row_are_those_of_its_usable_samples(two, row):
    # Brute force: weighted sums over the samples of one block.
    grams, weight = row_grams(two.white, two.blocks, two.folds, two.weights, row), two.weights.per_sample[row]
    for k in (0, 3, len(two.blocks) - 1):
        x, y = samples(two, row, two.blocks[k], two.blocks[k].start)
        np.testing.assert_allclose(grams.b[k], weight * x.T @ y, rtol=1e-9, atol=1e-9)
        assert grams.c[k] == pytest.approx(weight * y @ y)
        x, y = samples(two, row, two.blocks[k], two.blocks[k].core)
        np.testing.assert_allclose(square(grams.core_a[k]), weight * x.T @ x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(grams.core_b[k], weight * x.T @ y, rtol=1e-9, atol=1e-9)
        assert grams.core_c[k] == pytest.approx(weight * y @ y)


@pytest.mark.parametrize("fold", [0, 2, -1])
def test_products_of_a_fold_are_those_of_its_blocks(two, fold):
    # Brute force; fold -1 are the blocks that no fit may see.
    grams, weight = row_grams(two.white, two.blocks, two.folds, two.weights, 1), two.weights.per_sample[1]
    mine = [block for block, own in zip(two.blocks, two.folds, strict=True) if own == fold]
    parts = [samples(two, 1, block, block.start)[0] for block in mine]
    assert parts
    np.testing.assert_allclose(square(grams.a[fold]), weight * sum(x.T @ x for x in parts), rtol=1e-9, atol=1e-9)


def test_rows_add_up(two, rng):
    # For any coefficients the summed products give the loss of all rows.
    rows = all_row_grams(two.white, two.blocks, two.folds, two.weights)
    grams = summed(len(two.white.names), rows, two.folds, np.arange(len(two.white.nuisances)))
    theta = rng.normal(size=len(two.white.names)) * 1e-3
    mine = np.flatnonzero(two.folds == 1)
    expected = 0.0
    for k in mine:
        block = two.blocks[k]
        part = slice(block.start, block.stop)
        for j, index in enumerate(two.white.rows):
            error = two.white.residual[block.log][part, j] - two.white.values[block.log][j][part] @ theta[list(index)]
            expected += two.weights.per_sample[j] * np.sum(error[two.white.usable[block.log][part, j]] ** 2)
    found = grams.c[mine].sum() - 2 * grams.b[mine].sum(axis=0) @ theta + theta @ grams.fold_a[1] @ theta
    assert found == pytest.approx(expected)


def test_the_count_of_a_core_is_the_number_of_its_independent_samples(two):
    rows = all_row_grams(two.white, two.blocks, two.folds, two.weights)
    grams = summed(len(two.white.names), rows, two.folds, np.arange(len(two.white.nuisances)))
    block = two.blocks[2]
    use = two.white.usable[block.log][block.core : block.stop]
    assert grams.count[2] == pytest.approx((use.sum(axis=0) / two.weights.spread).sum())
