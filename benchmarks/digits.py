"""Diagnose each case of a folder with 7, 9 and 17 digits in its log, and print the differences.

    python benchmarks/digits.py FOLDER [--only NAME ...]

Cases are folders as for `given_cases`. 17 digits represent a double exactly; nine digits of a position in rad are
nanoradians, which no encoder resolves. So verdict and findings have to be the same. If two causes fit almost equally
well, the ninth digit may decide between them. Each cause must then be a rival of the other.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.given_cases import diagnosed, log_of

DIGITS = (17, 9, 7)
Place = tuple[str, str | None]


@dataclass(frozen=True)
class Answer:
    """The parts of a diagnosis that digits must not change.

    Attributes:
        verdict: Its verdict, or ``failed``.
        findings: Effects and joints of the findings.
        rivals: Effects and joints of their rivals.
        closed: Share of the gap that is closed, or NaN.
    """

    verdict: str
    findings: frozenset[Place] = frozenset()
    rivals: frozenset[Place] = frozenset()
    closed: float = float("nan")


def written(log: Path, digits: int, out: Path) -> None:
    """Write the columns of an NPZ or CSV log as CSV with a number of significant digits."""
    if log.suffix == ".npz":
        with np.load(log) as columns:
            named = {name: columns[name] for name in columns.files}
    else:
        table = np.genfromtxt(log, delimiter=",", names=True, deletechars="", dtype=float)
        named = {name: table[name] for name in table.dtype.names or ()}
    np.savetxt(out, np.column_stack([*named.values()]), f"%.{digits}g", ",", header=",".join(named), comments="")


def answer_of(document: dict | None) -> Answer:
    """Answer of a ``diagnosis.json``; None stands for a diagnosis that failed or was refused."""
    if document is None:
        return Answer("failed")
    rivals = (at for one in document["findings"] for rival in one["rivals"] for at in rival["effects"])
    return Answer(
        document["verdict"],
        frozenset((one["effect"], one["joint"]) for one in document["findings"]),
        frozenset((at["effect"], at["joint"]) for at in rivals),
        document["gap"]["closed"] if document["gap"]["closed"] is not None else float("nan"),
    )


def differences(answers: dict[int, Answer]) -> list[str]:
    """One line for each number of digits with another verdict or other findings than with all digits."""
    whole = answers[max(answers)]
    return [
        f"{digits} digits: {_words(one)}; all digits: {_words(whole)}{_as_rivals(one, whole)}"
        for digits, one in answers.items()
        if (one.verdict, one.findings) != (whole.verdict, whole.findings)
    ]


def _as_rivals(one: Answer, whole: Answer) -> str:
    """Whether each finding that replaces another one is its rival in both answers."""
    rivals = one.findings - whole.findings <= whole.rivals and whole.findings - one.findings <= one.rivals
    return " (rivals of each other)" if rivals and one.verdict == whole.verdict else ""


def _words(one: Answer) -> str:
    named = ", ".join(sorted(f"{effect} {joint or ''}".strip() for effect, joint in one.findings)) or "nothing"
    return f"{one.verdict}, {named}, {100 * one.closed:.0f} % closed"


def answer_with(folder: Path, digits: int) -> Answer:
    """Diagnose a case whose log is written with a number of digits."""
    with tempfile.TemporaryDirectory() as place:
        log = Path(place) / "log.csv"
        written(log_of(folder), digits, log)
        return answer_of(diagnosed(folder, log))


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line, diagnose every case three times and print the differences."""
    parser = argparse.ArgumentParser(description="What digits of a log change of a diagnosis.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", help="names of cases")
    options = parser.parse_args(words)
    cases = sorted(path.parent for path in options.folder.glob("*/robot.urdf"))
    cases = [case for case in cases if not options.only or case.name in options.only]
    if not cases:
        parser.exit(2, f"{options.folder} holds no case: wanted folders with robot.urdf and a log\n")
    changed = 0
    for case in cases:
        lines = differences({digits: answer_with(case, digits) for digits in DIGITS})
        changed += bool(lines)
        print(case.name, "the same" if not lines else "", *(f"\n  {line}" for line in lines), flush=True)
    print(f"digits change {changed} of {len(cases)}")


if __name__ == "__main__":
    main()
