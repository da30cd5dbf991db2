"""How far a run is. Oracle: shares of made-up stages and a clock that the test moves."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from identification.cli.terminal.percentage import (
    BATCH,
    DIAGNOSIS,
    EXCITATION,
    IDENTIFICATION,
    MAP,
    VIEW,
    Percentage,
    Share,
)
from identification.stages import Announcement, Stage

STAGES = (Share(Stage.READING, 20.0), Share(Stage.MAP, 50.0), Share(Stage.WRITING, 30.0))
READING, MAPPING, WRITING = (Announcement(share.stage) for share in STAGES)


class Clock:
    """A clock that stands until it is moved."""

    def __init__(self):
        self.time = 0.0

    def __call__(self) -> float:
        return self.time


@pytest.fixture
def clock() -> Clock:
    return Clock()


def test_a_stage_begins_where_the_shares_of_those_before_it_end(clock):
    percentage = Percentage(STAGES, clock)
    percentage.enter(Announcement(Stage.READING, detail={"file": "2 of 3.csv"}))
    assert percentage.now() == 0.0
    percentage.enter(WRITING)
    assert percentage.now() == pytest.approx(70.0)


@pytest.mark.parametrize("stages", [DIAGNOSIS, IDENTIFICATION, EXCITATION, MAP, VIEW, BATCH])
def test_the_shares_of_a_command_are_all_of_it(stages):
    assert sum(share.percent for share in stages) == 100.0


@pytest.mark.parametrize(("done", "percent"), [(0, 20.0), (10, 32.5), (40, 70.0)])
def test_parts_that_are_counted_are_that_share_of_their_stage(clock, done, percent):
    percentage = Percentage(STAGES, clock)
    percentage.enter(Announcement(Stage.MAP, done, 40))
    assert percentage.now() == pytest.approx(percent)


def test_parts_that_are_counted_are_not_guessed_beyond_the_one_that_is_being_done(clock):
    # By hand: 4 of 40 places are 5 % of the whole, one more is 1.25 %.
    percentage = Percentage(STAGES, clock)
    percentage.enter(Announcement(Stage.MAP, 4, 40))
    clock.time = 1000.0
    assert percentage.now() == pytest.approx(26.25)


def test_a_stage_that_takes_as_long_as_expected_is_two_thirds_done_then(clock):
    percentage = Percentage(STAGES, clock)
    percentage.enter(READING)
    clock.time = 4.0
    percentage.enter(MAPPING)
    begun = percentage.now()
    clock.time += 4.0 / begun * (70.0 - begun)  # as fast as up to here
    assert (percentage.now() - begun) / (70.0 - begun) == pytest.approx(0.632, abs=1e-3)


def test_each_round_of_a_stage_is_worth_a_third_of_what_is_left_of_it(clock):
    percentage = Percentage(STAGES, clock)
    for expected in (20.0, 20.0 + 50 / 3, 70.0 - 50 * 4 / 9):
        percentage.enter(MAPPING)
        assert percentage.now() == pytest.approx(expected)


def test_an_earlier_stage_that_is_announced_again_changes_nothing(clock):
    percentage = Percentage(STAGES, clock)
    percentage.enter(WRITING)
    percentage.enter(READING)
    assert percentage.now() == pytest.approx(70.0)


def test_the_end_alone_is_a_hundred(clock):
    percentage = Percentage(STAGES, clock)
    percentage.enter(WRITING)
    clock.time = 20.0
    assert 70.0 < percentage.now() < 100.0
    percentage.end()
    assert percentage.now() == 100.0


@given(
    steps=st.lists(
        st.tuples(st.sampled_from([READING, MAPPING, WRITING, Announcement(Stage.ALTERNATIVES)]), st.floats(0.0, 50.0)),
        max_size=30,
    )
)
def test_the_percentage_never_falls(steps):
    clock = Clock()
    percentage, last = Percentage(STAGES, clock), 0.0
    for announced, waited in steps:
        percentage.enter(announced)
        clock.time += waited
        assert last <= percentage.now() <= 100.0
        last = percentage.now()
