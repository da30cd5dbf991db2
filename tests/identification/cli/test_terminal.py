"""What diagnose shows on a terminal, and what an interrupt leaves. Oracle: the contract, by a real pseudo-terminal.

One recording gives one answer: with one and two threads, other hashes, one and two jobs, again and again.

Oracles: what another process writes, byte for byte but for times and the run's own name; threadpoolctl.
"""

import io
import json
import os
import pty
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba import njit
from numba.extending import overload
from threadpoolctl import threadpool_info, threadpool_limits

from identification import file_sets
from identification.cli.main import main
from identification.cli.terminal.progress import Progress
from identification.data.reading import read_recording
from identification.export.file_names import NAMES as MODELS
from identification.identify.identify import identify
from identification.pipeline import diagnose
from identification.reporting.stored.diagnosis_files import INDEX, REPORT
from identification.stages import Announcement, Stage
from phantom_dyn.model.loading import load_robot
from places import ROBOTS

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
        (out / name).write_text("of phantom-dyn")

    def interrupted_after_the_first(folder, texts):
        name, text = next(iter(texts.items()))
        (folder / name).write_text(text)
        raise KeyboardInterrupt

    monkeypatch.setattr(file_sets, "_write_all", interrupted_after_the_first)
    assert main(["diagnose", str(pendulum), str(log), "--out", str(out)]) == 130
    assert {path.name: path.read_text() for path in out.iterdir()} == dict.fromkeys(OURS, "of phantom-dyn")


def test_without_a_terminal_a_line_is_written_at_an_announcement_ten_seconds_after_the_last(monkeypatch):
    # Oracle: a clock that the test moves, and shares of made-up stages.
    clock = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    monkeypatch.setattr("identification.cli.terminal.progress.EVERY_S", 10.0)
    stream, shares = io.StringIO(), {Stage.READING: 40.0, Stage.WRITING: 60.0}
    with Progress(Stage.READING, stream, stages=shares) as progress:
        for clock[0] in (9.0, 11.0, 20.0, 21.0):
            progress.show(Announcement(Stage.WRITING))
    assert stream.getvalue() == "11 s: 40 % writing\n21 s: 40 % writing\n"


def test_compilation_is_mentioned_while_it_lasts_and_not_before():
    # Oracle: numba's own compilation of a function that no cache holds; its generated body asks what is said.
    said = []

    with Progress(Stage.FILTERING, io.StringIO()) as progress:

        @overload(_asked)
        def compiled():
            said.append(progress.line())
            return lambda: 1

        said.append(progress.line())
        assert njit(lambda: _asked())() == 1
    assert said == ["filtering", "filtering; compiling function 1, in a first run only"]


def test_a_line_without_a_terminal_says_how_many_functions_were_compiled_before_it(monkeypatch):
    # Oracle: numba's own count of signatures of two functions that no cache holds.
    monkeypatch.setattr("identification.cli.terminal.progress.EVERY_S", 0.0)
    stream = io.StringIO()
    with Progress(Stage.READING, stream) as progress:
        progress.show(Announcement(Stage.READING))
        made = [njit(lambda x, more=more: x + more) for more in (1, 2)]
        for function in made:
            function(1.0)
        progress.show(Announcement(Stage.FILTERING))
    count = sum(len(function.signatures) for function in made)
    compiled = f"functions compiled so far, in a first run only: {count}"
    assert stream.getvalue() == f"0 s: reading\n0 s: filtering; {compiled}\n"


def test_a_short_run_without_a_terminal_writes_nothing():
    stream = io.StringIO()
    with Progress(Stage.READING, stream) as progress:
        progress.show(Announcement(Stage.FILTERING))
    assert stream.getvalue() == ""


class Unread(io.StringIO):
    """A stream whose reader is gone: it counts what it was asked to write, and refuses it."""

    asked = 0

    def write(self, text: str) -> int:
        self.asked += 1
        raise BrokenPipeError(32, "Broken pipe", text)


