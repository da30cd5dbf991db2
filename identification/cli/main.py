"""Runs the command that the command line names, and prints each error as one sentence.

For completion in a shell: ``eval "$(register-python-argcomplete phantom-dyn)"``.
"""

from __future__ import annotations

import argparse
import difflib
import importlib
import os
import shlex
import sys
from collections.abc import Mapping
from typing import Protocol, cast

from identification.cli.arguments import BAD_INPUT, DONE, INTERRUPTED
from identification.cli.terminal.interrupts import Interrupted, interruptible
from identification.cli.terminal.printed import complain, discard_output, open_streams
from identification.files import disk_full_words, is_disk_full, unreachable_words
from phantom_dyn import __version__
from phantom_dyn.errors import PhantomDynError, UsageError

# Module and purpose of each command. A module is imported only when its command is called. It imports heavy libraries
# only before the computation, so that help and error messages appear at once.
COMMANDS: dict[str, tuple[str, str]] = {
    "diagnose": ("identification.cli.diagnose_command", "find what the model of a robot lacks, from recordings"),
    "identify": (
        "identification.cli.identify_command",
        "estimate inertias, friction and drives, and write models to simulate",
    ),
    "check": ("identification.cli.check_command", "tell what is wrong with a recording, nothing else"),
    "compare": ("identification.cli.compare_command", "say what changed between diagnoses"),
    "why": ("identification.cli.why_command", "say why an effect was named in a diagnosis, or was not"),
    "view": ("identification.cli.view_command", "replay a recording in the browser, beside its simulation"),
    "map": (
        "identification.cli.map_command",
        "map what is felt at the tip over the workspace: mass, friction, stiffness",
    ),
    "excite": ("identification.cli.excite_command", "design a motion that makes a robot's inertias visible"),
    "experiment": (
        "identification.cli.experiment_command",
        "fit a friction test at constant speeds, or the stiffness of a held transmission",
    ),
    "degrade": ("identification.cli.degrade_command", "write the log that a cheaper device would have given"),
    "doctor": ("identification.cli.doctor_command", "print versions, and what is missing"),
    "datasets": ("identification.cli.datasets_command", "list and fetch recordings of real robots"),
}


class Command(Protocol):
    """Functions that the module of a command provides."""

    def parser(self) -> argparse.ArgumentParser:
        """The parser of the command's arguments, an `identification.cli.arguments.Parser`."""
        ...

    def run(self, arguments: argparse.Namespace) -> int:
        """Run the command and return its exit code."""
        ...


def main(argv: list[str] | None = None) -> int:
    """Run one command.

    Args:
        argv: Arguments after the program's name; by default those of the process.

    Returns:
        Exit code: 0 the job was done, 2 bad input, 130 interrupted, 143 ended by SIGTERM.
    """
    open_streams()
    if "_ARGCOMPLETE" in os.environ:  # the shell asks for completions
        complete(COMMANDS)
    try:
        with interruptible():
            code = _dispatch(sys.argv[1:] if argv is None else list(argv))
        sys.stdout.flush()
    except PhantomDynError as error:
        complain(str(error))
        return BAD_INPUT
    except Interrupted as stop:
        complain("interrupted")
        return 128 + stop.number
    except KeyboardInterrupt:
        complain("interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        # The program that reads the output, such as head or less, has ended.
        discard_output(sys.stdout)
        return DONE
    except OSError as error:
        message = disk_full_words(error) if is_disk_full(error) else unreachable_words(error)
        if message is None:
            raise
        complain(message)
        return BAD_INPUT
    return code


def _dispatch(words: list[str]) -> int:
    """Run the command that the first word names, and return its exit code."""
    if not words:
        raise UsageError(f"no command was given, wanted one of {', '.join(COMMANDS)}; see phantom-dyn --help")
    if "" in words:
        raise UsageError(
            f"word {1 + words.index('')} of the command is empty, perhaps a variable of the shell that is not set: "
            "give a value or leave it out"
        )
    name, *rest = words
    if name in ("-h", "--help"):
        print(_help())
        return DONE
    if name == "--version":
        print(f"phantom-dyn {__version__}")
        return DONE
    if name not in COMMANDS:
        raise UsageError(_unknown(name))
    command = cast("Command", importlib.import_module(COMMANDS[name][0]))
    try:
        arguments = command.parser().parse_intermixed_args(rest)  # options may be between the LOGs
    except SystemExit as stop:  # argparse has printed the help
        return int(stop.code or DONE)
    arguments.command = shlex.join(["phantom-dyn", *words])
    return command.run(arguments)


def _help() -> str:
    width = max(map(len, COMMANDS))
    commands = "\n".join(f"  {name:<{width}}  {what}" for name, (_, what) in COMMANDS.items())
    return (
        "usage: phantom-dyn COMMAND ...\n\n"
        "Diagnoses the gap between a robot and its model from a recording.\n\n"
        f"commands:\n{commands}\n\n"
        "options:\n  -h, --help  this text; phantom-dyn COMMAND --help for a command's\n  --version   the version\n\n"
        "exit code: 0 the job was done, whatever it found; 2 bad input\n\n"
        "examples:\n  phantom-dyn diagnose robot.urdf log.csv --out report/\n  phantom-dyn check robot.urdf log.csv"
    )


def _unknown(name: str) -> str:
    """Error message for an unknown command, with the most similar command."""
    nearest = difflib.get_close_matches(name, COMMANDS, n=1)
    hint = f"did you mean {nearest[0]}?" if nearest else "see phantom-dyn --help"
    return f"unknown command {name!r}, wanted one of {', '.join(COMMANDS)}; {hint}"


def complete(commands: Mapping[str, tuple[str, str]]) -> None:
    """Print completions for the shell and end the process; without argcomplete, do nothing.

    Args:
        commands: Module and purpose of each command by name.
    """
    try:
        argcomplete = importlib.import_module("argcomplete")
    except ImportError:
        return
    argcomplete.autocomplete(every_command(commands))


def every_command(commands: Mapping[str, tuple[str, str]]) -> argparse.ArgumentParser:
    """One parser with all commands, for argcomplete."""
    out = argparse.ArgumentParser(prog="phantom-dyn", add_help=False)
    below = out.add_subparsers()
    for name, (module, purpose) in commands.items():
        parser: argparse.ArgumentParser = importlib.import_module(module).parser()
        below.add_parser(name, parents=[_without_help(parser)], help=purpose)
    return out


def _without_help(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """A parser without its ``--help``, because argparse adds this option to the parser of each command."""
    out = argparse.ArgumentParser(add_help=False)
    for action in parser._actions:
        if not isinstance(action, argparse._HelpAction):
            out._add_action(action)
    return out
