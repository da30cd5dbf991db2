from __future__ import annotations

import numpy as np
import pytest

from identification.excitation.criteria import ConditionNumber, DOptimality, condition_number
from phantom_dyn.errors import ParameterError

CRITERIA = [ConditionNumber(), ConditionNumber(20.0, 0.0), DOptimality(), DOptimality(0.1)]


@pytest.fixture
def W(rng) -> np.ndarray:
    return rng.normal(size=(40, 6)) * np.geomspace(0.1, 10.0, 6)


@pytest.mark.parametrize("criterion", CRITERIA, ids=repr)
def test_the_slope_is_that_of_differences(criterion, W, rng):
    # Oracle: central differences in a symmetric direction.
    G, way, h = W.T @ W, rng.normal(size=(6, 6)), 1e-6
    way = way + way.T
    _, slope = criterion.cost(G)
    expected = (criterion.cost(G + h * way)[0] - criterion.cost(G - h * way)[0]) / (2 * h)
    assert (slope * way).sum() == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("criterion", CRITERIA, ids=repr)
def test_what_is_not_excited_has_a_finite_cost_and_slope(criterion, W):
    W[:, 2] = W[:, 1]
    cost, slope = criterion.cost(W.T @ W)
    assert np.isfinite(cost)
    assert np.isfinite(slope).all()


def test_the_condition_number_is_that_of_columns_of_one_norm(W):
    # Oracle: numpy.linalg.cond.
    assert condition_number(W.T @ W) == pytest.approx(np.linalg.cond(W / np.linalg.norm(W, axis=0)), rel=1e-9)


def test_a_sharp_cost_is_the_logarithm_of_the_condition_number(W):
    G = W.T @ W
    assert ConditionNumber(200.0, 0.0).cost(G)[0] == pytest.approx(np.log(condition_number(G)), abs=0.01)


def test_the_cost_is_never_below_the_logarithm_of_the_condition_number(W):
    G = W.T @ W
    assert ConditionNumber(2.0, 0.0).cost(G)[0] >= np.log(condition_number(G))


def test_the_size_of_a_column_does_not_change_the_condition_number(W):
    scaled = W * np.geomspace(1e-3, 1e3, 6)
    first, second = (ConditionNumber(6.0, 0.0).cost(m.T @ m)[0] for m in (W, scaled))
    assert first == pytest.approx(second, rel=1e-9)


def test_d_optimality_is_the_mean_logarithm_of_the_standard_deviations():
    # Closed form: independent parameters with the deviations 1/2 and 1/10.
    cost, _ = DOptimality(1e-12).cost(np.diag([4.0, 100.0]))
    assert cost == pytest.approx((np.log(0.5) + np.log(0.1)) / 2)


def test_a_column_that_is_zero_has_an_infinite_condition_number():
    assert condition_number(np.diag([1.0, 0.0])) == np.inf


def test_columns_that_are_the_same_have_an_infinite_condition_number():
    assert condition_number(np.ones((2, 2))) == np.inf


def test_no_column_has_no_condition_number():
    assert np.isnan(condition_number(np.zeros((0, 0))))


@pytest.mark.parametrize("make", [lambda: DOptimality(0.0), lambda: ConditionNumber(np.nan)])
def test_what_is_not_above_zero_is_refused(make):
    with pytest.raises(ParameterError, match=r"was given: give more than 0\."):
        make()


def test_a_negative_weight_of_information_is_refused():
    with pytest.raises(ParameterError, match="A weight of information of -1 was given: give 0 or more"):
        ConditionNumber(information=-1.0)
