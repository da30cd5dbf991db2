"""Interrupts and completion of the shell."""

import contextlib
import io
import os
import signal
import subprocess
import sys
import threading

import pytest

from identification.cli.main import COMMANDS, every_command, main
from identification.cli.terminal.interrupts import Interrupted, end_if_asked, interruptible
from identification.cli.terminal.progress import Progress
from identification.stages import Announcement, Stage


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("phantom-dyn di", {"diagnose "}),
        ("phantom-dyn diagnose --mot", {"--motion-only "}),
        ("phantom-dyn excite --shapes ", {"fourier", "splines", "triangles"}),
    ],
)
def test_a_shell_is_given_what_may_come_next(line, wanted, tmp_path):
    pytest.importorskip("argcomplete", reason="argcomplete comes with make setup")
    answer = tmp_path / "answer"
    environment = os.environ | {
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(answer),
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_SHELL": "bash",
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    command = [sys.executable, "-c", "from identification.cli.main import main; main([])"]
    subprocess.run(command, env=environment, cwd=tmp_path, timeout=60)
    assert wanted <= set(answer.read_text().split("\n"))


def test_every_command_can_be_completed():
    # Oracle: argparse's own choices.
    (below,) = every_command(COMMANDS)._subparsers._group_actions
    assert list(below.choices) == list(COMMANDS)
    assert "--out" in below.choices["diagnose"]._option_string_actions


def test_without_its_library_the_command_goes_on(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "argcomplete", None)
    monkeypatch.setenv("_ARGCOMPLETE", "1")
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("phantom-dyn ")


# Python remembers a plain KeyboardInterrupt that leaves a string given to exec, and kills the process at its end.
WITHIN_EXEC = """
import signal, sys
from identification.cli import main as frame
def dispatch(words):
    exec("import signal\\nsignal.raise_signal(signal.SIGINT)")
frame._dispatch = dispatch
if __name__ == "__main__":
    sys.exit(frame.main([]))
"""


def test_the_exit_code_is_130_also_within_exec(tmp_path):
    (tmp_path / "within.py").write_text(WITHIN_EXEC)
    child = subprocess.run(
        [sys.executable, "-m", "within"],
        cwd=tmp_path,
        capture_output=True,
        check=False,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert (child.returncode, child.stderr) == (130, b"phantom-dyn: interrupted\n")


@pytest.fixture
def usual_handling():
    """Python's own handling of Ctrl-C, which a test run in the background of a script does not have."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("usual_handling")
def test_an_interrupt_that_was_swallowed_ends_the_command_at_its_next_stage():
    def swallowing() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except BaseException:
            return

    with interruptible(), Progress(Stage.READING, io.StringIO()) as progress:
        progress.show(Announcement(Stage.READING))
        swallowing()
        with pytest.raises(Interrupted):
            progress.show(Announcement(Stage.FILTERING))


@pytest.mark.usefixtures("usual_handling")
def test_the_handling_of_before_is_back_afterwards():
    with interruptible():
        assert signal.getsignal(signal.SIGINT) is not signal.default_int_handler
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    end_if_asked()


def test_a_process_that_ignores_interrupts_goes_on_ignoring_them():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interruptible():
            within = signal.getsignal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        assert (within, signal.getsignal(signal.SIGINT)) == (signal.SIG_IGN, signal.SIG_IGN)
    finally:
        signal.signal(signal.SIGINT, before)


def test_another_thread_may_run_a_command():
    # Only the main thread may set a handler: Python raises ValueError elsewhere.
    ended = []
    thread = threading.Thread(target=lambda: ended.append(interruptible().__enter__()))
    thread.start()
    thread.join()
    assert ended == [None]


@pytest.mark.parametrize("name", ["SIGTERM", "SIGHUP"])
def test_a_signal_that_ends_a_process_ends_the_command_with_its_number(tmp_path, name):
    # Oracle: the shell's convention, 128 and the number of the signal.
    (tmp_path / "within.py").write_text(WITHIN_EXEC.replace("SIGINT", name))
    child = subprocess.run([sys.executable, "-m", "within"], cwd=tmp_path, capture_output=True, check=False)
    assert child.returncode == 128 + getattr(signal, name)
    assert child.stderr == b"phantom-dyn: interrupted\n"


def test_sigterm_lets_the_blocks_that_are_open_clean_up(tmp_path):
    left = []

    def ended() -> None:
        with interruptible(), contextlib.ExitStack() as opened:
            opened.callback(left.append, "cleaned")
            signal.raise_signal(signal.SIGTERM)

    with pytest.raises(Interrupted):
        ended()
    assert left == ["cleaned"]
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
