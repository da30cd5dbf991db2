"""How the process of a command ends: with all that it has to say and do."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

START = "from identification.cli.__main__ import started"


def run(*lines: str, words: tuple[str, ...] = ("--version",)) -> subprocess.CompletedProcess[str]:
    code = "\n".join(("import atexit, sys", START, f"sys.argv = ['phantom-dyn', *{words!r}]", *lines))
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)


def test_what_a_command_prints_arrives_in_a_pipe():
    assert run("sys.exit(started())").stdout.startswith("phantom-dyn ")


def test_the_exit_code_of_the_process_is_the_commands():
    assert run("sys.exit(started())", words=("diagnose",)).returncode == 2


def test_what_libraries_leave_to_do_at_the_end_is_done():
    assert run("code = started()", "atexit.register(print, 'closed')", "sys.exit(code)").stdout.endswith("closed\n")


def test_an_error_of_ours_ends_with_its_traceback_and_code_1():
    broken = ("import identification.cli.main", "identification.cli.main.COMMANDS = None", "sys.exit(started())")
    ended = run(*broken, words=("diagnose", "r", "l"))
    assert (ended.returncode, ended.stderr.splitlines()[0]) == (1, "Traceback (most recent call last):")


def test_a_stream_that_takes_no_more_is_told():
    code = f"{START}\nimport sys\nsys.argv = ['phantom-dyn', '--version']\nstarted()\nprint('more')"
    with Path("/dev/full").open("w") as full:
        words = [sys.executable, "-c", code]
        ended = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode != 0
    assert "space left" in ended.stderr
