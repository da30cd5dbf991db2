"""Products of the engine: blocks, Gram matrices, rows, triangles."""

from dataclasses import replace

import numpy as np
import pytest

from identification.engine.products import row_products
from identification.engine.products.block_products import (
    BlockProducts,
    NuisancePrior,
    block_products,
    held_out_residual,
)
from identification.engine.products.blocks import FOLDS, Block, assign_folds
from identification.engine.products.grams import Weights, all_row_grams, row_grams, summed
from identification.engine.products.row_products import RowProducts
from identification.engine.products.triangles import diagonal, places_in, square, triangle

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
    left = held_out_residual(x[:, at], y, blocks, products.fits_without_each(at))
    np.testing.assert_allclose([np.sum(left[blocks == b] ** 2) for b in range(8)], products.losses(at), rtol=1e-8)


def test_what_may_move_is_fitted_beside_every_choice_with_its_prior(samples):
    x, y, _ = samples
    prior = NuisancePrior(np.diag([3.0, 5.0]), np.array([1.0, -2.0]))
    products = _products(samples).summed(np.ones(8))
    a = x.T @ x + np.diag([*np.zeros(10), 3.0, 5.0])
    whole = np.linalg.solve(a[np.ix_([1, 10, 11], [1, 10, 11])], (x.T @ y + [*np.zeros(10), 1.0, -2.0])[[1, 10, 11]])
    theta = prior.eliminate_from(products).fitted([1])
    np.testing.assert_allclose(theta, whole[:1], rtol=1e-6)
    np.testing.assert_allclose(prior.fitted_with(products, [1], theta), whole[1:], rtol=1e-6)


def test_a_column_of_which_no_drawn_block_has_anything_has_no_coefficient(samples):
    # By hand: beside it, the other column has the coefficient that it has alone.
    x, y, blocks = samples
    once = np.where(blocks == 3, x[:, 1], 0.0)
    drawn = np.where(np.arange(8) == 3, 0.0, 1.0)
    found = block_products(np.column_stack([x[:, 0], once]), y, np.ones(COUNT), blocks, 8).summed(drawn).fitted([0, 1])
    np.testing.assert_allclose(found, [*_products(samples).summed(drawn).fitted([0]), 0.0], rtol=1e-12)


def test_blocks_of_a_log_that_is_held_out_have_no_fold(two):
    assert [fold < 0 for fold in two.folds] == [block.log == 1 for block in two.blocks]


def test_folds_take_turns_so_that_each_covers_the_recording(two):
    folds = assign_folds(two.blocks, np.zeros(2, dtype=bool))
    np.testing.assert_array_equal(folds, np.arange(len(two.blocks)) % FOLDS)


def test_a_weight_counts_noise_and_its_colour():
    weights = Weights(np.array([0.1, 2.0]), np.array([1.0, 5.0]))
    np.testing.assert_allclose(weights.per_sample, [100.0, 0.05])


def gram_samples(two, row: int, block: Block, first: int) -> tuple[np.ndarray, np.ndarray]:
    """Usable columns and residual of one row, from some sample of a block on."""
    part = slice(first, block.stop)
    use = two.white.usable[block.log][part, row]
    return two.white.values[block.log][row][part][use], two.white.residual[block.log][part, row][use]


