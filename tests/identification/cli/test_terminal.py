"""What diagnose shows on a terminal, and what an interrupt leaves. Oracle: the contract, by a real pseudo-terminal."""

from __future__ import annotations

import io
import os
import pty
import re
import signal
import subprocess
import sys
import threading
import time
from contextlib import nullcontext

import pytest
from numba import njit
from numba.extending import overload

from identification import file_sets
from identification.cli.main import main
from identification.cli.terminal.percentage import Share
from identification.cli.terminal.progress import Progress
from identification.export.file_names import NAMES as MODELS
from identification.reporting.stored.diagnosis_files import INDEX, REPORT
from identification.stages import Announcement, Stage
from phantom_dyn._kernels.jit import Compilation, compiles

pytestmark = pytest.mark.whole


def _asked() -> int:
    """Stands for a compiled function whose compilation says what is shown at that moment."""
    return 0


def watched(words: list[str], interrupt_at: bytes | None = None) -> tuple[int, bytes, bytes]:
    """Exit code, standard output (a pipe) and standard error (a terminal) of the command.

    Args:
        words: Of the command line.
        interrupt_at: Once the terminal shows this, the process gets what Ctrl-C sends.
    """
    controller, terminal = pty.openpty()
    child = subprocess.Popen(
        [sys.executable, "-m", "identification.cli", *words],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=terminal,
        env=os.environ | {"TERM": "xterm", "COLUMNS": "100"},
        # A test run in the background of a script is started with interrupts ignored, and so would be its children.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    os.close(terminal)
    shown = b""
    while True:
        try:
            part = os.read(controller, 4096)
        except OSError:  # Linux: the other end is closed
            part = b""
        if not part:
            break
        shown += part
        if interrupt_at is not None and interrupt_at in shown:
            child.send_signal(signal.SIGINT)
            interrupt_at = None
    assert child.stdout is not None
    printed = child.stdout.read()
    child.stdout.close()
    os.close(controller)
    return child.wait(), printed, shown


OURS = (INDEX, REPORT, *MODELS)


@pytest.fixture(scope="module")
def finished(tmp_path_factory, pendulum, swing, written) -> tuple[int, bytes, bytes]:
    """A run to its end."""
    return watched(["diagnose", str(pendulum), str(written(tmp_path_factory.mktemp("run") / "log.csv", swing))])


def test_progress_is_shown_on_a_terminal(finished):
    code, printed, shown = finished
    assert (code, b"reading" in shown) == (0, True)
    assert re.search(rb"\d % [a-z]", shown)
    assert b"\x1b" not in printed


def test_progress_leaves_the_terminal_clean(finished):
    shown = finished[2]
    # The cursor is shown again and the line erased at the end.
    assert shown.rstrip().endswith((b"\x1b[?25h", b"\x1b[2K"))


def test_a_refusal_on_a_terminal_is_one_line_after_the_progress(pendulum, log):
    log.write_text(log.read_text().replace("q.pin", "q.pim"))
    code, printed, shown = watched(["diagnose", str(pendulum), str(log)])
    last = shown.decode().rstrip().splitlines()[-1]
    assert (code, printed) == (2, b"")
    assert "phantom-dyn: log.csv: column q.pim is of the joint pim" in last


def test_an_interrupt_is_130_and_leaves_nothing(arm, tmp_path, made_columns, written):
    log = written(tmp_path / "log.csv", made_columns(arm))
    words = ["diagnose", str(arm), str(log), "--out", str(tmp_path / "out"), "--json", str(tmp_path / "one.json")]
    code, printed, shown = watched(words, interrupt_at=b"reading")
    assert (code, printed) == (130, b"")
    assert shown.decode().rstrip().endswith("phantom-dyn: interrupted")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log.csv"]


@pytest.mark.parametrize("stage", [Stage.READING, Stage.FILTERING, Stage.RIVALS_COMPARED, Stage.WRITING])
def test_an_interrupt_at_any_stage_leaves_nothing(pendulum, log, monkeypatch, capsys, stage):
    def interrupted(_, announced):
        if announced.stage is stage:
            raise KeyboardInterrupt

    monkeypatch.setattr(Progress, "show", interrupted)
    assert main(["diagnose", str(pendulum), str(log), "--out", str(log.parent / "out")]) == 130
    said = capsys.readouterr()
    # The answer is printed before files are made; they are not.
    assert said.out.startswith("The gap between robot and model") == (stage is Stage.WRITING)
    assert said.err == "phantom-dyn: interrupted\n"
    assert [path.name for path in log.parent.iterdir()] == ["log.csv"]


def test_an_interrupt_between_two_files_leaves_the_old_ones(pendulum, log, monkeypatch):
    out = log.parent / "out"
    out.mkdir()
    for name in OURS:
        (out / name).write_text("old")

    def interrupted_after_the_first(folder, texts):
        name, text = next(iter(texts.items()))
        (folder / name).write_text(text)
        raise KeyboardInterrupt

    monkeypatch.setattr(file_sets, "_write_all", interrupted_after_the_first)
    assert main(["diagnose", str(pendulum), str(log), "--out", str(out)]) == 130
    assert {path.name: path.read_text() for path in out.iterdir()} == dict.fromkeys(OURS, "old")


def test_without_a_terminal_a_line_with_the_stage_is_written_in_equal_times():
    # Oracle: two words shown for ten periods each.
    stream = io.StringIO()
    with Progress(Stage.READING, stream, every=0.02) as progress:
        time.sleep(0.2)
        progress.show(Announcement(Stage.FILTERING))
        time.sleep(0.2)
    lines = stream.getvalue().splitlines()
    assert {line.partition(": ")[2] for line in lines} == {"reading", "filtering"}
    assert all(re.fullmatch(r"\d+ s: \w+", line) for line in lines)
    time.sleep(0.1)
    assert stream.getvalue().splitlines()[len(lines) + 1 :] == []


def test_the_percentage_stands_before_the_stage_and_the_last_line_says_a_hundred():
    # Oracle: the shares of the stages that are given.
    stream = io.StringIO()
    shares = (Share(Stage.READING, 40.0), Share(Stage.WRITING, 60.0))
    with Progress(Stage.READING, stream, stages=shares, every=0.02) as progress:
        progress.show(Announcement(Stage.WRITING))
        time.sleep(0.1)
    shown = [line.partition(": ")[2] for line in stream.getvalue().splitlines()]
    assert all(re.fullmatch(r"[4-9]\d % writing", line) for line in shown[:-1])
    assert (len(shown) > 1, shown[-1]) == (True, "100 % done")


def test_a_run_that_fails_is_never_told_as_done():
    stream = io.StringIO()

    def fails():
        with Progress(Stage.READING, stream, stages=(Share(Stage.READING, 100.0),), every=0.01):
            time.sleep(0.05)
            raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        fails()
    assert "100 %" not in stream.getvalue()


@pytest.mark.skipif(not compiles(), reason="numba is off")
def test_what_is_compiled_is_told_while_it_is_and_not_before_or_after():
    # Oracle: numba's own compilation of a function that no cache holds; its generated body asks what is said.
    said = []

    with Progress(Stage.FILTERING, io.StringIO()) as progress:

        @overload(_asked)
        def compiled():
            said.append(progress.said())
            return lambda: 1

        said.append(progress.said())
        assert njit(lambda: _asked())() == 1
        said.append(progress.said())
    assert said == ["filtering", "filtering; compiling function 1, in a first run only", "filtering"]


def test_without_a_terminal_one_line_says_that_functions_are_compiled(monkeypatch):
    # Oracle: a count of compiled functions as numba's events make it, under way for twenty looks.
    monkeypatch.setattr("identification.cli.terminal.progress.COMPILING_S", 0.02)
    monkeypatch.setattr("identification.cli.terminal.progress._LOOKED_S", 0.01)
    monkeypatch.setattr("phantom_dyn._kernels.jit.watched_compilation", lambda: nullcontext(Compilation(3, 1)))
    stream = io.StringIO()
    with Progress(Stage.FILTERING, stream, every=1e6):
        time.sleep(0.2)
    assert re.fullmatch(r"0 s: filtering; compiling function 3, in a first run only\n", stream.getvalue())


def test_a_short_run_without_a_terminal_writes_nothing():
    stream = io.StringIO()
    with Progress(Stage.READING, stream) as progress:
        progress.show(Announcement(Stage.FILTERING))
    assert stream.getvalue() == ""


def test_a_reader_of_the_progress_that_left_ends_the_telling_and_nothing_else():
    # Oracle: Python's own threads; a thread that died of an error has told pytest, which fails the test.
    stream, before = io.StringIO(), set(threading.enumerate())
    with Progress(Stage.READING, stream, every=0.01) as progress:
        (telling,) = set(threading.enumerate()) - before
        stream.close()
        telling.join(timeout=10.0)
        assert not telling.is_alive()
        progress.show(Announcement(Stage.FILTERING))
