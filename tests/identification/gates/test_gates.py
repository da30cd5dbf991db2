"""Each gate passes what exceeds its threshold, and states its figure. Oracle: by hand, at the threshold's two sides."""

import inspect

import numpy as np
import pytest

from identification.engine.claims import GateResult
from identification.gates import GATES, ORDER, gate_name
from identification.gates.above_chance import more_than_chance
from identification.gates.coarse_reading import coarser_than_others, coarser_than_stated, rounding_matters
from identification.gates.controller_gain import beyond_the_gain
from identification.gates.exchange import explains_more_than_others, worth_its_numbers
from identification.gates.existing_bodies import bodies_can_exist
from identification.gates.fair_part import fair_part_of_the_gap
from identification.gates.in_band import closes_for_sure, torque_is_there
from identification.gates.least_size import large_enough
from identification.gates.moved_joints import shown_above_noise, shown_by_motion
from identification.gates.over_blocks import in_enough_blocks
from identification.gates.possible import possible_size
from identification.gates.rivalry import likelier_than_rivals, plausible_size
from identification.gates.special_case import both_are_there, differs_from_simpler, more_than_a_missing_part
from identification.words.ledger_words import REASONS

SIDES = [
    (possible_size(1), possible_size(0)),
    (bodies_can_exist(979.0, 1000.0, 20.0), bodies_can_exist(981.0, 1000.0, 20.0)),
    (more_than_chance(20.0, 20.0), more_than_chance(20.1, 20.0)),
    (fair_part_of_the_gap(30.0, 30.0), fair_part_of_the_gap(30.1, 30.0)),
    (explains_more_than_others(0.0), explains_more_than_others(0.1)),
    (explains_more_than_others(-2.0, -1.0), explains_more_than_others(-0.5, -1.0)),
    (worth_its_numbers(0.9, 1.0), worth_its_numbers(1.0, 1.0)),
    (torque_is_there(1.0), torque_is_there(1.1)),
    (differs_from_simpler(0.949, effect_is_certain=True), differs_from_simpler(0.95, effect_is_certain=True)),
    (differs_from_simpler(0.998, effect_is_certain=False), differs_from_simpler(0.999, effect_is_certain=False)),
    (both_are_there(0.99), both_are_there(0.991)),
    (more_than_a_missing_part(0.9), more_than_a_missing_part(0.89)),
    (plausible_size(0.1, "kg", rival_is_plausible=True), plausible_size(0.0, "", rival_is_plausible=True)),
    (plausible_size(0.1, "kg", rival_is_plausible=True), plausible_size(0.1, "kg", rival_is_plausible=False)),
    (likelier_than_rivals(0.3, 0.5, leads=False), likelier_than_rivals(0.5, 0.3, leads=True)),
    (coarser_than_stated(1.49), coarser_than_stated(1.5)),
    (coarser_than_others(9.9), coarser_than_others(10.0)),
    (rounding_matters(0.05), rounding_matters(0.051)),
    # Less than a hundredth of the gap, and half a floor or more.
    (large_enough(0.009, 0.49), large_enough(0.009, 0.51)),
    (large_enough(0.009, 0.49), large_enough(0.011, 0.49)),
    (closes_for_sure(-0.11), closes_for_sure(-0.09)),
    # Twice a tolerance of a tenth, of gains that are stated.
    (beyond_the_gain(-0.19, stated=True), beyond_the_gain(-0.21, stated=True)),
    (beyond_the_gain(9.0, stated=False), beyond_the_gain(9.0, stated=True)),
]


def test_a_gate_passes_what_exceeds_its_threshold():
    assert [failed.gate for failed, _ in SIDES] == [passed.gate for _, passed in SIDES]
    assert [failed for failed, _ in SIDES if failed.passed] == []
    assert [passed for _, passed in SIDES if not passed.passed] == []


def test_every_gate_asks_a_question_and_has_words_for_what_fails_it():
    questions = {gate_name(gate): (inspect.getdoc(gate) or "").split("\n\n")[0] for gate in GATES}
    assert [name for name, question in questions.items() if not question.endswith("?")] == []
    assert questions.keys() <= REASONS.keys()


def test_results_bear_the_names_of_the_gates_in_their_order():
    assert {failed.gate for failed, _ in SIDES} <= ORDER.keys()
    assert list(ORDER.values()) == list(range(len(GATES)))
    assert REASONS.keys() == ORDER.keys()


