"""Chance, claims and resampling of the engine."""

from itertools import combinations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import gumbel_r

from identification.engine.autocorrelation import autocorrelation_time, lagged_products, positive_sequence
from identification.engine.chance import exceeded_by_chance, shuffled_pieces, squares_by_chance
from identification.engine.claims import (
    Claim,
    GateResult,
    easiest_test,
    until_failed,
    until_nothing_changes,
    worst_failure,
)
from identification.engine.resampling import (
    REPLICATES,
    block_counts,
    halves,
    interval,
    probabilities,
    share_by_likelihood,
    share_of_wins,
)
from identification.engine.shapley import shapley_values


def time_by_hand(e: np.ndarray) -> float:
    """Twice the sum of autocorrelations of pairs of lags up to the first negative pair, less one."""
    e = e - e.mean()
    r = np.correlate(e, e, "full")[len(e) - 1 :][: len(e) // 2] / (e @ e)
    out = -1.0
    for k in range(0, len(r) - 1, 2):
        if r[k] + r[k + 1] <= 0:
            break
        out += 2.0 * (r[k] + r[k + 1])
    return max(out, 1.0)


def test_products_by_lag_are_those_of_numpy(rng):
    e = rng.normal(size=31)
    np.testing.assert_allclose(lagged_products(e), np.correlate(e, e, "full")[30:], atol=1e-12)


def test_lags_end_before_the_first_pair_that_is_negative_together():
    # By hand: the pairs sum up to 1.5, 0.1 and -0.1.
    np.testing.assert_array_equal(
        positive_sequence(np.array([2.0, 1.0, 0.4, -0.2, -0.1, -0.1, 4.0, 4.0])), [1, 0.5, 0.2, -0.1]
    )


@pytest.mark.parametrize("samples", [8, 9, 11, 30, 200])
def test_the_autocorrelation_time_is_the_sum_over_pairs_of_lags(rng, samples):
    for _ in range(10):
        e = np.cumsum(rng.normal(size=samples)) + 5.0
        assert autocorrelation_time(e) == pytest.approx(time_by_hand(e))


def test_seven_samples_have_time_one():
    line = np.arange(8.0)
    assert autocorrelation_time(line[:7]) == 1.0
    assert autocorrelation_time(line) == pytest.approx(time_by_hand(line)) != 1.0


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_the_autocorrelation_time_of_a_first_order_law_is_its_closed_form(rng, phi):
    # Closed form: (1 + phi) / (1 - phi) for e_t = phi e_(t-1) + w_t.
    e = lfilter([1.0], [1.0, -phi], rng.normal(size=60000))
    assert autocorrelation_time(e) == pytest.approx((1 + phi) / (1 - phi), rel=0.2)


def test_noise_that_alternates_counts_as_white_at_least(rng):
    e = lfilter([1.0], [1.0, 0.8], rng.normal(size=5000))
    assert autocorrelation_time(e) == 1.0


@pytest.mark.parametrize("e", [np.zeros(100), np.ones(5)], ids=["zeros", "few samples"])
def test_a_series_that_tells_nothing_has_time_one(e):
    assert autocorrelation_time(e) == 1.0


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
    mixed = shuffled_pieces(pieces, rng)
    text = ",".join(f"{abs(x):g}" for x in mixed)
    assert sorted(abs(mixed)) == [1, 2, 4, 5, 6, 30]
    assert all(part in text for part in ("1,2", "30", "4,5,6"))


def test_every_piece_comes_first_as_often_as_any_other(rng):
    # Multinomial: a third of 600 draws each, with a deviation of 12.
    first = [abs(shuffled_pieces([np.array([1.0]), np.array([2.0]), np.array([3.0])], rng)[0]) for _ in range(600)]
    assert np.bincount(np.array(first, dtype=int))[1:] == pytest.approx(200, abs=50)


def result(value: float, needed: float = 1.0, gate: str = "gain") -> GateResult:
    return GateResult(gate, value, needed, "1", value > needed)


def test_gates_are_asked_up_to_the_first_that_fails():
    asked = []

    def results():
        for value in (2.0, 0.5, 3.0):
            asked.append(value)
            yield result(value)

    assert [one.passed for one in until_failed(results())] == [True, False]
    assert asked == [2.0, 0.5]


def test_a_claim_has_failed_the_one_gate_that_it_did_not_pass():
    passed, failed = result(2.0), result(0.5)
    assert Claim(("friction",), (passed, failed), "not_claimed").failed is failed
    assert Claim(("friction",), (passed,), "claimed").failed is None


def test_what_fails_worst_is_furthest_below_what_it_needs_in_parts_of_it():
    # By hand: 30 of 100 is less than 1 of 2, and 5 of 1 passes.
    assert worst_failure({"a": result(1.0, 2.0), "b": result(30.0, 100.0), "c": result(5.0)}) == "b"


def test_nothing_fails_worst_where_all_pass():
    assert worst_failure({"a": result(2.0)}) is None


def test_where_nothing_is_needed_the_figure_itself_is_compared():
    assert worst_failure({"a": result(-1.0, 0.0), "b": result(-3.0, 0.0)}) == "b"


def test_a_gate_of_several_ways_is_passed_by_any_of_them_and_asks_no_further():
    def ways():
        yield 1.0, 2.0, "one"
        yield 5.0, 2.0, "two"
        pytest.fail("a way that is not needed was asked for")

    found = easiest_test("gate", ways())
    assert (found.value, found.unit, found.passed) == (5.0, "two", True)


def test_of_ways_that_all_fail_the_nearest_is_stated():
    # By hand: three quarters are nearer than a half.
    found = easiest_test("gate", [(1.0, 2.0, "half"), (3.0, 4.0, "three quarters")])
    assert (found.unit, found.passed) == ("three quarters", False)


def test_after_each_change_the_first_step_is_taken_again_until_nothing_changes():
    taken = []

    def halved(x: tuple[int]) -> tuple[int]:
        taken.append("halved")
        return (x[0] // 2,) if x[0] % 2 == 0 else x

    def less(x: tuple[int]) -> tuple[int]:
        taken.append("less")
        return (x[0] - 1,) if x[0] > 1 else x

    # By hand: 6, 3, 2, 1.
    assert until_nothing_changes((6,), [halved, less]) == (1,)
    assert taken == ["halved", "halved", "less", "halved", "halved", "less"]


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


def test_what_two_explain_only_together_is_shared_alike():
    # Closed form: of the glove game, where each of two left gloves and one right glove is worth nothing alone, the
    # right one has 2/3 and each left one 1/6.
    def pairs(gloves: frozenset) -> float:
        return float("right" in gloves and bool(gloves & {"left 1", "left 2"}))

    found = shapley_values(("left 1", "left 2", "right"), pairs)
    assert found == pytest.approx({"left 1": 1 / 6, "left 2": 1 / 6, "right": 2 / 3})


def test_a_player_that_takes_away_has_a_negative_share():
    found = shapley_values(("good", "bad"), lambda some: 1.0 * ("good" in some) - 0.2 * ("bad" in some))
    assert found == pytest.approx({"good": 1.0, "bad": -0.2})


@pytest.mark.parametrize("count", [5, 13])
def test_shares_add_up_to_what_all_close_together(count):
    # Closed form: efficiency; each pair adds one, so that by symmetry all have the same share.
    players = tuple(range(count))
    found = shapley_values(players, lambda some: float(len(list(combinations(some, 2)))))
    assert sum(found.values()) == pytest.approx(count * (count - 1) / 2)
    assert min(found.values()) == pytest.approx((count - 1) / 2)


def test_shares_of_many_are_known_to_half_a_percent():
    # Closed form: by symmetry each of four left and four right gloves has half of a pair; four deviations are allowed.
    players = tuple(range(8))
    found = shapley_values(players, lambda some: float(min(len(some & {0, 1, 2, 3}), len(some & {4, 5, 6, 7}))) / 4.0)
    assert list(found.values()) == pytest.approx([1 / 8] * 8, abs=0.02)


def test_what_does_not_depend_on_the_order_is_not_asked_often():
    # Closed form: the worth is a sum, so that one order would do; four pairs of orders ask at most 8 times each.
    asked = set()

    def worth(some: frozenset) -> float:
        asked.add(some)
        return sum(some)

    assert shapley_values(tuple(range(1, 19)), worth) == pytest.approx({k: float(k) for k in range(1, 19)})
    assert len(asked) <= 8 * 18 + 1


@pytest.fixture(scope="module")
def alliances() -> tuple[dict[frozenset, float], dict[int, float]]:
    """A game of sixteen, worth one in all, and each one's share: pairs add where they are complete, and so do fives.

    Closed form: what a set adds is shared alike among its members.
    """
    adds = {frozenset(some): 0.4 / 15 for some in combinations(range(6), 2)}
    adds |= {frozenset(some): 0.4 / 6 for some in combinations(range(6, 12), 5)}
    adds |= {frozenset([k]): 0.05 for k in range(12, 16)}
    return adds, {k: sum(size / len(some) for some, size in adds.items() if k in some) for k in range(16)}


def test_where_the_order_matters_shares_are_known_to_half_a_percent(alliances):
    # Closed form; four deviations of half a percent are allowed.
    adds, shares = alliances
    found = shapley_values(tuple(range(16)), lambda some: sum(size for one, size in adds.items() if one <= some))
    assert found == pytest.approx(shares, abs=0.02)
    # Errors of six shares together: two deviations of half a percent times the root of six.
    assert sum(found[k] for k in range(6)) == pytest.approx(0.4, abs=0.025)
    assert sum(found.values()) == pytest.approx(1.0)


def test_a_share_that_no_order_changes_is_exact_where_others_depend_on_it(alliances):
    # Closed form: the last four players add the same to any others.
    adds, shares = alliances
    found = shapley_values(tuple(range(16)), lambda some: sum(size for one, size in adds.items() if one <= some))
    assert [found[k] for k in range(12, 16)] == pytest.approx([shares[k] for k in range(12, 16)])


def test_nobody_has_no_shares():
    assert shapley_values((), lambda some: 1.0) == {}
