"""The oracles are least squares on the samples themselves and a known truth."""

from __future__ import annotations

import numpy as np
import pytest

from identification.engine.products.block_products import block_products
from identification.engine.search.stepwise import Terms, gains, squares, stepwise

COUNT, COLUMNS = 400, 12


@pytest.fixture
def samples(rng):
    x = rng.normal(size=(COUNT, COLUMNS))
    x[:, 5] += x[:, 2]
    return x, np.arange(COUNT) // 50


def _single(count: int) -> Terms:
    return Terms(np.arange(count), np.arange(count))


def test_the_true_terms_are_chosen_although_another_one_is_best_alone(samples, rng):
    x, blocks = samples
    x[:, 9] = x[:, 1] + x[:, 4] + 0.3 * rng.normal(size=COUNT)
    y = x[:, 1] + x[:, 4] + 0.01 * rng.normal(size=COUNT)
    products = block_products(x, y, np.ones(COUNT), blocks, 8).summed(np.ones(8))
    assert int(np.argmax(gains(_single(COLUMNS), products, ()))) == 9
    assert set(stepwise(_single(COLUMNS), products, 2)[1]) == {1, 4}


def test_the_gain_of_a_pair_of_columns_is_what_least_squares_takes_off(samples, rng):
    x, blocks = samples
    y = rng.normal(size=COUNT)
    products = block_products(x, y, np.ones(COUNT), blocks, 8).summed(np.ones(8))
    terms = Terms(np.array([0, 2, 4]), np.array([0, 3, 5]))
    before = np.linalg.lstsq(x[:, [0]], y)[1][0]
    after = np.linalg.lstsq(x[:, [0, 4, 5]], y)[1][0]
    assert gains(terms, products, (0,))[2] == pytest.approx(before - after, rel=1e-6)


def test_squares_are_those_that_least_squares_leaves(samples, rng):
    x, blocks = samples
    y = rng.normal(size=COUNT)
    products = block_products(x, y, np.ones(COUNT), blocks, 8).summed(np.ones(8))
    assert squares(_single(COLUMNS), products, (3, 7)) == pytest.approx(np.linalg.lstsq(x[:, [3, 7]], y)[1][0])
