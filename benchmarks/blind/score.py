"""Compare diagnoses with the answers, and compute how good the diagnosis is.

Example: ``python benchmarks/blind/score.py --answers DIR --results DIR --out DIR``; several folders in the same order
are scored together.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.confusion import confusion, confusion_text, draw_confusion
from benchmarks.blind.makes.real.context import entry_without_context
from benchmarks.gapbench.scoring.figures import FIGURES, beyond
from benchmarks.gapbench.scoring.judged import Judged, judged
from benchmarks.gapbench.scoring.proportions import proportion
from benchmarks.gapbench.scoring.reliability import bins_as_json, calibration_error
from benchmarks.gapbench.scoring.submission import in_true_floors
from benchmarks.gapbench.scoring.tables import FLOORS, aims, beside, calibration, misses, others, singles, wrapped

BASELINES = ("always_coulomb", "independent_bic", "mujoco_sysid")


def _read(path: Path) -> dict:
    return json.loads(path.read_text())


def load_pairs(
    answers: Path, results: Path, names: Sequence[str] | None = None, *, oracle: Path | None = None
) -> list[Judged]:
    """Judge every case that has an answer and a result; with ``names`` only these cases, which must all exist."""
    wanted = sorted(p.stem for p in results.glob("*.json")) if names is None else names
    missing = [n for n in wanted if not (answers / f"{n}.json").is_file() or not (results / f"{n}.json").is_file()]
    if missing:
        raise SystemExit(f"{len(missing)} cases lack a result or an answer, first {missing[0]}: run run.py first.")

    def oracle_of(name: str) -> dict | None:
        path = oracle / f"{name}.json" if oracle else None
        return _read(path) if path and path.is_file() else None

    read = ((n, _read(answers / f"{n}.json"), _read(results / f"{n}.json")) for n in wanted)
    return [judged(answer, entry_without_context(answer, entry), oracle_of(n)) for n, answer, entry in read]


def load_baselines(answers: Path, results: Path, names: Sequence[str]) -> dict[str, list[Judged]]:
    """Judge the baselines, each over the cases that it was given."""
    out: dict[str, list[Judged]] = {name: [] for name in BASELINES}
    for case in names:
        path = results / f"{case}.json"
        if not path.is_file():
            continue
        entry, answer = _read(path), _read(answers / f"{case}.json")
        said = entry["diagnosis"] or {}
        for name, cases in out.items():
            diagnosis = said.get(name)
            if diagnosis and diagnosis.get("left_out"):
                continue
            seconds = diagnosis["seconds"] if diagnosis else entry["seconds"]
            if diagnosis and diagnosis["verdict"] == "failed":
                diagnosis = None
            if diagnosis and diagnosis["joints"]:
                # A baseline states no noise floor: the true one is used for its residuals.
                diagnosis = {**diagnosis, "joints": in_true_floors(answer, diagnosis["joints"])}
            cases.append(judged(answer, {**entry, "diagnosis": diagnosis, "seconds": seconds}))
    return out


def report(cases: Sequence[Judged], baselines: Mapping[str, Sequence[Judged]] | None = None) -> str:
    """The results as markdown."""
    failed = proportion(x.verdict == "failed" for x in cases)
    lines = [
        wrapped(
            "In brackets: 95 % intervals (Wilson's for shares). Gap: paired difference to the same run without the "
            "effect, in noise floors; of a pair that of the smaller effect."
        ),
        "",
        aims(cases),
        "",
        f"Cases: {len(cases)}. Diagnoses that failed: {failed}.",
    ]
    if baselines:
        lines += ["", beside(cases, baselines)]
    if said := misses(cases):
        lines += ["", said]
    lines += ["", singles(cases), "", others(cases), "", calibration(cases), ""]
    error = calibration_error(cases)
    if isfinite(error):
        lines += [f"Mean distance of stated probability and share right: {error:.2f}.", ""]
    return "\n".join(lines)


def as_json(cases: Sequence[Judged], baselines: Mapping[str, Sequence[Judged]] | None = None) -> dict:
    """The same results for programs, with the outcome of every case."""
    groups = {f"gap >= {floor:g}": beyond(cases, floor) for floor in (*FLOORS, 0.0)}
    return {
        "schema": "blind-score/2",
        "figures": {
            figure.name: {"aim": figure.aim, **{name: figure.of(group).as_json() for name, group in groups.items()}}
            for figure in FIGURES
        },
        "baselines": {
            name: {figure.name: figure.of(beyond(group, FLOORS[0])).as_json() for figure in FIGURES}
            for name, group in (baselines or {}).items()
        },
        "reliability": bins_as_json(cases),
        "cases": [x.as_json() for x in cases],
    }


def write_score(cases: Sequence[Judged], out: Path, baselines: Mapping[str, Sequence[Judged]] | None = None) -> str:
    """Write ``score.md``, ``score.json`` and ``confusion.png``; return the text of the first."""
    out.mkdir(parents=True, exist_ok=True)
    text, counts = report(cases, baselines), confusion(cases)
    (out / "score.md").write_text(text)
    (out / "score.json").write_text(json.dumps(as_json(cases, baselines), indent=1) + "\n")
    (out / "confusion.txt").write_text(confusion_text(counts) + "\n")
    draw_confusion(counts, out / "confusion.png")
    return text


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Score the diagnoses of sealed cases.")
    parser.add_argument("--answers", type=Path, required=True, nargs="+", metavar="DIR")
    parser.add_argument("--results", type=Path, required=True, nargs="+", metavar="DIR")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--oracle", type=Path, metavar="DIR", help="fits that were given the true cause")
    parser.add_argument("--baselines", type=Path, metavar="DIR", help="what the baselines said")
    given = parser.parse_args(arguments)
    if len(given.answers) != len(given.results):
        parser.error("give one folder of results for each folder of answers")
    if len(given.answers) > 1 and (given.oracle or given.baselines):
        parser.error("oracle and baselines belong to one folder of answers")
    folders = zip(given.answers, given.results, strict=True)
    cases = [case for answers, results in folders for case in load_pairs(answers, results, oracle=given.oracle)]
    baselines = load_baselines(given.answers[0], given.baselines, [x.id for x in cases]) if given.baselines else None
    print(write_score(cases, given.out, baselines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