def blocks(*gains: float, energy: tuple[float, ...] = (), named: bool = True, needed: float = 10.0) -> GateResult:
    series = np.array(gains)
    total = float(series.sum())
    acting = np.array(energy) if energy else np.ones(len(series))
    return in_enough_blocks(series, total, total, needed, lambda: acting, named=named)


def test_a_gain_holds_that_is_significant_from_block_to_block():
    # By hand: 2 to 4 in each of ten blocks: 30, against twice a standard error of 3.16.
    found = blocks(*(2.0, 4.0) * 5)
    assert found.passed
    assert (found.value, found.needed) == (30.0, pytest.approx(2.0 * np.sqrt(10.0)))


@pytest.mark.parametrize(
    ("gains", "passed"),
    [
        # By hand: not significant beside blocks that lose; 12 are left of 10 needed, and 9 are too few.
        ((40.0, 40.0, 30.0, -18.0, 0.0, 0.0), True),
        ((40.0, 40.0, 27.0, -18.0, 0.0, 0.0), False),
        # Ten times what is needed may sit in one block.
        ((101.0, 0.0, 0.0, 0.0, 0.0, 0.0), True),
        ((99.0, 0.0, 0.0, 0.0, 0.0, 0.0), False),
    ],
)
def test_a_gain_holds_that_is_very_large_or_enough_without_its_two_best_blocks(gains, passed):
    assert blocks(*gains).passed is passed


def test_of_a_structure_without_a_name_one_block_may_be_the_best():
    gains = (40.0, 27.0, -18.0, 0.0, 0.0, 0.0)
    assert [blocks(*gains, named=named, needed=8.5).passed for named in (True, False)] == [False, True]


def test_what_acts_in_few_blocks_has_to_gain_in_each_of_them():
    # By hand: it acts in two of six blocks, a third; of half of them it would be no rare event.
    rare = (1.0, 0.5, 0.0, 0.0, 0.0, 0.0)
    assert blocks(40.0, 1.0, -1.0, -1.0, -1.0, -1.0, energy=rare).passed
    assert not blocks(40.0, -1.0, 1.0, -1.0, -1.0, -1.0, energy=rare).passed
    assert not blocks(40.0, 1.0, -1.0, -1.0, -1.0, -1.0, energy=(1.0, 0.5, 0.2, 0.0, 0.0, 0.0)).passed


NOT_CLAIMED = more_than_chance(1.0, 20.0)


@pytest.mark.parametrize(
    ("held_out", "in_sample", "scatter", "price", "passed"),
    [
        # Twice the scatter of 4, and a price of 5.
        (8.1, 9.0, 4.0, 5.0, True),
        (7.9, 9.0, 4.0, 5.0, False),
        (8.1, 4.9, 4.0, 5.0, False),
    ],
)
def test_where_the_motion_is_loud_a_gain_has_to_exceed_its_price_and_its_scatter(
    held_out, in_sample, scatter, price, passed
):
    assert shown_by_motion(NOT_CLAIMED, held_out, in_sample, scatter, price).passed is passed


def test_what_is_claimed_where_the_motion_is_loud_is_shown_whatever_its_scatter():
    found = shown_by_motion(more_than_chance(30.0, 20.0), 1.0, 1.0, 100.0, 5.0)
    assert (found.passed, found.value, found.needed) == (True, 30.0, 20.0)


@pytest.mark.parametrize(
    ("growth", "over_allowed", "has_structure", "passed"),
    [
        ([1.0, 0.02], [0.8, 5.0], False, False),  # the first grows within its noise, the second does not grow
        ([1.0, 0.04], [0.8, 5.0], False, True),
        ([1.0, 0.02], [0.8, 5.0], True, True),  # structure is no noise
        ([0.02, 0.02], [5.0, 5.0], True, False),
    ],
)
def test_a_joint_has_to_grow_beyond_its_noise_or_to_be_left_with_structure(growth, over_allowed, has_structure, passed):
    never = (0.0, 20.0)
    found = shown_above_noise(
        np.array(growth), lambda _: np.array(over_allowed), lambda _: has_structure, lambda: never
    )
    assert found.passed is passed


@pytest.mark.parametrize(("gain", "passed"), [(19.0, False), (21.0, True)])
def test_within_noise_of_unknown_size_a_gain_has_to_exceed_chance_in_the_loudest(gain, passed):
    within = np.array([0.8])
    found = shown_above_noise(np.array([1.0]), lambda _: within, lambda _: False, lambda: (gain, 20.0))
    assert (found.passed, found.needed) == (passed, 20.0)
