"""Completion of commands, options and files in a shell: ``eval "$(register-python-argcomplete phantom-dyn)"``."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterable, Mapping


def complete(commands: Mapping[str, tuple[str, str]]) -> None:
    """Answer the shell that asks what may come next, and leave the process; does nothing without argcomplete.

    Args:
        commands: Module and purpose of each command by name.
    """
    try:
        argcomplete = importlib.import_module("argcomplete")
    except ImportError:
        return
    argcomplete.autocomplete(every_command(commands))


def every_command(commands: Mapping[str, tuple[str, str]]) -> argparse.ArgumentParser:
    """One parser with all commands, as the shell completes across them."""
    out = argparse.ArgumentParser(prog="phantom-dyn", add_help=False)
    below = out.add_subparsers()
    for name, (module, purpose) in commands.items():
        own: argparse.ArgumentParser = importlib.import_module(module).parser()
        below.add_parser(name, parents=[_without_help(own)], help=purpose)
    return out


def _without_help(parser: argparse.ArgumentParser) -> argparse.ArgumentParser:
    """The arguments of a parser without its ``--help``, which the parser below a command has of its own."""
    out = argparse.ArgumentParser(add_help=False)
    for action in _given(parser):
        out._add_action(action)
    return out


def _given(parser: argparse.ArgumentParser) -> Iterable[argparse.Action]:
    return (action for action in parser._actions if not isinstance(action, argparse._HelpAction))
