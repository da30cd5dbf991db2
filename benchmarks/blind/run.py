"""Diagnose sealed cases with the command line while the answers are encrypted, and score the results.

Example: ``python benchmarks/blind/run.py --singles 100:140 --nulls 100:120`` scores both ranges together. Without
seeds, the reporting ranges are used. ``--make NAME`` selects another make. An interrupted run can be continued: a case
with a result is not diagnosed again.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.generate import FIRST, add_seed_options, case_ids, chosen_batches, draw_many
from benchmarks.blind.makes import ALONE
from benchmarks.blind.processes import BASELINES, ORACLE, default_command, run_all
from benchmarks.blind.publish import publish
from benchmarks.blind.score import load_baselines, load_pairs, write_score
from benchmarks.blind.worst import TABLE, finished, scored, worst_of_makes
from benchmarks.gapbench.seal import sealed

# Number of cases of each kind on which baselines and oracle run: enough to compare them, in a third of the time.
BESIDE = 100
INSIDE = ("single", "pair", "mixed")


def diagnose_all(
    names: Sequence[str], cases: Path, answers: Path, results: Path, *, command: Sequence[str], jobs: int
) -> None:
    """Diagnose the cases without a result while the answers are sealed."""
    with sealed(answers):
        run_all(command, names, cases, results, jobs=jobs, what="diagnosed")


def parser() -> argparse.ArgumentParser:
    """The options of this command."""
    out = argparse.ArgumentParser(description="Diagnose sealed cases and score the results.")
    add_seed_options(out)
    out.add_argument(
        "--work", type=Path, default=None, metavar="DIR", help="default: build/blind, of another make with its name"
    )
    out.add_argument("--jobs", type=int, default=2)
    out.add_argument("--quick", action="store_true", help="no baselines and no oracle")
    out.add_argument(
        "--beside", type=int, default=BESIDE, metavar="N", help="baselines and oracle on the first N of each kind"
    )
    out.add_argument("--publish", action="store_true", help="write table and figure into docs/sealed_cases.md")
    return out


def work_folder(given: argparse.Namespace) -> Path:
    """Folder for cases and results; every make has its own."""
    return given.work or Path("build") / ("blind" if given.make == FIRST else f"blind-{given.make}")


def main(arguments: list[str] | None = None) -> int:
    options = parser()
    given = options.parse_args(arguments)
    if given.publish and given.make != FIRST:
        options.error(f"README.md shows the cases of the make {FIRST}: leave out --publish or --make {given.make}")
    start, work = time.perf_counter(), work_folder(given)
    cases, answers, results, baselines, oracle = (
        work / name for name in ("cases", "answers", "results", "baselines", "oracle")
    )
    batches = chosen_batches(given)
    drawn = [draw_many(seeds, kind, cases, answers, given.jobs, given.make) for kind, seeds in batches]
    names = list(dict.fromkeys(name for some in drawn for name in some))
    diagnose_all(names, cases, answers, results, command=default_command(), jobs=given.jobs)
    quick = given.quick or given.make in ALONE
    if not quick:
        first = [(kind, seeds[: given.beside]) for kind, seeds in batches]
        tried = [name for name in case_ids(first, given.make) if name in names]
        with sealed(answers):
            run_all(BASELINES, tried, cases, baselines, jobs=given.jobs, what="baselines")
        # From here on the answers are open: every diagnosis is finished.
        within = case_ids((b for b in first if b[0] in INSIDE), given.make)
        inside = [name for name in within if name in names]
        run_all(ORACLE, inside, cases, oracle, jobs=given.jobs, what="given the true cause", answers=answers)
    judged = load_pairs(answers, results, names, oracle=oracle)
    beside = None if quick else load_baselines(answers, baselines, names)
    out = work / "score"
    print(write_score(judged, out, beside))
    minutes = (time.perf_counter() - start) / 60.0
    print(f"{len(names)} cases in {minutes:.0f} minutes, written to {out}")
    if given.work is None and len(runs := finished(work.parent)) > 1:
        summary = work.parent / TABLE
        summary.write_text(worst_of_makes([scored(folder) for folder in runs]) + "\n")
        print(f"The figures of {len(runs)} makes and the worst of them: {summary}")
    if given.publish:
        publish(out, batches, Path(__file__).resolve().parents[2])
    return 0


if __name__ == "__main__":
    sys.exit(main())
