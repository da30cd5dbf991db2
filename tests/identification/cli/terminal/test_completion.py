"""What a shell is told. Oracle: the protocol of argcomplete, by its own library in a process of its own."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from identification.cli.main import COMMANDS, every_command, main


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("phantom-dyn di", {"diagnose "}),
        ("phantom-dyn diagnose --mot", {"--motion-only "}),
        ("phantom-dyn excite --shapes ", {"fourier", "splines", "triangles"}),
    ],
)
def test_a_shell_is_told_what_may_come_next(line, wanted, tmp_path):
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
