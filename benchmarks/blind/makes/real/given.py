"""What part one of a recording gives: the corrected model, and what a diagnosis says of part two with nothing added.

Both are asked of the command line, in a process of its own, and kept in a folder whose name stands for the data and for
the code that was asked.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.blind.makes.real.recordings import CHECKOUT, Run, Source

KEPT = CHECKOUT / "build" / "blind-real" / "part_one"
COMMAND = (sys.executable, "-m", "identification.cli", "diagnose")


@dataclass(frozen=True)
class Given:
    """The model for part two, and what is said of part two while nothing has been added.

    Attributes:
        corrected: ``corrected.yaml`` of part one; empty where nothing was found in it.
        corrected_urdf: As much of it as a URDF can say; empty where there is none.
        part_one: Its ``diagnosis.json``.
        null: That of part two, with the corrected model.
    """

    corrected: str
    corrected_urdf: str
    part_one: dict
    null: dict


def log_text(run: Run, joints: Sequence[str]) -> str:
    """A log as CSV, with what is needed to write it again to the last bit that a recording has."""
    header = ["t", *(f"q.{x}" for x in joints), *(f"tau.{x}" for x in joints)]
    rows = np.column_stack([run.t, run.q, run.tau])
    return "\n".join([",".join(header), *(",".join(f"{x:.12g}" for x in row) for row in rows), ""])


def log_names(count: int) -> tuple[str, ...]:
    """Names of the logs of a case."""
    return ("log.csv",) if count == 1 else tuple(f"log_{k:02d}.csv" for k in range(1, count + 1))


def write_inputs(folder: Path, source: Source, runs: Sequence[Run], corrected: str) -> list[str]:
    """Writes model and logs into a folder; returns the words that follow ``diagnose``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "robot.urdf").write_text(source.urdf)
    if source.yaml:
        (folder / "robot.yaml").write_text(source.yaml)
    names = log_names(len(runs))
    for name, run in zip(names, runs, strict=True):
        (folder / name).write_text(log_text(run, source.joints))
    if corrected:
        (folder / "corrected.yaml").write_text(corrected)
    return ["robot.urdf", *names, *(("--with", "corrected.yaml") if corrected else ())]


@cache
def _code() -> bytes:
    """Stands for the code that diagnoses."""
    out = hashlib.sha256()
    for package in ("phantom_dyn", "identification"):
        for path in sorted((CHECKOUT / package).rglob("*.py")):
            out.update(path.read_bytes())
    return out.digest()


def _key(source: Source, one: Sequence[Run], two: Sequence[Run]) -> str:
    out = hashlib.sha256(_code() + source.urdf.encode() + source.yaml.encode())
    for part in (one, two):
        out.update(f"{len(part)}".encode())
        for run in part:
            for values in (run.t, run.q, run.tau):
                out.update(np.ascontiguousarray(values, dtype=float).tobytes())
    return f"{source.name}-{out.hexdigest()[:16]}"


def _said(folder: Path, words: Sequence[str], *out: str) -> None:
    environment = {**os.environ, "PYTHONPATH": str(CHECKOUT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [*COMMAND, *words, *out], cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True
    )
    if done.returncode:
        raise ValueError(f"The diagnosis of a part of a recording was refused: {done.stderr.strip()[-500:]}")


def given(source: Source, one: Sequence[Run], two: Sequence[Run]) -> Given:
    """The model corrected by part one, and the diagnosis of part two with it; taken from the folder if it is there.

    Raises:
        ValueError: If the command refuses one of the parts.
    """
    place = KEPT / _key(source, one, two)
    if not place.is_dir():
        KEPT.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=KEPT, prefix=".part-") as work:
            first, second, done = (Path(work) / x for x in ("one", "two", "done"))
            _said(first, write_inputs(first, source, one, ""), "--out", "report")
            done.mkdir()
            for name in ("corrected.yaml", "corrected.urdf", "diagnosis.json"):
                if (first / "report" / name).is_file():
                    shutil.copy(first / "report" / name, done / name)
            corrected = done / "corrected.yaml"
            words = write_inputs(second, source, two, corrected.read_text() if corrected.is_file() else "")
            _said(second, words, "--json", str((done / "null.json").resolve()))
            try:
                done.rename(place)
            except OSError:  # another process was faster
                if not place.is_dir():
                    raise

    def text(name: str) -> str:
        return (place / name).read_text() if (place / name).is_file() else ""

    part_one, null = (json.loads(text(name)) for name in ("diagnosis.json", "null.json"))
    return Given(text("corrected.yaml"), text("corrected.urdf"), part_one, null)
