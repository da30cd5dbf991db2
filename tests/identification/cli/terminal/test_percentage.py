"""How far a run is. Oracle: shares of made-up stages."""

from __future__ import annotations

import io

import pytest

from identification.cli.terminal.percentage import BATCH, DIAGNOSIS, EXCITATION, IDENTIFICATION, MAP, VIEW, percent_done
from identification.cli.terminal.progress import Progress
from identification.stages import Announcement, Stage

STAGES = {Stage.READING: 20.0, Stage.MAP: 50.0, Stage.WRITING: 30.0}


@pytest.mark.parametrize("stages", [DIAGNOSIS, IDENTIFICATION, EXCITATION, MAP, VIEW, BATCH])
def test_the_shares_of_a_command_are_all_of_it(stages):
    assert sum(stages.values()) == 100.0


@pytest.mark.parametrize(
    ("stage", "percent"), [(Stage.READING, 0.0), (Stage.MAP, 20.0), (Stage.WRITING, 70.0), (Stage.NOISE, 0.0)]
)
def test_a_stage_begins_where_the_shares_of_those_before_it_end(stage, percent):
    assert percent_done(STAGES, Announcement(stage)) == percent


@pytest.mark.parametrize(("done", "percent"), [(0, 20.0), (10, 32.5), (40, 70.0)])
def test_parts_that_are_counted_are_that_share_of_their_stage(done, percent):
    assert percent_done(STAGES, Announcement(Stage.MAP, done, 40)) == pytest.approx(percent)


def test_an_earlier_stage_that_is_announced_again_takes_nothing_back():
    with Progress(Stage.WRITING, io.StringIO(), stages=STAGES) as progress:
        progress.show(Announcement(Stage.READING))
    assert progress.said() == "70 % reading"
