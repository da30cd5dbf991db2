"""Prices, penalties and method errors with which sets of effects are compared. Oracle: sums by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from identification.diagnosis.search.fair_costs import costs_of, without_method_errors


def priced(prices: tuple[float, ...], penalties: tuple[float, ...]) -> SimpleNamespace:
    """A search whose sets are numbered, with a price and a penalty each."""
    return SimpleNamespace(price_of=lambda k: prices[k], held_out_fit=lambda k: SimpleNamespace(penalty=penalties[k]))


@pytest.mark.parametrize(
    ("twins", "free", "whole", "beyond"),
    [
        ((False, False, False), (), (5.0, 9.0, 9.0), (5.0, 15.0 - 2.0, 5.0 + 0.0)),
        ((False, True, True), (), (5.0, -1.0, 9.0), (5.0, 3.0, 5.0)),
        # What more numbers save in the penalty does not count, what a set of the same price pays more does.
        ((False, False, False), (False, True, True), (5.0, 5.0, 9.0), (5.0, 5.0, 5.0)),
    ],
)
def test_a_set_costs_its_price_and_its_penalty_counted_in_two_ways(twins, free, whole, beyond):
    # By hand: prices 5, 15, 5; penalties 10, 4, 14, which count in full or beyond four.
    search = priced((5.0, 15.0, 5.0), (10.0, 4.0, 14.0))
    found = costs_of(search, [0, 1, 2], list(twins), list(free))
    np.testing.assert_allclose(found[0], whole)
    np.testing.assert_allclose(found[1], beyond)


@pytest.mark.parametrize(
    ("worse", "more", "expected"),
    # By hand: of a gain of 10000 the method is accurate to 7; a difference for the set with fewer numbers counts.
    [
        (6.0, 0.0, 0.0),
        (-6.0, 0.0, 0.0),
        (17.0, 0.0, 10.0),
        (6.0, 3.0, 6.0),
        (-17.0, 3.0, -10.0),
        (6.0, -1.0, 0.0),
        (-6.0, -1.0, -6.0),
    ],
)
def test_a_small_difference_says_nothing_for_the_law_with_more_numbers(worse, more, expected):
    losses = np.array([[5.0, 5.0 + 0.25 * worse], [2.0, 2.0 + 0.75 * worse]])
    found = without_method_errors(losses, np.array([0.0, more]), [False, True], 10_000.0)
    np.testing.assert_allclose(found[:, 0], losses[:, 0])
    np.testing.assert_allclose(found[:, 1] - found[:, 0], [0.25 * expected, 0.75 * expected], atol=1e-12)
    np.testing.assert_array_equal(
        without_method_errors(losses, np.array([0.0, more]), [False, False], 10_000.0), losses
    )
