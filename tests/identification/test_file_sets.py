"""Sets of files are whole, also of two runs at once."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from benchmarks import kills
from identification import file_sets, files
from identification.file_sets import renamed_together, with_run, write_together
from identification.files import MARK, locked_folder, locked_when_made, remove_unless_locked, temporary_beside
from phantom_dyn.errors import UsageError

OLD, NEW = {"a.txt": "old a", "gone.txt": "old", "index.json": "old"}, {"a.txt": "new a", "index.json": "new"}


def content(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in sorted(folder.iterdir()) if path.is_file()}


@pytest.fixture(params=["exchanged", "one by one"])
def way(request, monkeypatch) -> str:
    """Both ways of writing."""
    if request.param == "one by one":
        monkeypatch.setattr(file_sets, "_written_and_exchanged", lambda *_: False)
    return request.param


def test_a_folder_is_made_with_its_files(tmp_path, way):
    written = write_together(tmp_path / "deep" / "out", OLD)
    assert written == tuple(tmp_path / "deep" / "out" / name for name in OLD)
    assert content(tmp_path / "deep" / "out") == OLD
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["out"]


def test_files_of_others_stay_and_those_of_an_earlier_set_go(tmp_path, way):
    out = tmp_path / "out"
    write_together(out, OLD)
    (out / "mine.txt").write_text("mine")
    (out / "link").symlink_to("nowhere")
    before = (out / "mine.txt").stat().st_ino
    write_together(out, NEW, obsolete=OLD)
    assert content(out) == {**NEW, "mine.txt": "mine"}
    assert (out / "mine.txt").stat().st_ino == before
    assert (out / "link").readlink() == Path("nowhere")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_the_folder_keeps_its_rights(tmp_path, way):
    (tmp_path / "out").mkdir(mode=0o750)
    write_together(tmp_path / "out", NEW)
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o750


def test_a_link_to_the_folder_stays_a_link(tmp_path, way):
    (tmp_path / "real").mkdir()
    (tmp_path / "out").symlink_to("real")
    write_together(tmp_path / "out", NEW)
    assert (tmp_path / "out").is_symlink()
    assert content(tmp_path / "real") == NEW


@pytest.mark.parametrize("kind", ["a folder inside", "a shell in it"])
def test_a_folder_that_cannot_be_exchanged_stays_the_same_folder(tmp_path, kind, monkeypatch):
    out = tmp_path / "out"
    write_together(out, OLD)
    before = out.stat().st_ino
    if kind == "a folder inside":
        (out / "runs").mkdir()
    else:
        monkeypatch.chdir(out)
    write_together(out, NEW, obsolete=OLD)
    assert out.stat().st_ino == before
    assert content(out) == NEW


def test_old_and_new_are_never_in_one_folder(tmp_path, monkeypatch):
    # Known truth: what stands there at each step before and after the exchange.
    out, seen = tmp_path / "out", []
    write_together(out, OLD)
    real = file_sets._exchanged

    def watched(one: Path, other: Path) -> bool:
        seen.append(content(out))
        done = real(one, other)
        seen.append(content(out))
        return done

    monkeypatch.setattr(file_sets, "_exchanged", watched)
    write_together(out, NEW, obsolete=OLD)
    assert seen == [OLD, NEW]


def test_a_failure_leaves_the_old_set_and_nothing_else(tmp_path, monkeypatch):
    out = tmp_path / "out"
    write_together(out, OLD)

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(file_sets, "_write_all", full)
    with pytest.raises(UsageError, match=r"cannot write .*out: no space left on device"):
        write_together(out, NEW)
    assert content(out) == OLD
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_what_a_killed_run_has_left_goes_with_the_next(tmp_path):
    out = tmp_path / "out"
    write_together(out, OLD)
    for left in (tmp_path / f".out.0a1b2c3d{MARK}", out / f"..0a1b2c3d{MARK}"):
        left.mkdir()
        (left / "a.txt").write_text("half")
    (out / f".a.0a1b2c3d{MARK}.txt").write_text("half")
    (tmp_path / ".out.mine").mkdir()
    write_together(out, NEW, obsolete=OLD)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".out.mine", "out"]
    assert sorted(path.name for path in out.iterdir()) == ["a.txt", "index.json"]


def test_what_a_living_run_writes_stays(tmp_path):
    left = tmp_path / f".out.0a1b2c3d{MARK}"
    left.mkdir()
    with locked_when_made(lambda: left):
        write_together(tmp_path / "out", NEW)
        assert left.is_dir()
    write_together(tmp_path / "out", NEW)
    assert not left.exists()


def test_the_system_lets_go_of_what_a_killed_process_held(tmp_path):
    code = (
        "import sys, os, signal; from pathlib import Path; from identification.files import locked_when_made\n"
        "with locked_when_made(lambda: Path(sys.argv[1])):\n    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    left = tmp_path / "left"
    left.mkdir()
    subprocess.run([sys.executable, "-c", code, str(left)], check=False, capture_output=True)
    remove_unless_locked(left)
    assert not left.exists()


@pytest.mark.parametrize("when", ["before it is opened", "before it is held"])
def test_what_another_run_removes_before_it_is_held_is_made_again(tmp_path, monkeypatch, when):
    # Known truth: the first one is gone, as a run that sweeps has taken it for left behind.
    names, real = iter("ab"), files.fcntl.flock

    def made() -> Path:
        place = tmp_path / next(names)
        place.touch()
        if place.name == "a" and when == "before it is opened":
            place.unlink()
        return place

    def held(descriptor: int, how: int) -> None:
        (tmp_path / "a").unlink(missing_ok=True)
        real(descriptor, how)

    monkeypatch.setattr(files.fcntl, "flock", held)
    with locked_when_made(made) as place:
        assert place == tmp_path / "b"


def test_a_temporary_file_of_a_killed_run_goes_with_the_next(tmp_path):
    left = tmp_path / f".a.0a1b2c3d{MARK}.json"
    left.write_text("half")
    with temporary_beside(tmp_path / "a.json") as path:
        path.write_text("{}")
        assert not left.exists()
        remove_unless_locked(path)
        assert path.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("a.yaml", "# run: 12ab\n"),
        ("a.py", "# run: 12ab\n"),
        ("a.urdf", "<!-- run: 12ab -->\n"),
        ("a.html", "<!-- run: 12ab -->\n"),
    ],
)
def test_a_text_ends_with_its_run(name, line):
    assert with_run(name, "x", "12ab") == f"x\n{line}"


def test_numbers_and_runs_without_an_id_stay_as_they_are():
    assert (with_run("a.csv", "q\n1\n", "12ab"), with_run("a.yaml", "x", "")) == ("q\n1\n", "x")


def test_where_one_of_several_files_cannot_be_written_it_is_named_and_none_is(tmp_path):
    def written() -> None:
        with renamed_together(tmp_path) as beside:
            beside(tmp_path / "a.txt").write_text("a")
            beside(tmp_path / "b.txt").write_text("b")
            raise OSError(28, "No space left on device")

    with pytest.raises(UsageError, match=r"cannot write .*b\.txt: no space left on device"):
        written()
    assert list(tmp_path.iterdir()) == []


NAMES = ("a.txt", "b.txt", "index.json")

ROUNDS = 20


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
    monkeypatch.setattr(files, "_LONGEST_WAIT_S", 0.2)
    with locked_folder(tmp_path / "out"):
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
