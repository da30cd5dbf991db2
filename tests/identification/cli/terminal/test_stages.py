"""Progress in the terminal: stages, times, percentage."""

import io

import pytest

from identification.cli.main import main
from identification.cli.terminal.progress import (
    BATCH,
    DIAGNOSIS,
    EXCITATION,
    IDENTIFICATION,
    MAP,
    VIEW,
    Progress,
    percent_done,
)
from identification.cli.terminal.stage_times import StageTimes, peak_megabytes
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
    assert progress.line() == "70 % reading"


def watched(*times: tuple[float, float]) -> StageTimes:
    """With clock and processor time of each moment."""
    moments = iter(times)
    return StageTimes(lambda: next(moments))


def test_a_stage_that_is_announced_again_has_one_row():
    # By hand: reading from 0 to 1 and from 3 to 4, something else from 1 to 3; twice as much on two threads.
    times = watched((0.0, 5.0), (1.0, 6.0), (3.0, 10.0), (4.0, 11.0))
    for stage in (Stage.READING, Stage.RIVALS_COMPARED, Stage.READING):
        times.enter(Announcement(stage))
    assert times.rows() == {"reading": (2.0, 2.0), "comparing rivals": (2.0, 4.0)}


def test_the_table_counts_what_the_process_did_before_its_command():
    times = watched((0.0, 5.0), (1.5, 8.0))
    times.enter(Announcement(Stage.FILTERING))
    lines = times.table().splitlines()
    assert lines[1].split()[-1] == "5.00"
    assert lines[2].split() == ["filtering", "1.50", "3.00"]
    assert lines[3].split() == ["all", "1.50", "8.00"]


def test_the_most_memory_of_a_process_grows_with_what_it_holds():
    before = peak_megabytes()
    if before is None:
        pytest.skip("this system does not say")
    block = bytearray(int(2**20 * (before + 50)))
    block[::4096] = b"x" * len(block[::4096])
    after = peak_megabytes()
    assert after is not None
    assert after > before + 40


COMMANDS = {
    "identify": (IDENTIFICATION, ["identify", "{pendulum}", "{log}", "--out", "{out}"]),
    "excite": (EXCITATION, ["excite", "{pendulum}", "--duration", "2", "--out", "{out}.csv"]),
    "map": (MAP, ["map", "{arm}", "--quantity", "manipulability", "--grid", "q.turn=-1:1:3", "--out", "{out}"]),
}


@pytest.mark.whole
@pytest.mark.parametrize("command", COMMANDS)
def test_every_announcement_is_of_a_stage_and_every_stage_is_announced(
    command, pendulum, arm, log, tmp_path, monkeypatch
):
    stages, words = COMMANDS[command]
    announced = []
    monkeypatch.setattr(Progress, "_take", lambda self, now: announced.append(now.stage))
    given = {"pendulum": pendulum, "arm": arm, "log": log, "out": tmp_path / "out"}
    assert main([word.format(**given) for word in words]) == 0
    places = [list(stages).index(stage) for stage in announced]
    assert places == sorted(places)
    assert set(places) == set(range(len(stages)))
