import errno
import importlib
import os
import re
import shlex
import subprocess
import sys

import pytest

from identification.cli import main as frame
from identification.cli.__main__ import started
from identification.cli.arguments import Parser
from identification.cli.main import COMMANDS, main
from phantom_dyn import __version__
from phantom_dyn.errors import UsageError
from places import ROBOTS

HEAVY = {"numpy", "scipy", "matplotlib", "pinocchio", "numba", "cvxpy", "plotly", "xarray", "viser", "rosbags"}
# What a process exits with and has loaded after each of its commands.
LISTING = f"""
import sys
from identification.cli.main import main
for line in sys.argv[1:]:
    print("@", line, main(line.split()), *sorted(set(sys.modules) & {HEAVY!r}), file=sys.stderr)
"""
LIGHT = {
    "--help": 0,
    "diagnose --help": 0,
    "check --help": 0,
    "datasets --help": 0,
    "degrade --help": 0,
    "map --help": 0,
    "view --help": 0,
    "doctor": 0,
    "compare a.json": 2,
    "diagnose log.csv arm.urdf": 2,
    "datasets list": 0,
    "nonsense": 2,
    "diagnose": 2,
    "diagnose no_robot.urdf no_log.csv": 2,
    "check no_log.csv": 2,
    "datasets fetch nonsense": 2,
    "degrade no_robot.urdf no_log.csv --effect cogging --out out.csv": 2,
}


class Echo:
    """A command that says what it was given: stands in for a module of identification.cli."""

    def __init__(self, outcome):
        self.outcome = outcome

    def parser(self):
        parser = Parser(prog="phantom-dyn echo")
        parser.add_argument("robot")
        parser.add_argument("log", nargs="+")
        parser.add_argument("--with", dest="with_", action="extend", nargs="+")
        parser.add_argument("--out")
        return parser

    def run(self, arguments):
        return self.outcome(arguments)


@pytest.fixture
def echo(monkeypatch):
    """Replace the command diagnose by one that does what the test says."""

    def install(outcome):
        monkeypatch.setattr(frame.importlib, "import_module", lambda _: Echo(outcome))

    return install


def raising(error):
    def run(_):
        raise error

    return run


def test_help_names_every_command(capsys):
    assert main(["--help"]) == 0
    text = capsys.readouterr().out
    assert all(f"\n  {name} " in text for name in COMMANDS)


@pytest.mark.parametrize(
    ("words", "begin", "end"),
    [
        ([], "no command was given, wanted one of diagnose, identify, check", "\n"),
        (["diagnoes"], "unknown command 'diagnoes'", "did you mean diagnose?\n"),
        (["xyzzy"], "unknown command 'xyzzy'", "see phantom-dyn --help\n"),
    ],
    ids=["none", "one with a mistake", "one like no other"],
)
def test_what_is_no_command_is_refused_with_the_nearest_or_with_the_help(words, begin, end, capsys):
    assert main(words) == 2
    text = capsys.readouterr().err
    assert text.startswith(f"phantom-dyn: {begin}")
    assert text.endswith(end)


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_refuses_an_unknown_option_in_one_sentence(name, capsys):
    assert main([name, "--no-such-option"]) == 2
    text = capsys.readouterr().err
    assert text.startswith("phantom-dyn: ")
    assert text.endswith(f"see phantom-dyn {name} --help\n")
    assert text.count("\n") == 1


@pytest.mark.parametrize("name", COMMANDS)
def test_help_begins_with_the_usage_and_ends_with_two_examples_that_the_command_understands(name, capsys):
    # Oracle: the command's own parser.
    assert main([name, "--help"]) == 0
    usage, _, examples = capsys.readouterr().out.rstrip().partition("\nexamples:\n")
    assert usage.startswith(f"usage: phantom-dyn {name}")
    shown = examples.splitlines()
    assert len(shown) == 2
    for line in shown:
        program, command, *words = shlex.split(line.partition(" > ")[0])
        assert (program, command) == ("phantom-dyn", name)
        importlib.import_module(COMMANDS[name][0]).parser().parse_intermixed_args(words)


def test_the_help_of_all_ends_with_two_examples(capsys):
    main(["--help"])
    assert len(re.findall(r"^  phantom-dyn \w+ ", capsys.readouterr().out, flags=re.MULTILINE)) == 2


