"""The command ``phantom-dyn datasets list | fetch NAME``: lists or downloads public recordings of real robots."""

from __future__ import annotations

import argparse

from identification.cli.arguments import DONE, Parser
from identification.cli.terminal.printed import say
from identification.data import datasets
from phantom_dyn.errors import LogError, UsageError


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    parser = Parser(
        prog="phantom-dyn datasets",
        description="Recordings of real robots: list them, or fetch one and print its folder. PHANTOM_DYN_DATA names a "
        "folder that holds recordings already, one folder each.",
        examples=("datasets list", "datasets fetch emps"),
    )
    parser.add_argument("action", choices=("list", "fetch"), help="what to do")
    parser.add_argument("name", metavar="NAME", nargs="?", help="recording to fetch")
    return parser


def run(arguments: argparse.Namespace) -> int:
    """List or download recordings, and return the exit code."""
    if arguments.action == "fetch":
        if arguments.name is None:
            raise UsageError(f"fetch needs a name, one of {', '.join(datasets.NAMES)}")
        say(datasets.fetch(arguments.name))
        return DONE
    if arguments.name is not None:
        raise UsageError(f"list takes no name, {arguments.name!r} was given; see phantom-dyn datasets --help")
    say("\n\n".join(_entry(dataset) for dataset in datasets.DATASETS))
    return DONE


def _entry(dataset: datasets.Dataset) -> str:
    """Lines that describe a dataset."""
    return "\n".join(
        [
            f"{dataset.name}: {dataset.what}",
            f"  licence  {dataset.licence}",
            f"  source   {dataset.source}",
            f"  cite     {dataset.citation}",
            f"  here     {_whereabouts(dataset)}",
        ]
    )


def _whereabouts(dataset: datasets.Dataset) -> str:
    """Folder of a dataset on this computer, or how to get the dataset."""
    try:
        folder = datasets.local(dataset.name)
    except LogError as error:
        return f"no: {error}"
    if folder is not None:
        return str(folder)
    if dataset.is_public:
        return f"no: phantom-dyn datasets fetch {dataset.name}"
    return "no: from a mirror only (PHANTOM_DYN_DATA), as the public original has another form"
