"""Opens diagnoses and answers and says how good the diagnosis is.

Example: ``python benchmarks/blind/score.py --answers DIR --results DIR --out DIR``
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from statistics import mean, median

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.confusion import confusion, confusion_text, draw_confusion
from benchmarks.blind.judged import Judged, judged
from benchmarks.blind.proportions import Proportion, proportion

FLOORS = (2.0, 4.0)
COLUMNS: tuple[tuple[str, Callable[[Sequence[Judged]], object]], ...] = (
    ("cases", len),
    ("top-1", lambda c: proportion(x.top1 for x in c)),
    ("by twins", lambda c: proportion(x.top1_table for x in c)),
    ("strict", lambda c: proportion(x.top1_strict for x in c)),
    ("nothing else", lambda c: proportion(x.exact for x in c)),
    ("truth in set", lambda c: proportion(x.in_set for x in c)),
    ("set size", lambda c: average(x.set_size for x in c if x.set_size)),
    ("joint", lambda c: proportion(x.joint for x in c)),
    ("extra finding", lambda c: proportion(x.extra for x in c)),
    ("fits but wrong", lambda c: proportion(x.wrong_but_fits for x in c)),
    ("no claim", lambda c: proportion(not x.claims for x in c)),
    ("gap closed", lambda c: middle(x.gap_closed for x in c)),
    ("magnitude error", lambda c: middle(e for x in c for e in x.errors)),
    ("95 % covers", lambda c: proportion(e for x in c for e in x.covered)),
    ("seconds", lambda c: middle(x.seconds for x in c)),
)


def middle(values: Iterable[float]) -> float | None:
    """Median of the finite values; None without any."""
    finite = [x for x in values if isfinite(x)]
    return float(median(finite)) if finite else None


def average(values: Iterable[float]) -> float | None:
    """Mean; None without any value."""
    values = list(values)
    return float(mean(values)) if values else None


def load_pairs(answers: Path, results: Path, names: Sequence[str] | None = None) -> list[Judged]:
    """Judges every case that has both an answer and a result; ``names`` restricts and must all be there."""
    wanted = sorted(p.stem for p in results.glob("*.json")) if names is None else names
    missing = [n for n in wanted if not (answers / f"{n}.json").is_file() or not (results / f"{n}.json").is_file()]
    if missing:
        raise SystemExit(f"{len(missing)} cases lack a result or an answer, first {missing[0]}: run run.py first.")
    return [
        judged(json.loads((answers / f"{n}.json").read_text()), json.loads((results / f"{n}.json").read_text()))
        for n in wanted
    ]


def groups_of(singles: Sequence[Judged]) -> list[tuple[str, list[Judged]]]:
    """Single-effect cases by size, then those of at least the last floor by effect and by robot."""
    large = [x for x in singles if x.gap >= FLOORS[-1]]
    out = [("all", list(singles))]
    out += [(f"gap >= {floor:g}", [x for x in singles if x.gap >= floor]) for floor in FLOORS]
    out += [(f"beyond tolerance >= {floor:g}", [x for x in singles if x.beyond >= floor]) for floor in FLOORS]
    out += [
        (f"gap >= {FLOORS[-1]:g}: {e}", [x for x in large if x.effect == e]) for e in sorted({x.effect for x in large})
    ]
    out += [
        (f"gap >= {FLOORS[-1]:g}: {r}", [x for x in large if x.robot == r]) for r in sorted({x.robot for x in large})
    ]
    return out


def _cell(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.2g}" if isinstance(value, float) else str(value)


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A markdown table whose columns also line up in a terminal."""
    widths = [max(len(row[i]) for row in (header, *rows)) for i in range(len(header))]
    lines = [
        "| " + " | ".join(cell.ljust(w) for cell, w in zip(row, widths, strict=True)) + " |" for row in (header, *rows)
    ]
    return [lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]]


def null_rows(cases: Sequence[Judged]) -> list[tuple[str, Proportion]]:
    """False claims on null cases: any finding, or any verdict other than ``no_gap``."""
    nulls = [x for x in cases if x.kind == "null"]
    rows = [("all", proportion(x.false_claim for x in nulls))]
    return rows + [
        (r, proportion(x.false_claim for x in nulls if x.robot == r)) for r in sorted({x.robot for x in nulls})
    ]


def report(cases: Sequence[Judged]) -> str:
    """The figures as text and markdown."""
    singles, outside = ([x for x in cases if x.kind == kind] for kind in ("single", "outside"))
    failed = proportion(x.verdict == "failed" for x in cases)
    lines = ["# Sealed cases", "", "In brackets: 95 % Wilson interval. Gap: paired difference in noise floors.", ""]
    lines += [
        "## Null cases",
        "",
        *_table(("robot", "cases", "false claims"), [(r, str(p.total), str(p)) for r, p in null_rows(cases)]),
    ]
    lines += ["", f"Diagnoses that failed: {failed}", "", "## Single effects", ""]
    rows = [(name, *(_cell(f(group)) for _, f in COLUMNS)) for name, group in groups_of(singles)]
    lines += _table(("group", *(name for name, _ in COLUMNS)), rows)
    unknown = proportion(x.verdict == "unknown" for x in outside)
    lines += ["", f"Outside the catalogue, {len(outside)} cases: unknown said in {unknown}"]
    lines += ["", "## Truth against leading finding", "", "```", confusion_text(confusion(cases)), "```", ""]
    return "\n".join(lines)


def as_json(cases: Sequence[Judged]) -> dict:
    """The same figures for programs, and the outcome of every case."""

    def plain(value: object) -> object:
        return value.as_json() if isinstance(value, Proportion) else value

    singles = [x for x in cases if x.kind == "single"]
    return {
        "schema": "blind-score/1",
        "false_claims": {r: p.as_json() for r, p in null_rows(cases)},
        "single": {name: {key: plain(f(group)) for key, f in COLUMNS} for name, group in groups_of(singles)},
        "cases": [
            {k: None if isinstance(v, float) and not isfinite(v) else v for k, v in asdict(x).items()} for x in cases
        ],
    }


def write_score(cases: Sequence[Judged], out: Path) -> str:
    """Writes ``score.md``, ``score.json`` and ``confusion.png``; returns the text of the first."""
    out.mkdir(parents=True, exist_ok=True)
    text = report(cases)
    (out / "score.md").write_text(text)
    (out / "score.json").write_text(json.dumps(as_json(cases), indent=1) + "\n")
    draw_confusion(confusion(cases), out / "confusion.png")
    return text


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Score the diagnoses of sealed cases.")
    parser.add_argument("--answers", type=Path, required=True, metavar="DIR")
    parser.add_argument("--results", type=Path, required=True, metavar="DIR")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    given = parser.parse_args(arguments)
    print(write_score(load_pairs(given.answers, given.results), given.out))
    return 0


if __name__ == "__main__":
    sys.exit(main())
