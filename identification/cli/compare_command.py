"""The command ``phantom-dyn compare``: reports changes between diagnoses."""

from __future__ import annotations

import argparse
from pathlib import Path

from identification.cli.arguments import DONE, Parser, one_blas_thread
from identification.cli.terminal.printed import say
from phantom_dyn.errors import UsageError


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn compare",
        description="Say what changed between diagnoses of one robot: verdicts, findings, and sizes with their 95 % "
        "intervals. A size has changed if two diagnoses differ by more than chance explains, at 5 % over all sizes.",
        examples=(
            "compare before/ after/ --out changes.html",
            "compare monday.json tuesday.json wednesday.json",
        ),
    )
    out.add_argument(
        "diagnoses", metavar="DIAGNOSIS", nargs="+", help="diagnosis.json, or the folder of diagnose --out; two or more"
    )
    out.add_argument(
        "--out", metavar="FILE", type=Path, help="write a page with the table and a figure of each size to this file"
    )
    return out


def run(arguments: argparse.Namespace) -> int:
    """Read the diagnoses, print the changes, and write a page with ``--out``."""
    one_blas_thread()
    if len(arguments.diagnoses) < 2:
        raise UsageError(
            f"{arguments.diagnoses[0]} was given alone, wanted two diagnoses or more to compare; see phantom-dyn "
            "compare --help"
        )
    from identification.files import require_not_read, require_own_file, require_writable, write_atomically
    from identification.reporting.comparison import compare, distinct_names
    from identification.reporting.comparison_page import comparison_page
    from identification.reporting.stored.diagnosis_reader import read_diagnosis

    if arguments.out is not None:
        require_writable(arguments.out, "--out")
        require_not_read(arguments.diagnoses, [arguments.out])
        require_own_file(arguments.out, "--out")
    found = [read_diagnosis(path) for path in arguments.diagnoses]
    comparison = compare(found, distinct_names(arguments.diagnoses))
    say(comparison)
    if arguments.out is not None:
        write_atomically(arguments.out, comparison_page(comparison))
        say(f"wrote {arguments.out}")
    return DONE