def test_a_run_goes_on_where_the_reader_of_its_progress_left(monkeypatch):
    monkeypatch.setattr("identification.cli.terminal.progress.EVERY_S", 0.0)
    stream = Unread()
    with Progress(Stage.READING, stream, stages={Stage.READING: 40.0, Stage.WRITING: 60.0}) as progress:
        progress.show(Announcement(Stage.READING))
        progress.show(Announcement(Stage.WRITING))
    assert (stream.asked, progress.line()) == (2, "40 % writing")


ROBOT = ROBOTS / "planar2.urdf"


@pytest.fixture(scope="module")
def logs(tmp_path_factory, made_columns, written) -> tuple[Path, Path]:
    """Two short recordings of two joints."""
    folder = tmp_path_factory.mktemp("logs")
    one, other = (made_columns(ROBOT, seconds=8.0, rate=100.0, seed=seed) for seed in (0, 1))
    return written(folder / "a.csv", one), written(folder / "b.csv", other)


def lasting(file: Path) -> str:
    """The text of a diagnosis without what is of its run alone."""
    content = json.loads(file.read_text())
    return json.dumps(content | {"run": None, "seconds": None, "files": None})


def in_a_process(log: Path, out: Path, *, threads: int, hashes: int) -> str:
    """What the command writes with so many threads and such a seed of Python's hashes."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    environment = os.environ | dict.fromkeys(names, str(threads)) | {"PYTHONHASHSEED": str(hashes)}
    words = [sys.executable, "-m", "identification.cli", "diagnose", str(ROBOT), str(log), "--json", str(out)]
    subprocess.run(words, env=environment, check=True, capture_output=True)
    return lasting(out)


def test_files_are_written_although_the_reader_of_the_answer_has_left(logs, tmp_path):
    words = [sys.executable, "-m", "identification.cli", "diagnose", str(ROBOT), str(logs[0]), "--quick"]
    with subprocess.Popen([*words, "--out", str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as child:
        assert child.stdout is not None
        child.stdout.close()
        assert child.wait() == 0
    assert json.loads((tmp_path / "diagnosis.json").read_text())["findings"]


def test_threads_hashes_and_processes_change_nothing(logs, tmp_path):
    one = in_a_process(logs[0], tmp_path / "one.json", threads=1, hashes=0)
    two = in_a_process(logs[0], tmp_path / "two.json", threads=2, hashes=1)
    assert one == two
    assert '"findings": [{' in one


@pytest.mark.nightly
def test_jobs_change_nothing_nor_does_a_batch(logs, tmp_path):
    for jobs in (1, 2):
        words = ["diagnose", str(ROBOT), *map(str, logs), "--each", "--jobs", str(jobs)]
        assert main([*words, "--out", str(tmp_path / str(jobs))]) == 0
    assert main(["diagnose", str(ROBOT), str(logs[0]), "--json", str(tmp_path / "alone.json")]) == 0
    for name in ("a", "b"):
        assert lasting(tmp_path / "1" / name / "diagnosis.json") == lasting(tmp_path / "2" / name / "diagnosis.json")
    assert lasting(tmp_path / "1" / "a" / "diagnosis.json") == lasting(tmp_path / "alone.json")


@pytest.mark.parametrize("work", [diagnose, identify])
def test_linear_algebra_has_one_thread_whatever_was_set(work, logs):
    robot = load_robot(ROBOT)
    threads = set()

    def progress(_: object) -> None:
        threads.update(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")

    with threadpool_limits(limits=2, user_api="blas"):
        work(robot, (read_recording(logs[0], robot),), progress=progress)
    assert threads == {1}


@pytest.mark.parametrize(
    "line",
    [
        "check no.csv",
        "compare no.json nor.json",
        "degrade no.urdf no.csv --effect coulomb_friction --joint j --set torque=1 --out x.csv",
        "diagnose no.urdf no.csv",
        "excite no.urdf --duration 10 --out x.csv",
        "identify no.urdf no.csv --out x",
        "map no.urdf --quantity manipulability --grid x=0:1:2 --out x",
        "view no.urdf no.csv",
    ],
)
def test_every_command_that_computes_asks_for_one_thread_before_numpy_is_loaded(line, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    assert main(line.split()) == 2
    assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