def test_options_may_stand_between_the_logs(echo):
    seen = []
    echo(lambda arguments: seen.append(vars(arguments)) or 0)
    main(["diagnose", "r.urdf", "a.csv", "--with", "x", "y", "--out", "o o", "b.csv", "--with", "z"])
    command = "phantom-dyn diagnose r.urdf a.csv --with x y --out 'o o' b.csv --with z"
    assert seen == [
        {"robot": "r.urdf", "log": ["a.csv", "b.csv"], "with_": ["x", "y", "z"], "out": "o o", "command": command}
    ]


@pytest.mark.parametrize(
    ("outcome", "code", "said"),
    [
        (lambda _: 7, 7, ""),
        (raising(UsageError("this cannot be read")), 2, "phantom-dyn: this cannot be read\n"),
        (raising(KeyboardInterrupt), 130, "phantom-dyn: interrupted\n"),
    ],
    ids=["the command's", "a refusal", "an interrupt"],
)
def test_a_command_ends_with_an_exit_code_and_at_most_one_sentence(echo, capsys, outcome, code, said):
    echo(outcome)
    assert (main(["diagnose", "r", "l"]), capsys.readouterr()) == (code, ("", said))


class Interrupts:
    """A finder of modules during whose search for the command Ctrl-C is pressed."""

    def find_spec(self, name: str, path: object = None, target: object = None) -> None:
        if name == "identification.cli.main":
            raise KeyboardInterrupt


def test_an_interrupt_while_the_command_is_loaded_is_exit_code_130(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "identification.cli.main")
    monkeypatch.setattr(sys, "meta_path", [Interrupts(), *sys.meta_path])
    assert (started(), capsys.readouterr()) == (130, ("", "phantom-dyn: interrupted\n"))


@pytest.mark.parametrize(
    "error", [ZeroDivisionError("ours"), OSError(errno.EIO, "no file")], ids=["ours", "of the system, of no file"]
)
def test_an_error_that_is_no_refusal_keeps_its_traceback(echo, error):
    echo(raising(error))
    with pytest.raises(type(error), match=re.escape(str(error))):
        main(["diagnose", "r", "l"])


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EACCES, "/closed/a.csv cannot be reached (permission denied): name another place"),
        (errno.EIO, "/closed/a.csv cannot be reached (input/output error): name another place"),
        (errno.ENAMETOOLONG, "/closed/a.csv cannot be a file (file name too long): write a shorter one"),
    ],
)
def test_a_file_that_the_system_lets_nobody_near_is_a_refusal(echo, capsys, number, words):
    echo(raising(OSError(number, os.strerror(number), "/closed/a.csv")))
    assert main(["diagnose", "r", "l"]) == 2
    assert words in capsys.readouterr().err


def test_a_reader_that_leaves_early_is_no_error():
    # Oracle: the shell's own pipe, closed before a line is written.
    script = "import sys, time; from identification.cli.main import main; time.sleep(0.3); sys.exit(main(['--help']))"
    child = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert child.stdout is not None
    assert child.stderr is not None
    child.stdout.close()
    assert (child.stderr.read(), child.wait()) == (b"", 0)
    child.stderr.close()


@pytest.mark.parametrize(
    ("line", "code"),
    [
        (f"check {ROBOTS / 'pendulum.urdf'} LOG >&- 2>&-", 0),
        ("--help >&-", 0),
        ("diagnose no.urdf no.csv >&- 2>&-", 2),
        ("diagnose no.urdf no.csv 2>/dev/full", 2),
    ],
)
def test_streams_that_are_closed_or_full_change_no_exit_code(line, code, log):
    # Oracle: the shell closes them, and the system's device that takes nothing.
    words = f"{shlex.quote(sys.executable)} -m identification.cli {line.replace('LOG', str(log))}"
    assert subprocess.run(["sh", "-c", words], check=False).returncode == code


def test_the_package_runs_as_a_module_and_says_its_version():
    child = subprocess.run(
        [sys.executable, "-m", "identification.cli", "--version"], capture_output=True, text=True, check=False
    )
    assert (child.returncode, child.stdout) == (0, f"phantom-dyn {__version__}\n")


def test_help_and_early_refusals_import_nothing_heavy(tmp_path):
    command = [sys.executable, "-c", LISTING, *LIGHT]
    child = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=True)
    said = [line for line in child.stderr.splitlines() if line.startswith("@")]
    assert said == [f"@ {line} {code}" for line, code in LIGHT.items()]