@pytest.mark.parametrize("row", [0, 1])
def test_products_of_a_row_are_those_of_its_usable_samples(two, row):
    # Brute force: weighted sums over the samples of one block.
    grams, weight = row_grams(two.white, two.blocks, two.folds, two.weights, row), two.weights.per_sample[row]
    for k in (0, 3, len(two.blocks) - 1):
        x, y = gram_samples(two, row, two.blocks[k], two.blocks[k].start)
        np.testing.assert_allclose(grams.b[k], weight * x.T @ y, rtol=1e-9, atol=1e-9)
        assert grams.c[k] == pytest.approx(weight * y @ y)
        x, y = gram_samples(two, row, two.blocks[k], two.blocks[k].core)
        np.testing.assert_allclose(square(grams.core_a[k]), weight * x.T @ x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(grams.core_b[k], weight * x.T @ y, rtol=1e-9, atol=1e-9)
        assert grams.core_c[k] == pytest.approx(weight * y @ y)


def test_a_sample_counts_with_the_square_of_its_trust(two, rng):
    # Brute force: products of columns and residual that are multiplied by the trust.
    trust = tuple(rng.uniform(0.1, 1.0, use.shape) for use in two.white.usable)
    grams = row_grams(two.white, two.blocks, two.folds, replace(two.weights, trust=trust), 1)
    for k, block in enumerate(two.blocks[:3]):
        use = two.white.usable[block.log][block.core : block.stop, 1]
        scale = replace(two.weights, trust=trust).scale(block.log, slice(block.core, block.stop))[use, 1]
        x, y = gram_samples(two, 1, block, block.core)
        np.testing.assert_allclose(grams.core_b[k], (x * scale[:, None]).T @ (y * scale), rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(
            scale**2, two.weights.per_sample[1] * trust[block.log][block.core : block.stop, 1][use] ** 2
        )


@pytest.mark.parametrize("fold", [0, 2, -1])
def test_products_of_a_fold_are_those_of_its_blocks(two, fold):
    # Brute force; fold -1 are the blocks that no fit may see.
    grams, weight = row_grams(two.white, two.blocks, two.folds, two.weights, 1), two.weights.per_sample[1]
    mine = [block for block, own in zip(two.blocks, two.folds, strict=True) if own == fold]
    parts = [gram_samples(two, 1, block, block.start)[0] for block in mine]
    assert parts
    np.testing.assert_allclose(square(grams.a[fold]), weight * sum(x.T @ x for x in parts), rtol=1e-9, atol=1e-9)


def test_rows_add_up(two, rng):
    # For any coefficients the summed products give the loss of all rows.
    rows = all_row_grams(two.white, two.blocks, two.folds, two.weights)
    grams = summed(len(two.white.names), rows, two.folds, np.arange(len(two.white.tolerance_parameters)))
    theta = rng.normal(size=len(two.white.names)) * 1e-3
    mine = np.flatnonzero(two.folds == 1)
    expected = 0.0
    for k in mine:
        block = two.blocks[k]
        part = slice(block.start, block.stop)
        for j, index in enumerate(two.white.rows):
            error = two.white.residual[block.log][part, j] - two.white.values[block.log][j][part] @ theta[list(index)]
            expected += two.weights.per_sample[j] * np.sum(error[two.white.usable[block.log][part, j]] ** 2)
    whole = grams.fold_a.among(np.arange(len(theta)))[1]
    found = grams.c[mine].sum() - 2 * grams.b[mine].sum(axis=0) @ theta + theta @ whole @ theta
    assert found == pytest.approx(expected)


def test_the_count_of_a_core_is_the_number_of_its_independent_samples(two):
    rows = all_row_grams(two.white, two.blocks, two.folds, two.weights)
    grams = summed(len(two.white.names), rows, two.folds, np.arange(len(two.white.tolerance_parameters)))
    block = two.blocks[2]
    use = two.white.usable[block.log][block.core : block.stop]
    assert grams.count[2] == pytest.approx((use.sum(axis=0) / two.weights.spread).sum())


ROW_COLUMNS, BLOCKS, ALWAYS = 20, 5, 4


@pytest.fixture
def kept(rng) -> RowProducts:
    """Three rows; the first four columns touch all, the fifth touches none."""
    index = tuple(np.array([*range(ALWAYS), *np.sort(5 + rng.choice(15, 8, replace=False))]) for _ in range(3))
    values = []
    for columns in index:
        x = rng.normal(size=(BLOCKS, 40, len(columns)))
        values.append(triangle(x.transpose(0, 2, 1) @ x, places_in(len(columns), len(columns))))
    return RowProducts(index, tuple(values), ROW_COLUMNS, np.arange(ALWAYS))


@pytest.fixture
def written(kept) -> np.ndarray:
    out = np.zeros((BLOCKS, ROW_COLUMNS, ROW_COLUMNS))
    for index, values in zip(kept.index, kept.values, strict=True):
        for block in range(BLOCKS):
            lower = np.zeros((len(index), len(index)))
            lower[np.tril_indices(len(index))] = values[block]
            out[block][np.ix_(index, index)] += lower + np.tril(lower, -1).T
    return out


@pytest.mark.parametrize(
    "columns", [[0, 1, 2, 3], [0, 1, 2, 3, 6, 11, 19], [0, 1, 2, 3, 4, 5], [2, 5, 17], [4], []], ids=str
)
def test_products_among_some_columns(kept, written, columns):
    columns = np.array(columns, dtype=int)
    np.testing.assert_allclose(kept.among(columns), written[:, columns[:, None], columns], rtol=1e-13)


def test_products_of_some_columns_with_all(kept, written):
    some, every = np.array([1, 4, 13]), np.arange(ROW_COLUMNS)
    np.testing.assert_allclose(kept.between(some, every), written[:, some], rtol=1e-13)
    assert kept.shape == written.shape


def test_products_over_all_blocks(kept, written):
    np.testing.assert_allclose(kept.total(), written.sum(axis=0), rtol=1e-12)


def test_products_within_groups_of_columns(kept, written):
    groups = np.array([[0, 4], [7, 1], [13, 14]])
    expected = [[block[np.ix_(own, own)] for own in groups] for block in written]
    np.testing.assert_allclose(kept.within(groups), expected, rtol=1e-12)


def test_the_compiled_sum_is_that_of_the_same_function_in_python(kept, monkeypatch):
    columns = np.array([0, 1, 2, 3, 7, 9, 14])
    compiled = kept.among(columns)
    monkeypatch.setattr(row_products, "_add", getattr(row_products._add, "py_func", row_products._add))
    plain = RowProducts(kept.index, kept.values, ROW_COLUMNS, np.arange(ALWAYS)).among(columns)
    np.testing.assert_array_equal(compiled, plain)


def test_products_summed_over_groups_leave_out_what_is_in_none(kept, written):
    grouped = kept.grouped(np.array([0, 1, -1, 0, 1])).among(np.arange(ROW_COLUMNS))
    np.testing.assert_allclose(grouped[0], written[[0, 3]].sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(grouped[1], written[[1, 4]].sum(axis=0), rtol=1e-12)


@pytest.mark.parametrize("columns", [[0, 1, 2, 3, 6, 11, 19], [5, 2, 17], [4], []], ids=str)
def test_squares_of_each_block_are_those_of_the_products_written_out(kept, written, rng, columns):
    x = rng.normal(size=(BLOCKS, len(columns)))
    expected = [y @ part[np.ix_(columns, columns)] @ y for y, part in zip(x, written, strict=True)]
    np.testing.assert_allclose(kept.squares(np.array(columns, dtype=int), x), expected, rtol=1e-11)


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
