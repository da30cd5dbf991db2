"""Run each case in a process of its own, in a folder that contains only the case."""

from __future__ import annotations

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

from benchmarks.gapbench.cases import robot_and_log

TIMEOUT = 600.0
HIDDEN = ("PYTHONPATH", "PWD", "OLDPWD", "PHANTOM_DYN_DATA")  # the last names the real recordings
BESIDE = ("robot.yaml", "corrected.yaml")
HERE = Path(__file__).resolve().parent
BASELINES = (sys.executable, str(HERE / "baselines" / "answers.py"))
ORACLE = (sys.executable, str(HERE / "oracle.py"))


def default_command() -> list[str]:
    """The installed command beside this interpreter, or the first on the search path."""
    beside = Path(sys.executable).with_name("phantom-dyn")
    found = str(beside) if beside.is_file() else shutil.which("phantom-dyn")
    if found is None:
        raise SystemExit("The command phantom-dyn is not installed: run 'make setup' first.")
    return [found, "diagnose"]


def case_inputs(case: Path, found: tuple[str, str]) -> list[str]:
    """Names of the robot file and of every log in a case folder, in the order of the command line."""
    robot, log = found
    return [robot, *sorted(path.name for path in case.glob("log*") if path.suffix == Path(log).suffix)]


def run_case(command: Sequence[str], case: Path, results: Path, answer: Path | None = None) -> Path:
    """Run one case in a process of its own, on a copy of the case folder in a random folder.

    Args:
        command: Command, called with robot, logs, ``--with corrected.yaml`` if there is one, and ``--json FILE``.
        case: Folder of the case.
        results: Folder of the result file ``<id>.json``: the output of the command or its error, and the seconds of the
            whole process.
        answer: File that is copied as ``answer.json`` to the case; only for programs that run after the diagnoses.
    """
    result = results / f"{case.name}.json"
    with tempfile.TemporaryDirectory(prefix="case-") as place:
        found = robot_and_log(case)
        if found is None:
            raise FileNotFoundError(f"{case} lacks a robot file or a log: draw the case again.")
        inputs = case_inputs(case, found)
        for name in (*inputs, *(name for name in BESIDE if (case / name).is_file())):
            shutil.copy(case / name, Path(place) / name)
        known = ["--with", "corrected.yaml"] if (case / "corrected.yaml").is_file() else []
        if answer is not None:
            shutil.copy(answer, Path(place) / "answer.json")
        environment = {k: v for k, v in os.environ.items() if k not in HIDDEN}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        start = time.perf_counter()
        try:
            done = subprocess.run(
                [*command, *inputs, *known, "--json", "diagnosis.json"],
                cwd=place,
                env=environment,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                timeout=TIMEOUT,
            )
            code, message = done.returncode, done.stderr
        except subprocess.TimeoutExpired:
            code, message = -1, f"no result within {TIMEOUT:.0f} s"
        seconds = time.perf_counter() - start
        written = Path(place) / "diagnosis.json"
        diagnosis = json.loads(written.read_text()) if code == 0 and written.is_file() else None
    entry = {"id": case.name, "exit_code": code, "seconds": seconds, "said": message[-2000:], "diagnosis": diagnosis}
    part = result.with_suffix(".part")
    part.write_text(json.dumps(entry, indent=1) + "\n")
    part.replace(result)
    return result


def run_all(
    command: Sequence[str],
    names: Sequence[str],
    cases: Path,
    results: Path,
    *,
    jobs: int,
    what: str,
    answers: Path | None = None,
) -> None:
    """Run a command on the cases without a result; ``answers`` only for programs that may open them."""
    results.mkdir(parents=True, exist_ok=True)
    waiting = [name for name in names if not (results / f"{name}.json").is_file()]
    with ThreadPoolExecutor(jobs) as pool:
        running = [
            pool.submit(run_case, command, cases / name, results, answers / f"{name}.json" if answers else None)
            for name in waiting
        ]
        try:
            for count, one in enumerate(as_completed(running), start=1):
                one.result()
                print(f"\r{what}: {count} of {len(waiting)} cases", end="", file=sys.stderr, flush=True)
        except BaseException:
            for one in running:
                one.cancel()
            raise
    if waiting:
        print(file=sys.stderr)
