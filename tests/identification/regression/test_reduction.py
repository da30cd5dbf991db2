"""Reductions against a full QR decomposition and `numpy.linalg.lstsq` of the same rows."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_triangular

from identification.estimators.fit import base_of_reduction, refit
from identification.regression import reduction as reduction_stream
from identification.regression.base_parameters import base_parameters_of_matrix
from identification.regression.reduction import Reduction, combined, reduce_blocks
from identification.regression.triangular import dependent_columns, r_factor, triangular
from phantom_dyn.errors import IdentifiabilityError, ParameterError

Array = np.ndarray

FEW = 16
"""Rows taken in at once in these tests, so that small recordings are long ones."""


def reduced(W: Array, y: Array, columns: tuple[tuple[int, ...], ...] | None = None, block: int = 37) -> Reduction:
    """Reduction of ``W (N, nv, p)`` and ``y (N, nv)`` that come in blocks."""
    _, nv, p = W.shape
    own = columns or (tuple(range(p)),) * nv
    names = tuple(f"c{k}" for k in range(p))
    blocks = ((W[k : k + block], y[k : k + block]) for k in range(0, len(W), block))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reduction_stream, "ROWS", FEW)
        return reduce_blocks(names, ("",) * p, tuple(f"j{k}" for k in range(nv)), own, blocks)


def stacked(W: Array, y: Array) -> Array:
    return np.column_stack([W.reshape(-1, W.shape[2]), y.reshape(-1)])


def assert_same_products(factor: Array, rows: Array):
    size = np.linalg.norm(rows, axis=0)
    np.testing.assert_allclose(factor.T @ factor, rows.T @ rows, atol=1e-12 * max(1e-300, np.outer(size, size).max()))


def serial(rng: np.random.Generator, samples: int, nv: int, p: int, rank: int) -> tuple[Array, Array, tuple]:
    """Rows as those of a serial chain: joint j sees the columns from its own on; of all, ``rank`` are independent."""
    mixed = rng.normal(size=(rank, p))
    W = np.zeros((samples, nv, p))
    columns = tuple(tuple(range(j * p // nv, p)) for j in range(nv))
    for joint, own in enumerate(columns):
        W[:, joint, own] = rng.normal(size=(samples, rank)) @ mixed[:, own]
    return W, rng.normal(size=(samples, nv)), columns


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 150), st.integers(1, 3), st.integers(1, 8), st.integers(0, 8))
def test_it_has_the_products_of_all_rows_whatever_their_number_and_rank(seed, samples, nv, p, rank):
    W, y, columns = serial(np.random.default_rng(seed), samples, nv, p, min(rank, p))
    assert_same_products(reduced(W, y, columns).factor(), stacked(W, y))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 10**6), st.integers(30, 120))
def test_a_relation_that_later_rows_break_is_not_believed(seed, breaks):
    # The first rows say that columns 1 and 3 are those before them; from some row on they are not.
    rng = np.random.default_rng(seed)
    W = rng.normal(size=(160, 2, 5))
    W[:breaks, :, 1], W[:breaks, :, 3] = 2.0 * W[:breaks, :, 0], W[:breaks, :, 2] - W[:breaks, :, 0]
    y = rng.normal(size=(160, 2))
    assert_same_products(reduced(W, y).factor(), stacked(W, y))


def test_a_break_of_one_in_a_million_in_one_row_is_seen(rng):
    W = rng.normal(size=(400, 1, 3))
    W[:, 0, 2] = W[:, 0, 0] + W[:, 0, 1]
    W[333, 0, 2] += 1e-6
    factor = reduced(W, np.zeros((400, 1))).factor()[:, :3]
    least = np.linalg.svd(W[:, 0], compute_uv=False)[-1]
    assert least > 0
    assert np.linalg.svd(factor, compute_uv=False)[-1] == pytest.approx(least, rel=1e-5)


def conditioned(rng: np.random.Generator, samples: int, p: int, condition: float) -> Array:
    left = np.linalg.qr(rng.normal(size=(samples, p)))[0]
    right = np.linalg.qr(rng.normal(size=(p, p)))[0]
    return (left * np.geomspace(1.0, 1.0 / condition, p)) @ right


def test_singular_values_of_rows_with_condition_1e8_are_those_of_the_rows(rng):
    # A Gram matrix would square the condition number and lose the small ones.
    W = conditioned(rng, 300, 6, 1e8)[:, None]
    found = np.linalg.svd(reduced(W, np.zeros((300, 1))).factor()[:, :6], compute_uv=False)
    np.testing.assert_allclose(found[:6], np.geomspace(1.0, 1e-8, 6), rtol=1e-6)


def test_a_solution_at_condition_1e8_is_that_of_lstsq(rng):
    W = conditioned(rng, 300, 6, 1e8)
    y = W @ np.ones(6)
    factor = reduced(W[:, None], y[:, None]).factor()
    found = solve_triangular(factor[:6, :6], factor[:6, 6])
    np.testing.assert_allclose(found, np.linalg.lstsq(W, y, rcond=None)[0], atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(40, 120), st.integers(1, 3), st.integers(1, 6))
def test_a_refit_at_full_rank_is_lstsq_with_its_deviations(seed, samples, nv, p):
    rng = np.random.default_rng(seed)
    W, y, columns = serial(rng, samples, nv, p, p)
    fit = refit(reduced(W, y, columns))
    rows = stacked(W, y)[:, :-1]
    expected = np.linalg.lstsq(rows, y.reshape(-1), rcond=None)[0]
    np.testing.assert_allclose(fit.theta, expected, atol=1e-8 * np.abs(expected).max())
    # Closed form: inverse of the information, the noise of each joint by its own rows.
    bread = np.linalg.inv(rows.T @ rows)
    middle = sum(s**2 * W[:, j].T @ W[:, j] for j, s in enumerate(fit.sigma))
    np.testing.assert_allclose(fit.cov, bread @ middle @ bread, rtol=1e-6, atol=1e-9 * np.abs(fit.cov).max())


def test_rows_without_any_entry_have_rank_zero():
    reduction = reduced(np.zeros((50, 2, 4)), np.ones((50, 2)))
    assert base_of_reduction(reduction).rank == 0
    with pytest.raises(IdentifiabilityError, match="excite no parameter: record a motion that moves the joints"):
        refit(reduction)


def test_one_row_determines_one_parameter(rng):
    W, y = rng.normal(size=(1, 1, 4)), np.array([[2.0]])
    fit = refit(reduced(W, y))
    assert fit.base.rank == 1
    np.testing.assert_allclose(fit.theta, y[0] / W[0, 0, :1])
    assert np.isnan(fit.sigma).all()


def test_columns_of_zeros_stay_zero_and_are_not_parameters(rng):
    W = rng.normal(size=(100, 2, 5))
    W[:, :, [0, 3]] = 0.0
    base = base_of_reduction(reduced(W, rng.normal(size=(100, 2))))
    assert base.independent == (1, 2, 4)
    assert base.zero == (0, 3)


def test_no_rows_at_all_have_a_factor_of_zeros():
    assert not reduced(np.zeros((0, 2, 3)), np.zeros((0, 2))).factor().any()


def some_recordings(rng: np.random.Generator) -> list[tuple[Array, Array]]:
    return [serial(rng, samples, 2, 4, 4)[:2] for samples in (50, 1, 80)]


COLUMNS = ((0, 1, 2, 3), (2, 3))


def test_recordings_together_are_all_their_rows(rng):
    several = some_recordings(rng)
    together = combined([reduced(W, y, COLUMNS) for W, y in several])
    assert together.samples == 131
    assert_same_products(together.factor(), np.vstack([stacked(W, y) for W, y in several]))


def test_without_one_recording_the_rows_are_those_of_the_others(rng):
    several = some_recordings(rng)
    others = combined([reduced(W, y, COLUMNS) for W, y in several[:2]])
    assert_same_products(others.factor(), np.vstack([stacked(W, y) for W, y in several[:2]]))


def test_recordings_that_touch_different_columns_are_put_together(rng):
    # In the first, joint 1 is held and its rows are empty.
    W, y = rng.normal(size=(60, 2, 3)), rng.normal(size=(60, 2))
    W[:30, 1] = 0.0
    parts = [reduced(W[:30], y[:30], ((0, 1, 2), ())), reduced(W[30:], y[30:])]
    assert_same_products(combined(parts).factor(), stacked(W, y))


def test_a_weight_multiplies_the_rows_of_its_joint(rng):
    W, y, columns = serial(rng, 60, 2, 4, 4)
    weights = np.array([0.5, 3.0])
    assert_same_products(reduced(W, y, columns).weighted(weights).factor(), stacked(W * weights[:, None], y * weights))


def test_weight_zero_takes_a_recording_out(rng):
    (W, y), (V, z), _ = some_recordings(rng)
    without = combined([reduced(W, y, COLUMNS), reduced(V, z, COLUMNS).weighted(0.0)])
    assert_same_products(without.factor(), stacked(W, y))


@pytest.mark.parametrize("weights", [-1.0, np.nan, np.inf, np.array([1.0, -2.0])])
def test_a_weight_that_is_negative_or_not_finite_is_refused(rng, weights):
    with pytest.raises(ParameterError, match="give finite ones that are not negative"):
        reduced(rng.normal(size=(5, 2, 2)), np.zeros((5, 2))).weighted(weights)


def test_weights_for_other_joints_are_refused(rng):
    with pytest.raises(ParameterError, match=r"\(3,\) weights were given for 2 joints: give one for each"):
        reduced(rng.normal(size=(5, 2, 2)), np.zeros((5, 2))).weighted(np.ones(3))


def test_recordings_of_other_columns_are_not_put_together(rng):
    one, other = (reduced(rng.normal(size=(5, 1, p)), np.zeros((5, 1))) for p in (2, 3))
    with pytest.raises(ParameterError, match=r"number 1 has other columns than the first \(c2\): reduce all"):
        combined([one, other])


def test_nothing_is_put_together_from_nothing():
    with pytest.raises(ParameterError, match="No reduction was given: give at least one"):
        combined([])


def test_the_unknowns_of_other_columns_are_refused(rng):
    reduction = reduced(rng.normal(size=(9, 1, 2)), np.zeros((9, 1)))
    base = base_parameters_of_matrix(rng.normal(size=(9, 2)), ["x", "y"])
    with pytest.raises(ParameterError, match="those of other columns"):
        refit(reduction, base)


def test_factors_cannot_be_written_to(rng):
    reduction = reduced(rng.normal(size=(9, 1, 2)), np.zeros((9, 1)))
    with pytest.raises(ValueError, match="read-only"):
        reduction.factors[0][0, 0] = 1.0


def test_a_factor_of_fewer_rows_than_columns_has_their_products(rng):
    rows = rng.normal(size=(2, 5))
    assert triangular(rows).shape == (5, 5)
    assert_same_products(triangular(rows), rows)
    assert r_factor([rows[:1], rows[1:]]).shape == (2, 5)


def test_kept_columns_make_up_the_others(rng):
    # Known truth: column 2 is 3 times column 0 minus column 1.
    W = rng.normal(size=(30, 4))
    W[:, 2] = 3.0 * W[:, 0] - W[:, 1]
    kept, others, grouping, _ = dependent_columns(W, ("",) * 4, 1e-6)
    assert kept.tolist() == [0, 1, 3]
    assert others.tolist() == [2]
    np.testing.assert_allclose(grouping[:, 0], [3.0, -1.0, 0.0], atol=1e-12)
