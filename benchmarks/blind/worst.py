"""Table of every result for each make of sealed cases, with the worst make.

Example: ``python benchmarks/blind/worst.py build/blind build/blind-drake --out worst.md``. Each folder belongs to a
finished run (`run.py`); the default is all of them in ``build``. A result that no run has measured stays empty.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.makes import NAMES
from benchmarks.gapbench.scoring.figures import FIGURES, Figure, Score
from benchmarks.gapbench.scoring.proportions import Average, Proportion
from benchmarks.gapbench.scoring.tables import FLOORS, table

GROUP = f"gap >= {FLOORS[0]:g}"
OPENED = 1000  # lower seeds are for development
TABLE = "worst_of_makes.md"


@dataclass(frozen=True)
class Scored:
    """A finished run of one make.

    Attributes:
        make: Its name.
        figures: Values of ``score.json`` for gaps of at least two noise floors.
        seeds: Seeds of the cases by kind.
    """

    make: str
    figures: Mapping[str, Mapping]
    seeds: Mapping[str, Sequence[int]]


def scored(folder: Path) -> Scored:
    """Read the run in a folder.

    Raises:
        ValueError: If it was not scored, or contains cases of several makes.
    """
    file = folder / "score" / "score.json"
    if not file.is_file():
        raise ValueError(f"{folder} holds no score: give the folder of a finished run of run.py.")
    said = json.loads(file.read_text())
    answers = [json.loads((folder / "answers" / f"{case['id']}.json").read_text()) for case in said["cases"]]
    makes = {answer.get("make", NAMES[0]) for answer in answers}
    if len(makes) != 1:
        raise ValueError(f"{folder} holds cases of {', '.join(sorted(makes)) or 'no make'}: wanted those of one make.")
    seeds: dict[str, list[int]] = {}
    for answer in answers:
        seeds.setdefault(answer["kind"], []).append(answer["seed"])
    return Scored(makes.pop(), {name: of[GROUP] for name, of in said["figures"].items() if GROUP in of}, seeds)


def score_of(figure: Figure, said: Mapping | None) -> Score | None:
    """A measured value, or None."""
    if not said or not said["total"]:
        return None
    if "hits" in said:
        return Proportion(said["hits"], said["total"])
    low, high = said["interval"]
    return Average(said["mean"], said["total"], (low, high), share="%" in figure.aim)


def worst(figure: Figure, scores: Mapping[str, Score | None]) -> str:
    """The make with the worst value of a result, and this value; empty if fewer than two makes have one."""
    measured = {make: score for make, score in scores.items() if score is not None and isfinite(score.value)}
    if len(measured) < 2:
        return ""
    make = max(measured, key=lambda name: figure.badness(measured[name].value))
    return f"{make}: {measured[make]}"


def _cases(run: Scored) -> str:
    development = all(seed < OPENED for seeds in run.seeds.values() for seed in seeds)
    counts = ", ".join(f"{len(seeds)} {kind}" for kind, seeds in sorted(run.seeds.items()))
    return f"{counts}{' (development)' if development else ''}"


def worst_of_makes(runs: Sequence[Scored]) -> str:
    """Every result of every run with the goal and the worst make, as a markdown table.

    Raises:
        ValueError: If two runs have the same make.
    """
    names = [run.make for run in runs]
    if len(set(names)) < len(names):
        raise ValueError(f"Two runs are of the same make among {', '.join(names)}: give one run of each.")
    rows: list[Sequence[object]] = [("cases", "", *(_cases(run) for run in runs), "")]
    for figure in FIGURES:
        scores = {run.make: score_of(figure, run.figures.get(figure.name)) for run in runs}
        rows.append((figure.name, figure.aim or "-", *scores.values(), worst(figure, scores)))
    return table((f"gap of {FLOORS[0]:g} floors or more", "to reach", *names, "worst"), rows)


def finished(build: Path) -> list[Path]:
    """Folders of finished runs, that of the first make first."""
    folders = [build / ("blind" if name == NAMES[0] else f"blind-{name}") for name in NAMES]
    return [folder for folder in folders if (folder / "score" / "score.json").is_file()]


def main(arguments: list[str] | None = None) -> int:
    """Print the table, and write it to a file if one is given."""
    parser = argparse.ArgumentParser(description="Every figure of sealed cases for each make, and the worst.")
    parser.add_argument("runs", type=Path, nargs="*", metavar="DIR", help="default: the finished runs in build")
    parser.add_argument("--out", type=Path, metavar="FILE")
    given = parser.parse_args(arguments)
    folders = given.runs or finished(Path("build"))
    if not folders:
        parser.error("build holds no finished run: run run.py first, or give the folders of runs")
    try:
        text = worst_of_makes([scored(folder) for folder in folders])
    except ValueError as error:
        parser.error(str(error))
    print(text)
    if given.out:
        given.out.write_text(text + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
