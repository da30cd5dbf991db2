"""What the best of many columns gains by chance. Oracle: SciPy's Gumbel law, draws of noise, series by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import gumbel_r

from identification.engine.chance import exceeded_by_chance, in_another_order, squares_by_chance


@pytest.mark.parametrize("wrong", [0.1, 0.01])
def test_the_largest_gain_exceeds_its_quantile_as_often_as_asked_for(rng, wrong):
    best = gumbel_r(loc=8.0, scale=2.0).rvs(200_000, random_state=rng)
    assert exceeded_by_chance(best, wrong) == pytest.approx(gumbel_r(loc=8.0, scale=2.0).isf(wrong), rel=0.01)


def test_the_best_of_some_columns_explains_more_than_chance_as_rarely_as_asked_for(rng):
    # Draws: the largest of eight squares over a noise that is known by 30 degrees of freedom.
    squares = rng.standard_normal((100_000, 8)) ** 2 / (rng.chisquare(30, (100_000, 1)) / 30)
    assert np.mean(squares.max(axis=1) > squares_by_chance(8, 30.0, 0.02)) == pytest.approx(0.02, rel=0.15)


def test_pieces_in_another_order_are_the_same_pieces_but_for_their_signs(rng):
    pieces = [np.array([1.0, 2.0]), np.array([30.0]), np.array([4.0, 5.0, 6.0])]
    mixed = in_another_order(pieces, rng)
    text = ",".join(f"{abs(x):g}" for x in mixed)
    assert sorted(abs(mixed)) == [1, 2, 4, 5, 6, 30]
    assert all(part in text for part in ("1,2", "30", "4,5,6"))


def test_every_piece_comes_first_as_often_as_any_other(rng):
    # Multinomial: a third of 600 draws each, with a deviation of 12.
    first = [abs(in_another_order([np.array([1.0]), np.array([2.0]), np.array([3.0])], rng)[0]) for _ in range(600)]
    assert np.bincount(np.array(first, dtype=int))[1:] == pytest.approx(200, abs=50)
