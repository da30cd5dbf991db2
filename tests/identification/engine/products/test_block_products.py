"""Fits by products of blocks. Oracle: NumPy's least squares on the samples themselves."""

from __future__ import annotations

import numpy as np
import pytest

from identification.engine.products.block_products import BlockProducts, Free, block_products, left_of_each

COUNT, COLUMNS = 400, 12


@pytest.fixture
def samples(rng):
    x = rng.normal(size=(COUNT, COLUMNS))
    x[:, 5] += x[:, 2]
    return x, rng.normal(size=COUNT), np.arange(COUNT) // 50


def _products(samples) -> BlockProducts:
    x, y, blocks = samples
    return block_products(x, y, np.ones(COUNT), blocks, 8)


def test_losses_are_those_of_fits_that_have_not_seen_the_block(samples):
    x, y, blocks = samples
    at, expected = [0, 2, 5], []
    for b in range(8):
        values = np.linalg.lstsq(x[blocks != b][:, at], y[blocks != b])[0]
        expected.append(np.sum((y[blocks == b] - x[blocks == b][:, at] @ values) ** 2))
    np.testing.assert_allclose(_products(samples).losses(at), expected, rtol=1e-8)


def test_a_draw_has_the_coefficients_of_its_blocks_with_the_prior(samples, rng):
    x, y, blocks = samples
    counts = rng.integers(0, 3, (70, 8)).astype(float)
    precision, pull = np.diag(np.arange(COLUMNS, dtype=float)), np.ones(COLUMNS)
    found = _products(samples).of_draws(counts, precision, pull)
    for draw in (0, 69):
        weight = counts[draw][blocks]
        expected = np.linalg.solve(x.T @ (weight[:, None] * x) + precision, x.T @ (weight * y) + pull)
        np.testing.assert_allclose(found[draw], expected, rtol=1e-8)


def test_fits_of_a_fold_see_neither_it_nor_what_no_fit_may_see(samples):
    x, _, blocks = samples
    folds = np.array([0, 1, 0, 1, 0, 1, -1, -1])
    judged = {}
    for train, held_out in _products(samples).by_fold(folds):
        fold = int(folds[held_out[0]])
        seen = np.isin(blocks, np.flatnonzero((folds >= 0) & (folds != fold)))
        np.testing.assert_allclose(train.gram, x[seen].T @ x[seen])
        judged[fold] = held_out
    assert judged == {-1: [6, 7], 0: [0, 2, 4], 1: [1, 3, 5]}


def test_a_column_twice_predicts_what_it_does_once(samples):
    x, y, blocks = samples
    twice = block_products(np.column_stack([x[:, 0], x[:, 0]]), y, np.ones(COUNT), blocks, 8)
    np.testing.assert_allclose(twice.losses([0, 1]), _products(samples).losses([0]), rtol=1e-8)


def test_what_is_left_of_each_sample_squares_up_to_the_losses(samples):
    x, y, blocks = samples
    products, at = _products(samples), [1, 7]
    left = left_of_each(x[:, at], y, blocks, products.without_each(at))
    np.testing.assert_allclose([np.sum(left[blocks == b] ** 2) for b in range(8)], products.losses(at), rtol=1e-8)


def test_what_may_move_is_fitted_beside_every_choice_with_its_prior(samples):
    x, y, _ = samples
    free = Free(np.diag([3.0, 5.0]), np.array([1.0, -2.0]))
    products = _products(samples).summed(np.ones(8))
    a = x.T @ x + np.diag([*np.zeros(10), 3.0, 5.0])
    whole = np.linalg.solve(a[np.ix_([1, 10, 11], [1, 10, 11])], (x.T @ y + [*np.zeros(10), 1.0, -2.0])[[1, 10, 11]])
    theta = free.taken_out(products).fitted([1])
    np.testing.assert_allclose(theta, whole[:1], rtol=1e-6)
    np.testing.assert_allclose(free.beside(products, [1], theta), whole[1:], rtol=1e-6)


def test_a_column_of_which_no_drawn_block_has_anything_has_no_coefficient(samples):
    # By hand: beside it, the other column has the coefficient that it has alone.
    x, y, blocks = samples
    once = np.where(blocks == 3, x[:, 1], 0.0)
    drawn = np.where(np.arange(8) == 3, 0.0, 1.0)
    found = block_products(np.column_stack([x[:, 0], once]), y, np.ones(COUNT), blocks, 8).summed(drawn).fitted([0, 1])
    np.testing.assert_allclose(found, [*_products(samples).summed(drawn).fitted([0]), 0.0], rtol=1e-12)
