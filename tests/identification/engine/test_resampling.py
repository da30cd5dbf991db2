"""Block bootstrap and probability of answers. Oracle: multinomial counts, binomial odds, and shares by hand."""

from __future__ import annotations

import numpy as np
import pytest

from identification.engine.resampling import (
    REPLICATES,
    block_counts,
    halves,
    interval,
    probabilities,
    share_by_likelihood,
    share_of_wins,
)

FREE = (np.zeros(2),)


def test_every_replicate_draws_as_many_blocks_as_there_are(rng):
    counts = block_counts(17, rng)
    assert counts.shape == (REPLICATES, 17)
    np.testing.assert_array_equal(counts.sum(axis=1), 17)


def test_every_block_is_drawn_as_often_as_any_other(rng):
    # A multinomial count has mean one and variance 1 - 1/B.
    counts = block_counts(20, rng)
    assert counts.mean() == pytest.approx(1.0)
    assert counts.var() == pytest.approx(1 - 1 / 20, rel=0.05)


def test_fewer_replicates_are_the_first_of_all():
    few, all_of_them = (block_counts(9, np.random.default_rng(3), count) for count in (40, REPLICATES))
    np.testing.assert_array_equal(few, all_of_them[:40])


def test_an_interval_leaves_as_much_outside_on_either_side():
    # Closed form: of 0 to 1000 the middle 95 %.
    assert interval(np.arange(1001.0)) == pytest.approx((25.0, 975.0))


def test_equal_answers_share_a_replicate():
    np.testing.assert_allclose(share_of_wins(np.array([[1.0, 1.0, 9.0], [3.0, 2.0, 9.0]])), [0.25, 0.75, 0.0])


@pytest.mark.parametrize(("blocks", "expected"), [(7, ()), (9, (5, 4))])
def test_halves_are_judged_where_each_has_four_blocks(blocks, expected):
    assert tuple(len(half) for half in halves(blocks)) == expected


def test_an_answer_that_costs_less_in_every_block_is_certain():
    losses = np.column_stack([np.full(10, 5.0), np.full(10, 6.0)])
    np.testing.assert_array_equal(probabilities(losses, FREE), [1.0, 0.0])


def test_what_is_better_in_one_block_leads_in_the_draws_that_have_it():
    # Closed form: a block of ten is absent from (1 - 1/10)^10 of the draws, which both share; one half has it in
    # 1 - (1 - 1/5)^5 of its draws, and in the other half both are alike.
    losses = np.full((10, 2), 50.0)
    losses[0, 1] += 40.0
    lost = [0.5 * 0.9**10, 0.5 * 0.8**5, 0.5]
    np.testing.assert_allclose(probabilities(losses, FREE)[1], np.mean(lost), atol=0.02)
    np.testing.assert_allclose(probabilities(losses, FREE, by_halves=False)[1], lost[0], atol=0.02)


def test_an_answer_that_is_better_in_one_half_shares_with_the_one_that_is_better_in_the_other():
    # By symmetry: whole draws are even, and each half is certain of another answer.
    losses = np.zeros((10, 2))
    losses[:5, 1] = losses[5:, 0] = 10.0
    np.testing.assert_allclose(probabilities(losses, FREE), [0.5, 0.5], atol=0.02)


def test_a_half_counts_as_if_all_blocks_were_like_it():
    # By hand: what costs 8 more saves 1 a block, which is 10 in all and 5 in a half.
    losses = np.column_stack([np.ones(10), np.zeros(10)])
    np.testing.assert_array_equal(probabilities(losses, (np.array([0.0, 8.0]),)), [0.0, 1.0])


def test_ways_to_count_costs_and_other_choices_have_the_same_weight_each():
    # By hand: the first way lets the first lead, the second the other; under the other choice the other leads.
    losses, costs = np.zeros((10, 2)), (np.array([0.0, 1.0]), np.array([1.0, 0.0]))
    found = probabilities(losses, costs, [(losses, costs[1:])], by_halves=False)
    np.testing.assert_allclose(found, [0.25, 0.75])


@pytest.mark.parametrize("apart", [0.1, 2.0, 20.0])
def test_a_difference_that_lasts_counts_as_much_as_likelihood_says(apart):
    # Oracle: the normal density of noise. Every block has a tenth of the difference, so that the draws do not matter.
    losses = np.outer(np.ones(10), [5.0, 5.0 + apart / 10])
    likely = 1.0 / (1.0 + np.exp(-apart / 2))
    np.testing.assert_allclose(probabilities(losses, FREE, lead=share_by_likelihood), [likely, 1.0 - likely])
