"""Files are written whole or not at all, in plain forms."""

import csv
import os
import weakref
from pathlib import Path

import numpy as np
import pytest

from identification.csv_cells import header_line, text_cell
from identification.data.readers.column_map import read_column_map
from identification.data.readers.read_table import read_raw
from identification.data.recording import Recording
from identification.export.corrected.corrected_yaml import read_corrected
from identification.files import require_own_file, require_writable, temporary_beside, write_atomically
from identification.pipeline import diagnose
from identification.reporting.plain_page import page
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from identification.stages import Announcement, Stage
from phantom_dyn.effects.user.user_effects import effects_in
from phantom_dyn.errors import PhantomDynError, UsageError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot_config import read_robot_config


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_page_of_an_earlier_run_is_known_by_its_mark(tmp_path):
    (tmp_path / "a.html").write_text(page("Diagnoses", []))
    require_own_file(tmp_path / "a.html", "--out")
    (tmp_path / "a.html").write_text("<html></html>")
    with pytest.raises(UsageError, match=r"^--out: .*/a\.html was not written by phantom-dyn"):
        require_own_file(tmp_path / "a.html", "--out")


@pytest.mark.parametrize(
    ("name", "given", "written"),
    [("a.txt", "τ\r\n", "τ\r\n".encode()), ("a.bin", b"\x00\xff", b"\x00\xff"), ("one/two/a.txt", "x", b"x")],
    ids=["text as UTF-8 with its line ends", "bytes as they are", "missing folders are made"],
)
def test_text_and_bytes_are_written(tmp_path, name, given, written):
    write_atomically(tmp_path / name, given)
    assert (tmp_path / name).read_bytes() == written


@pytest.mark.parametrize("stop", [ZeroDivisionError, KeyboardInterrupt])
def test_folders_that_were_made_go_where_nothing_is_written(tmp_path, stop):
    with pytest.raises(stop), temporary_beside(tmp_path / "one" / "two" / "a.txt"):
        raise stop
    assert names(tmp_path) == []


def test_a_folder_with_something_else_in_it_stays_where_nothing_is_written(tmp_path):
    stopped = temporary_beside(tmp_path / "one" / "two" / "a.txt")
    stopped.__enter__().with_name("other").write_text("mine")
    assert not stopped.__exit__(ZeroDivisionError, ZeroDivisionError(), None)
    assert names(tmp_path / "one" / "two") == ["other"]


