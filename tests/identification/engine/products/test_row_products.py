"""Products kept row by row: against the same written out block by block."""

from __future__ import annotations

import numpy as np
import pytest

from identification.engine.products import row_products
from identification.engine.products.row_products import RowProducts
from identification.engine.products.triangles import places_in, triangle

COLUMNS, BLOCKS, ALWAYS = 20, 5, 4


@pytest.fixture
def kept(rng) -> RowProducts:
    """Three rows; the first four columns touch all, the fifth touches none."""
    index = tuple(np.array([*range(ALWAYS), *np.sort(5 + rng.choice(15, 8, replace=False))]) for _ in range(3))
    values = []
    for columns in index:
        x = rng.normal(size=(BLOCKS, 40, len(columns)))
        values.append(triangle(x.transpose(0, 2, 1) @ x, places_in(len(columns), len(columns))))
    return RowProducts(index, tuple(values), COLUMNS, np.arange(ALWAYS))


@pytest.fixture
def written(kept) -> np.ndarray:
    out = np.zeros((BLOCKS, COLUMNS, COLUMNS))
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


def test_products_written_out(kept, written):
    assert kept.shape == written.shape
    np.testing.assert_allclose(np.asarray(kept), written, rtol=1e-13)
    np.testing.assert_allclose(kept[3], written[3], rtol=1e-13)
    late = np.array([False, False, True, False, True])
    np.testing.assert_allclose(kept[late], written[late], rtol=1e-13)


def test_products_of_some_columns_with_all(kept, written):
    np.testing.assert_allclose(kept[:, [1, 4, 13]], written[:, [1, 4, 13]], rtol=1e-13)


def test_products_over_all_blocks(kept, written):
    np.testing.assert_allclose(kept.sum(axis=0), written.sum(axis=0), rtol=1e-12)


def test_products_within_groups_of_columns(kept, written):
    groups = np.array([[0, 4], [7, 1], [13, 14]])
    expected = [[block[np.ix_(own, own)] for own in groups] for block in written]
    np.testing.assert_allclose(kept.within(groups), expected, rtol=1e-12)


def test_the_compiled_sum_is_that_of_the_same_function_in_python(kept, monkeypatch):
    columns = np.array([0, 1, 2, 3, 7, 9, 14])
    compiled = kept.among(columns)
    monkeypatch.setattr(row_products, "_add", getattr(row_products._add, "py_func", row_products._add))
    plain = RowProducts(kept.index, kept.values, COLUMNS, np.arange(ALWAYS)).among(columns)
    np.testing.assert_array_equal(compiled, plain)


def test_products_summed_over_groups_leave_out_what_is_in_none(kept, written):
    grouped = kept.grouped(np.array([0, 1, -1, 0, 1]))
    np.testing.assert_allclose(grouped[0], written[[0, 3]].sum(axis=0), rtol=1e-12)
    np.testing.assert_allclose(grouped[1], written[[1, 4]].sum(axis=0), rtol=1e-12)


@pytest.mark.parametrize("columns", [[0, 1, 2, 3, 6, 11, 19], [5, 2, 17], [4], []], ids=str)
def test_squares_of_each_block_are_those_of_the_products_written_out(kept, written, rng, columns):
    x = rng.normal(size=(BLOCKS, len(columns)))
    expected = [y @ part[np.ix_(columns, columns)] @ y for y, part in zip(x, written, strict=True)]
    np.testing.assert_allclose(kept.squares(np.array(columns, dtype=int), x), expected, rtol=1e-11)
