"""Time by stage. Oracle: a clock by hand."""

from __future__ import annotations

import pytest

from identification.cli.terminal.stage_times import StageTimes, peak_megabytes
from identification.stages import Announcement, Stage


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
