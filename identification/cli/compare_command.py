"""``phantom-dyn compare``: what changed between diagnoses."""

from __future__ import annotations

import argparse

from identification.cli.arguments import DONE, Parser, one_blas_thread
from identification.cli.terminal.printed import say
from phantom_dyn.errors import UsageError


def parser() -> argparse.ArgumentParser:
    """The command's arguments."""
    out = Parser(
        prog="phantom-dyn compare",
        description="Say what changed between diagnoses of one robot: verdicts, findings, and sizes with their 95 % "
        "intervals. A size has changed if two diagnoses differ by more than chance explains, at 5 % over all sizes.",
        examples=("compare before/ after/", "compare monday.json tuesday.json wednesday.json"),
    )
    out.add_argument(
        "diagnoses", metavar="DIAGNOSIS", nargs="+", help="diagnosis.json, or the folder of diagnose --out; two or more"
    )
    return out


def run(arguments: argparse.Namespace) -> int:
    """Read the diagnoses and print what changed."""
    one_blas_thread()
    if len(arguments.diagnoses) < 2:
        raise UsageError(
            f"{arguments.diagnoses[0]} was given alone, wanted two diagnoses or more to compare; see phantom-dyn "
            "compare --help"
        )
    from identification.reporting.comparison import compare, distinct_names
    from identification.reporting.diagnosis_reader import read_diagnosis

    found = [read_diagnosis(path) for path in arguments.diagnoses]
    say(compare(found, distinct_names(arguments.diagnoses)))
    return DONE
