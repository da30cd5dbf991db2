from __future__ import annotations

import os

import pytest

from identification.files import temporary_beside, write_atomically
from phantom_dyn.errors import UsageError


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_text_is_written_as_utf8_with_its_line_ends(tmp_path):
    write_atomically(tmp_path / "a.txt", "τ\r\n")
    assert (tmp_path / "a.txt").read_bytes() == "τ\r\n".encode()


def test_bytes_are_written_as_they_are(tmp_path):
    write_atomically(tmp_path / "a.bin", b"\x00\xff")
    assert (tmp_path / "a.bin").read_bytes() == b"\x00\xff"


def test_missing_folders_are_made(tmp_path):
    write_atomically(tmp_path / "one" / "two" / "a.txt", "x")
    assert (tmp_path / "one" / "two" / "a.txt").read_text() == "x"


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


def test_a_text_of_the_path_is_enough(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_atomically("a.txt", "x")
    assert names(tmp_path) == ["a.txt"]


def test_nothing_but_the_file_is_left(tmp_path):
    write_atomically(tmp_path / "a.txt", "x")
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


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path):
    (tmp_path / "out").write_text("x")
    with pytest.raises(
        UsageError, match=r"cannot write .*out.a\.txt: .*; name a file in a folder that you may write to"
    ):
        write_atomically(tmp_path / "out" / "a.txt", "x")


def test_a_disk_that_fails_while_writing_is_told_in_one_sentence(tmp_path):
    with pytest.raises(UsageError, match=r"cannot write .*: no space left on device"), temporary_beside(tmp_path / "a"):
        raise OSError(28, os.strerror(28))
