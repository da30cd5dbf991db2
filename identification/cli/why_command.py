"""The command ``phantom-dyn why``: explains why an effect was named in a diagnosis, or was not."""

from __future__ import annotations

import argparse

from identification.cli.arguments import DONE, Parser
from identification.cli.terminal.printed import say


def parser() -> argparse.ArgumentParser:
    """The parser of the command's arguments."""
    out = Parser(
        prog="phantom-dyn why",
        description="Say why an effect was named in a diagnosis, or was not: how much of the gap it would close, what "
        "is named in its place, and the gates at which it was tested, each with its figure and its threshold.",
        examples=("why report/ payload", "why diagnosis.json coulomb_friction --joint j2"),
    )
    out.add_argument("diagnosis", metavar="DIAGNOSIS", help="diagnosis.json, or the folder of diagnose --out")
    out.add_argument("effect", metavar="EFFECT", help="name of the effect in the catalogue, such as payload")
    out.add_argument("--joint", metavar="J", help="joint of the effect (default: every joint that the diagnosis tried)")
    return out


def run(arguments: argparse.Namespace) -> int:
    """Read the diagnosis and print the explanation."""
    from identification.reporting.stored.diagnosis_reader import read_diagnosis
    from identification.words.ledger_words import claims_text, why

    say(claims_text(why(read_diagnosis(arguments.diagnosis), arguments.effect, arguments.joint)))
    return DONE
