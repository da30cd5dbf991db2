"""Diagnoses sealed cases through the command line, while no answer can be read, and scores the results.

Example: ``python benchmarks/blind/run.py --seeds 100:140 --kind single``. Without ``--seeds``: the reporting seeds.
Resumable: a case that has its result is not diagnosed again.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.generate import KINDS, REPORTING, draw_many, seed_range
from benchmarks.blind.processes import BASELINES, ORACLE, default_command, run_all
from benchmarks.blind.publish import publish
from benchmarks.blind.score import load_baselines, load_pairs, write_score
from benchmarks.blind.seal import sealed

# The baselines make false claims on nearly every null: a third of them is enough to say so.
BASELINE_NULLS = 100
INSIDE = ("single", "pair")


def diagnose_all(
    names: Sequence[str], cases: Path, answers: Path, results: Path, *, command: Sequence[str], jobs: int
) -> None:
    """Diagnoses the cases that have no result yet, the answers sealed all the while."""
    with sealed(answers):
        run_all(command, names, cases, results, jobs=jobs, what="diagnosed")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Diagnose sealed cases and score the results.")
    parser.add_argument("--seeds", type=seed_range, metavar="FIRST:END", help="default: the reporting seeds")
    parser.add_argument("--kind", choices=KINDS, default="mixed", help="only with --seeds")
    parser.add_argument("--work", type=Path, default=Path("build/blind"), metavar="DIR")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--quick", action="store_true", help="no baselines and no oracle")
    parser.add_argument("--publish", action="store_true", help="write table and figure into README.md and docs/")
    given = parser.parse_args(arguments)
    start = time.perf_counter()
    cases, answers, results, baselines, oracle = (
        given.work / name for name in ("cases", "answers", "results", "baselines", "oracle")
    )
    batches = list(REPORTING.items()) if given.seeds is None else [(given.kind, given.seeds)]
    drawn = {kind: draw_many(seeds, kind, cases, answers, given.jobs) for kind, seeds in batches}
    names = [name for batch in drawn.values() for name in batch]
    diagnose_all(names, cases, answers, results, command=default_command(), jobs=given.jobs)
    if not given.quick:
        tried = [name for kind, batch in drawn.items() for name in batch[: BASELINE_NULLS if kind == "null" else None]]
        with sealed(answers):
            run_all(BASELINES, tried, cases, baselines, jobs=given.jobs, what="baselines")
        # From here on answers are open: every diagnosis is written.
        inside = [name for kind in (*INSIDE, "mixed") for name in drawn.get(kind, [])]
        run_all(ORACLE, inside, cases, oracle, jobs=given.jobs, what="told the cause", answers=answers)
    scored = load_pairs(answers, results, names, oracle=oracle)
    beside = None if given.quick else load_baselines(answers, baselines, names)
    out = given.work / "score"
    print(write_score(scored, out, beside))
    minutes = (time.perf_counter() - start) / 60.0
    print(f"{len(names)} cases in {minutes:.0f} minutes, written to {out}")
    if given.publish:
        publish(out, batches, Path(__file__).resolve().parents[2])
    return 0


if __name__ == "__main__":
    sys.exit(main())
