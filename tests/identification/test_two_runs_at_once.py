"""Two runs that write into one folder at once leave one whole set of one run. Oracle: the files that stand there."""

import os
import subprocess
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from benchmarks import kills
from identification import file_sets, files
from identification.file_sets import renamed_together, write_together
from identification.files import alone_in, temporary_beside

NAMES = ("a.txt", "b.txt", "index.json")
ROUNDS = 20


def content(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(folder.iterdir()) if path.is_file()}


@pytest.fixture(params=["exchanged", "one by one"])
def way(request, monkeypatch) -> str:
    """Both ways of writing."""
    if request.param == "one by one":
        monkeypatch.setattr(file_sets, "_written_and_exchanged", lambda *_: False)
    return request.param


def at_once(calls: list[Callable[[], object]]) -> list[BaseException]:
    """What is raised where threads begin to write in the same moment."""
    begin, raised = threading.Barrier(len(calls)), []

    def work(call: Callable[[], object]) -> None:
        begin.wait()
        try:
            call()
        except BaseException as error:
            raised.append(error)

    threads = [threading.Thread(target=work, args=(call,)) for call in calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return raised


@pytest.mark.parametrize("there", [False, True])
def test_what_stands_there_is_the_set_of_one_run(tmp_path, way, there):
    # The second set lacks a file of the first: one that stayed would pass for its own.
    sets = [{name: f"run {k}" for name in (NAMES if k != 1 else NAMES[1:])} for k in range(3)]
    for turn in range(ROUNDS):
        out = tmp_path / str(turn) / "out"
        out.parent.mkdir()
        if there:
            write_together(out, dict.fromkeys(NAMES, "old"))
            (out / "mine.txt").write_text("mine")
        assert at_once([partial(write_together, out, texts, obsolete=NAMES) for texts in sets]) == []
        found = content(out)
        assert not there or found.pop("mine.txt") == "mine"
        assert found in sets
        assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_files_that_are_renamed_together_are_of_one_run(tmp_path):
    def write(run: int) -> None:
        with renamed_together(tmp_path) as beside:
            for name in NAMES:
                beside(tmp_path / name).write_text(f"run {run}")

    for _ in range(ROUNDS):
        assert at_once([partial(write, run) for run in range(3)]) == []
        assert set(content(tmp_path)) == set(NAMES)
        assert len(set(content(tmp_path).values())) == 1


def test_one_file_that_several_write_is_whole_and_nobody_is_refused(tmp_path):
    def write(run: int) -> None:
        with temporary_beside(tmp_path / "a.txt") as place:
            place.write_text(f"run {run}")

    for _ in range(10 * ROUNDS):
        assert at_once([partial(write, run) for run in range(4)]) == []
    assert content(tmp_path)["a.txt"] in {f"run {run}" for run in range(4)}
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_nobody_waits_for_ever_for_a_folder_that_another_program_holds(tmp_path, monkeypatch):
    # As `flock results phantom-dyn diagnose ... --out results/today`.
    monkeypatch.setattr(files, "_PATIENCE_S", 0.2)
    with alone_in(tmp_path / "out"):
        begun = time.monotonic()
        write_together(tmp_path / "out", {"index.json": "new"})
    assert time.monotonic() - begun >= 0.2
    assert content(tmp_path / "out") == {"index.json": "new"}


@pytest.mark.whole
def test_two_commands_at_once_leave_one_whole_set(tmp_path):
    # Oracle: that of the kills, by the run that every file says it is of.
    kills.write_log(tmp_path / "a.csv", 0)
    words, nowhere = kills.command(tmp_path, each=False), subprocess.DEVNULL
    runs = [subprocess.Popen(words, cwd=kills.CHECKOUT, env=os.environ, stdout=nowhere) for _ in range(2)]
    assert [run.wait() for run in runs] == [0, 0]
    assert (tmp_path / "out" / "report.html").exists()
    assert kills.wrong_set(tmp_path / "out") == []
    (tmp_path / "tmp").mkdir()
    assert kills.litter(tmp_path) == []
