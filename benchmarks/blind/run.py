"""Diagnoses sealed cases through the command line, while no answer can be read, and scores the results.

Example: ``python benchmarks/blind/run.py --seeds 1000:1200 --kind single``. Without arguments: the reporting seeds.
Resumable: a case that has its result is not diagnosed again.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.blind.generate import FILES, KINDS, draw_many, seed_range
from benchmarks.blind.score import load_pairs, write_score
from benchmarks.blind.seal import sealed

TIMEOUT = 600.0
REPORTING = (("single", range(1000, 1120)), ("null", range(2000, 2120)))
HIDDEN = ("PYTHONPATH", "PWD", "OLDPWD")


def default_command() -> list[str]:
    """The installed command beside this interpreter, else the one on the search path."""
    beside = Path(sys.executable).with_name("phantom-dyn")
    found = str(beside) if beside.is_file() else shutil.which("phantom-dyn")
    if found is None:
        raise SystemExit("The command phantom-dyn is not installed: run 'make setup' first.")
    return [found, "diagnose"]


def diagnose(command: Sequence[str], case: Path, results: Path) -> Path:
    """One case in its own process: it gets a copy of the case folder at a random place, and nothing else.

    Returns the result file, ``<id>.json``: the diagnosis, or what went wrong, with the seconds of the whole process.
    """
    result = results / f"{case.name}.json"
    with tempfile.TemporaryDirectory(prefix="case-") as place:
        for name in FILES:
            shutil.copy(case / name, Path(place) / name)
        environment = {k: v for k, v in os.environ.items() if k not in HIDDEN}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        start = time.perf_counter()
        try:
            done = subprocess.run(
                [*command, "robot.urdf", "log.csv", "--json", "diagnosis.json"],
                cwd=place,
                env=environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                timeout=TIMEOUT,
            )
            code, said = done.returncode, done.stderr
        except subprocess.TimeoutExpired:
            code, said = -1, f"no result within {TIMEOUT:.0f} s"
        seconds = time.perf_counter() - start
        written = Path(place) / "diagnosis.json"
        diagnosis = json.loads(written.read_text()) if code == 0 and written.is_file() else None
    entry = {"id": case.name, "exit_code": code, "seconds": seconds, "said": said[-2000:], "diagnosis": diagnosis}
    part = result.with_suffix(".part")
    part.write_text(json.dumps(entry, indent=1) + "\n")
    part.replace(result)
    return result


def diagnose_all(
    names: Sequence[str], cases: Path, answers: Path, results: Path, *, command: Sequence[str], jobs: int
) -> None:
    """Diagnoses the cases that have no result yet, the answers sealed all the while."""
    results.mkdir(parents=True, exist_ok=True)
    waiting = [name for name in names if not (results / f"{name}.json").is_file()]
    with sealed(answers), ThreadPoolExecutor(jobs) as pool:
        running = [pool.submit(diagnose, command, cases / name, results) for name in waiting]
        try:
            for count, one in enumerate(as_completed(running), start=1):
                one.result()
                print(f"\r{count} of {len(waiting)} cases diagnosed", end="", file=sys.stderr, flush=True)
        except BaseException:
            for one in running:
                one.cancel()
            raise
    if waiting:
        print(file=sys.stderr)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Diagnose sealed cases and score the results.")
    parser.add_argument("--seeds", type=seed_range, metavar="FIRST:END", help="default: the reporting seeds")
    parser.add_argument("--kind", choices=KINDS, default="mixed", help="only with --seeds")
    parser.add_argument("--work", type=Path, default=Path("build/blind"), metavar="DIR")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args(arguments)
    cases, answers, results = (given.work / name for name in ("cases", "answers", "results"))
    batches = REPORTING if given.seeds is None else ((given.kind, given.seeds),)
    names = [name for kind, seeds in batches for name in draw_many(seeds, kind, cases, answers, given.jobs)]
    diagnose_all(names, cases, answers, results, command=default_command(), jobs=given.jobs)
    print(write_score(load_pairs(answers, results, names), given.work / "score"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
