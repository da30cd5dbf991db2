"""The command ``phantom-dyn doctor``: prints the versions of libraries, and names the missing ones."""

from __future__ import annotations

import argparse
import os
import platform
import re
import sys
from collections.abc import Iterable
from importlib import metadata

from identification.cli.arguments import DONE, Parser
from identification.cli.terminal.printed import say
from phantom_dyn import __version__
from phantom_dyn.libraries import OPTIONAL
from phantom_dyn.model.robot_files import builtin_robots, examples_folder


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    return Parser(
        prog="phantom-dyn doctor",
        description="Print the versions of phantom-dyn, Python and the libraries, and what is missing with the command "
        "that installs it. Please add it to a report of an error.",
        examples=("doctor", "doctor > versions.txt"),
    )


def run(arguments: argparse.Namespace) -> int:
    """Print the versions; the exit code is 0 even if libraries are missing."""
    del arguments
    say(f"phantom-dyn {__version__}")
    say(f"Python {platform.python_version()} at {sys.executable}")
    say(f"{platform.platform()}, {os.cpu_count()} processor cores")
    say("\nlibraries:")
    optional = {library.distribution: library for library in OPTIONAL}
    missing = []
    for name in required(metadata.requires("phantom-dyn") or ()):
        if name not in optional:
            say(f"  {name:<20} {version_of(name) or 'MISSING'}")
            missing += [] if version_of(name) else [name]
    say("\nfor some uses only:")
    for library in OPTIONAL:
        found = version_of(library.distribution)
        version = found or f"missing: pip install 'phantom-dyn[{library.extra}]'"
        use = library.use[0].lower() + library.use[1:]
        say(f"  {library.distribution:<20} {version:<16} {use}")
    say(f"\nbuilt-in robots: {', '.join(builtin_robots()) or 'MISSING'}")
    say(f"robots of example:NAME: {'here' if examples_folder() else 'not installed'}")
    say(f"effects of installed packages: {', '.join(plug_ins()) or 'none'}")
    say(f"recordings (PHANTOM_DYN_DATA): {os.environ.get('PHANTOM_DYN_DATA') or 'not set, they are fetched'}")
    if missing:
        say(f"\nMissing: {', '.join(missing)}. Install phantom-dyn again: pip install --force-reinstall phantom-dyn")
    else:
        say("\nNothing that every use needs is missing.")
    return DONE


def required(requirements: Iterable[str]) -> tuple[str, ...]:
    """Names of the required packages, without those that only an extra requires."""
    plain = [requirement for requirement in requirements if "extra ==" not in requirement]
    return tuple(found[0] for line in plain if (found := re.match(r"[\w.\-]+", line)))


def plug_ins() -> tuple[str, ...]:
    """Names of the entry points that provide effects, with their packages; the entry points are not loaded."""
    found = metadata.entry_points(group="phantom_dyn.effects")
    return tuple(one.name + ("" if one.dist is None else f" ({one.dist.name})") for one in found)


def version_of(name: str) -> str | None:
    """Version of an installed package; None if it is missing."""
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None
