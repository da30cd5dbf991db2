"""A handful of the kills of `benchmarks/kills.py`, and that it sees what it looks for."""

from __future__ import annotations

import json
import os

import pytest

from benchmarks import kills

RUN, OTHER = "0" * 32, "1" * 32


@pytest.mark.nightly
@pytest.mark.whole
def test_runs_killed_at_random_moments_leave_nothing_broken(tmp_path):
    tally = kills.killed(3, 3, tmp_path)
    assert tally.wrong == []
    assert sum(tally.kills.values()) == 3


@pytest.fixture
def folder(tmp_path):
    """A set of files of one run."""
    out = tmp_path / "out"
    out.mkdir()
    (out / "diagnosis.json").write_text(json.dumps({"run": RUN, "next_experiment": None}))
    (out / "report.html").write_text(f"<html></html>\n<!-- run: {RUN} -->\n")
    (out / "corrected.yaml").write_text(f"a: 1\n# run: {RUN}\n")
    (out / "mine.txt").write_text("what I noted\n")
    (tmp_path / "tmp").mkdir()
    return tmp_path


def test_a_whole_set_is_right(folder):
    assert kills.wrong_set(folder / "out") == []


def test_a_file_of_another_run_is_seen(folder):
    (folder / "out" / "corrected.yaml").write_text(f"a: 1\n# run: {OTHER}\n")
    assert kills.wrong_set(folder / "out") == ["mixed: out: corrected.yaml are not of the run of diagnosis.json"]


def test_a_motion_of_another_run_is_seen(folder):
    (folder / "out" / "next.csv").write_text("t\n0\n")
    (folder / "out" / "diagnosis.json").write_text(
        json.dumps({"run": RUN, "next_experiment": {"reference_sha256": "another"}})
    )
    assert kills.wrong_set(folder / "out") == ["mixed: out: next.csv are not of the run of diagnosis.json"]


def test_half_a_file_is_seen(folder):
    (folder / "out" / "diagnosis.json").write_text('{"run": ')
    assert kills.wrong_set(folder / "out")[0].startswith("broken: out")


def test_a_missing_file_is_seen(folder):
    (folder / "out" / "report.html").unlink()
    assert kills.wrong_set(folder / "out") == ["broken: out lacks report.html"]


def test_litter_is_seen(folder):
    (folder / "out" / f".a.12{kills.MARK}.json").write_text("")
    (folder / "tmp" / "tmpabc").write_text("")
    assert len(kills.litter(folder)) == 2


def test_a_process_is_known_by_its_token(monkeypatch):
    assert kills.alive("nobody has this") == []
    pipe = kills.subprocess.PIPE
    child = kills.subprocess.Popen(["cat"], env={**os.environ, "PHANTOM_DYN_KILLS": "mine"}, stdin=pipe, stdout=pipe)
    assert child.stdin is not None
    assert child.stdout is not None
    try:
        # What it gives back shows that it runs: while a program is being loaded, its environment is empty.
        child.stdin.write(b"1")
        child.stdin.flush()
        child.stdout.read(1)
        assert kills.alive("mine") == [child.pid]
    finally:
        child.kill()
        child.communicate()