def test_a_text_of_the_path_is_enough_and_nothing_but_the_file_is_left(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_atomically("a.txt", "x")
    assert names(tmp_path) == ["a.txt"]


def test_the_old_file_stays_until_the_block_has_ended(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with temporary_beside(tmp_path / "a.txt") as temporary:
        temporary.write_text("new")
        seen = (tmp_path / "a.txt").read_text()
    assert (seen, (tmp_path / "a.txt").read_text()) == ("old", "new")


def test_a_reader_of_the_old_file_never_sees_the_new_one(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with (tmp_path / "a.txt").open() as reader:
        write_atomically(tmp_path / "a.txt", "new")
        assert reader.read() == "old"


def test_an_error_in_the_block_leaves_the_old_file_and_nothing_else(tmp_path):
    (tmp_path / "a.txt").write_text("old")
    with pytest.raises(ZeroDivisionError), temporary_beside(tmp_path / "a.txt") as temporary:
        temporary.write_text(f"half {1 / 0}")
    assert (names(tmp_path), (tmp_path / "a.txt").read_text()) == (["a.txt"], "old")


def test_the_temporary_file_has_the_suffix_of_the_wanted_one(tmp_path):
    with temporary_beside(tmp_path / "map.npz") as temporary:
        assert temporary.suffix == ".npz"


def test_a_new_file_has_the_rights_of_an_ordinary_one(tmp_path):
    # Known truth: what open() gives under the same umask.
    (tmp_path / "ordinary").write_text("x")
    write_atomically(tmp_path / "ours", "x")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "ordinary").stat().st_mode


def test_a_folder_in_the_place_of_the_file_is_refused(tmp_path):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(UsageError, match=r"cannot write .*a\.txt: it is a folder; name a file"):
        write_atomically(tmp_path / "a.txt", "x")


def test_a_pipe_or_device_is_not_replaced(tmp_path):
    # A pipe stands for devices too: where a test may replace one of these, it must not try.
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UsageError, match=r"cannot write .*pipe: it is a device or pipe; name a file"):
        write_atomically(tmp_path / "pipe", "x")
    with pytest.raises(UsageError, match=r"--json: .*pipe is a device or pipe, wanted a file; name a file"):
        require_writable(tmp_path / "pipe", "--json")
    assert (tmp_path / "pipe").is_fifo()


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("x")
    with pytest.raises(
        UsageError, match=r"cannot write .*out.a\.txt: .*; name a file in a folder that you may write to"
    ):
        write_atomically(tmp_path / "out" / "a.txt", "x")


def test_a_disk_that_fails_while_writing_is_reported_in_one_sentence(tmp_path):
    with pytest.raises(UsageError, match=r"cannot write .*: no space left on device"), temporary_beside(tmp_path / "a"):
        raise OSError(28, os.strerror(28))


READERS = {
    "log": read_raw,
    "column map": read_column_map,
    "corrected.yaml": read_corrected,
    "diagnosis.json": read_diagnosis,
    "robot.yaml": lambda path: read_robot_config(Path(path)),
    "effects": effects_in,
}


@pytest.mark.parametrize("reader", READERS)
def test_a_device_without_an_end_is_refused(reader):
    with pytest.raises(PhantomDynError, match=r"/dev/zero is a device, wanted .*save what it gives"):
        READERS[reader]("/dev/zero")


@pytest.mark.parametrize("reader", READERS)
def test_a_pipe_that_nobody_writes_to_is_refused(reader, tmp_path):
    pipe = tmp_path / "log.csv"
    os.mkfifo(pipe)
    with pytest.raises(PhantomDynError, match="is a pipe, wanted "):
        READERS[reader](pipe)


@pytest.mark.parametrize("reader", ["column map", "corrected.yaml", "robot.yaml", "effects"])
def test_a_folder_is_refused(reader, tmp_path):
    with pytest.raises(PhantomDynError, match="is a folder, wanted "):
        READERS[reader](tmp_path)


def test_a_device_is_no_robot():
    with pytest.raises(PhantomDynError, match="There is no robot file '/dev/zero'"):
        load_robot("/dev/zero")


@pytest.mark.parametrize("text", ["=1+2", "+1", "-cmd|' /C calc'!A0", "@SUM(A1)", "\t=1", "\r=1"])
def test_a_text_that_begins_as_a_formula_is_marked_as_text(text):
    assert text_cell(text) == f"'{text}"


@pytest.mark.parametrize("text", ["turn", "1 + 2", "", "a=b", None])
def test_any_other_text_stays_as_it_is(text):
    assert text_cell(text) == text


def test_names_with_commas_are_one_column_each():
    names = ["t", "q.a,b", 'q."c"', "tau.d"]
    assert next(csv.reader([header_line(names)])) == names


class Enough(Exception):
    """Ends a diagnosis where the test has seen enough."""


def test_a_long_recording_that_the_diagnosis_reads_is_let_go_before_the_first_fit(planar2):
    read: list[weakref.ref[Recording]] = []

    def long(_: bool) -> tuple[Recording, ...]:
        t = np.arange(0.0, 7200.0, 0.05)
        q = np.column_stack([np.sin(t), np.cos(t)])
        whole = Recording("long.csv", planar2.joint_names, t, q, np.ones_like(q))
        read.append(weakref.ref(whole))
        return (whole,)

    def look(said: Announcement) -> None:
        if said.stage is Stage.FILTERING:
            assert read[0]() is None
            raise Enough

    with pytest.raises(Enough):
        diagnose(planar2, long, progress=look)
