from __future__ import annotations

from itertools import combinations

import pytest

from identification.engine.shapley import shapley_values


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
