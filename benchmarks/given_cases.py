"""Diagnose a folder of cases with known answers, and print how often verdict, cause and numbers are right.

    python benchmarks/given_cases.py FOLDER [--jobs 2] [--only NAME ...]

Each case is a folder with ``robot.urdf``, ``robot.yaml``, ``log.npz`` or ``log.csv``, and ``answer.json``: a list
``effects`` with effect, joint and ``accept`` (sets of effects, pairs of name and joint, that no data could distinguish
from it; each of them counts as right), and ``gap_over_floor``. An effect that the catalogue does not have is a cause
from outside. The diagnosis gets only the robot and the log.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.blind.contradictions import contradiction
from phantom_dyn.effects.catalogue import EFFECTS

LEAST_FLOORS = 2.0  # smaller gaps are printed, but do not count
EVENTS = ("push", "contact")
Place = tuple[str, str | None]


@dataclass(frozen=True)
class Answered:
    """One case and its diagnosis.

    Attributes:
        name: Name of the folder.
        floors: Paired gap [noise floors].
        truth: True effects and joints; empty for a null.
        accepted: Sets of effects that count as right for each of them.
        said: The diagnosis, or None.
    """

    name: str
    floors: float
    truth: tuple[Place, ...]
    accepted: tuple[frozenset[Place], ...]
    said: dict | None

    @property
    def verdict(self) -> str:
        """Verdict of the diagnosis, or ``failed``."""
        return "failed" if self.said is None else self.said["verdict"]

    @property
    def claims(self) -> list[Place]:
        """All findings, the first finding first."""
        return [] if self.said is None else [(one["effect"], one["joint"]) for one in self.said["findings"]]

    @property
    def reached(self) -> frozenset[Place]:
        """Findings and their rivals."""
        rivals = () if self.said is None else (r for one in self.said["findings"] for r in one["rivals"])
        return frozenset(self.claims) | {(at["effect"], at["joint"]) for rival in rivals for at in rival["effects"]}

    @property
    def kind(self) -> str:
        """``null``, ``single``, ``pair`` or ``outside``."""
        if not self.truth:
            return "null"
        if any(effect not in {known.name for known in EFFECTS} for effect, _ in self.truth):
            return "outside"
        return "single" if len(self.truth) == 1 else "pair"

    @property
    def pushed(self) -> bool:
        """True if the diagnosis states times at which something acts."""
        return self.said is not None and bool(self.said["unexplained"]["where"]["times"])


def answered(folder: Path, said: dict | None) -> Answered:
    """A case with its answer and its diagnosis."""
    answer = json.loads((folder / "answer.json").read_text())
    truth = tuple((one["effect"], one["joint"]) for one in answer["effects"])
    accepted = tuple(
        frozenset([(one["effect"], one["joint"]), *(tuple(at) for twins in one.get("accept", ()) for at in twins)])
        for one in answer["effects"]
    )
    return Answered(folder.name, float(answer["gap_over_floor"]), truth, accepted, said)


def log_of(folder: Path) -> Path:
    """The log of a case."""
    return next(path for path in (folder / "log.npz", folder / "log.csv") if path.exists())


def diagnosed(folder: Path, log: Path | None = None) -> dict | None:
    """Diagnose a case, or another log of its robot, with the command; None if it refuses or fails."""
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / "diagnosis.json"
        files = [str(folder / "robot.urdf"), str(log or log_of(folder))]
        words = [sys.executable, "-m", "identification.cli", "diagnose", *files, "--json", str(out)]
        done = subprocess.run(words, capture_output=True, check=False)
        return json.loads(out.read_text()) if done.returncode == 0 else None


def figures(cases: Sequence[Answered]) -> list[str]:
    """One line for every result, over cases with a gap of at least two floors and over nulls."""
    large = [case for case in cases if case.floors >= LEAST_FLOORS]
    of = {kind: [case for case in large if case.kind == kind] for kind in ("single", "pair", "outside")}
    nulls = [case for case in cases if case.kind == "null"]
    events = [case for case in of["outside"] if any(effect in EVENTS for effect, _ in case.truth)]
    quiet = [case for case in cases if case not in events]
    saturated = [case for case in of["single"] if case.truth[0][0] == "torque_saturation"]
    hidden = [case for case in cases if case.kind in ("single", "pair") and case not in large]
    return [
        _figure("false claims on nulls", nulls, lambda case: bool(case.claims)),
        _figure("no_gap on nulls", nulls, lambda case: case.verdict == "no_gap"),
        _figure("leading effect right", of["single"], _leads),
        _figure("true effect listed", of["single"], lambda case: bool(case.reached & case.accepted[0])),
        _figure("hidden, and no wrong claim", hidden, lambda case: not case.claims or _leads(case)),
        _figure("both of a pair", of["pair"], lambda case: all(bool(case.reached & right) for right in case.accepted)),
        _figure("unknown outside", of["outside"], lambda case: case.verdict == "unknown"),
        _figure("saturation named", saturated, lambda case: bool(set(case.claims) & case.accepted[0])),
        _figure("pushes named or unknown", events, lambda case: case.verdict == "unknown" or case.pushed),
        _figure("times of events without any", quiet, lambda case: case.pushed),
        _figure("contradictory verdicts", cases, lambda case: case.said is not None and bool(contradiction(case.said))),
    ]


def _leads(case: Answered) -> bool:
    return bool(case.claims) and case.claims[0] in case.accepted[0]


def _figure(name: str, cases: Sequence[Answered], right: Callable[[Answered], bool]) -> str:
    return f"{name:<30} {sum(bool(right(case)) for case in cases):3} of {len(cases)}"


def row(case: Answered) -> str:
    """One line for a case: gap, truth, verdict, findings, and contradictions of the verdict."""
    truth = " + ".join(_named(place) for place in case.truth) or "nothing"
    said = ", ".join(_named(place) for place in case.claims)
    wrong = contradiction(case.said) if case.said is not None else None
    return f"{case.name}  {case.floors:6.1f}  {truth}  ->  {case.verdict}: {said}" + (f"  ({wrong})" if wrong else "")


def _named(place: Place) -> str:
    return place[0] if place[1] is None else f"{place[0]} {place[1]}"


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line, diagnose every case and print one line for each, then the results."""
    parser = argparse.ArgumentParser(description="Cases with answers: how often the diagnosis is right.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=[])
    given = parser.parse_args(words)
    folders = sorted(path.parent for path in given.folder.glob("*/answer.json"))
    folders = [folder for folder in folders if not given.only or folder.name in given.only]
    if not folders:
        raise SystemExit(f"{given.folder} holds no case: wanted folders with robot.urdf, a log and answer.json")
    with ThreadPoolExecutor(given.jobs) as pool:
        cases = []
        for folder, said in zip(folders, pool.map(diagnosed, folders), strict=True):
            cases.append(answered(folder, said))
            print(row(cases[-1]), flush=True)
    print("\n".join(["", *figures(cases)]))


if __name__ == "__main__":
    main()
