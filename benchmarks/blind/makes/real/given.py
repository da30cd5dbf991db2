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
class PartOne:
    """What part one says of the robot.

    Attributes:
        corrected: ``corrected.yaml``; empty where nothing was found.
        urdf: As much of it as a URDF can say; empty where there is none.
        diagnosis: ``diagnosis.json``.
    """

    corrected: str
    urdf: str
    diagnosis: dict

    @property
    def band(self) -> float:
        """End of the judged band [Hz]."""
        return float(self.diagnosis["band_hz"][1])


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


def _key(source: Source, runs: Sequence[Run], corrected: str) -> str:
    out = hashlib.sha256(_code() + source.urdf.encode() + source.yaml.encode() + corrected.encode())
    for run in runs:
        for values in (run.t, run.q, run.tau):
            out.update(np.ascontiguousarray(values, dtype=float).tobytes())
    return f"{source.name}-{out.hexdigest()[:16]}"


def _said(source: Source, runs: Sequence[Run], corrected: str, out: Sequence[str], keep: Sequence[str]) -> Path:
    """Folder with the files of a diagnosis that are to be kept, as many as ``out`` had it write.

    Raises:
        ValueError: If the command refuses the recording.
    """
    place = KEPT / _key(source, runs, corrected)
    if place.is_dir():
        return place
    KEPT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=KEPT, prefix=".part-") as work:
        folder, done = Path(work) / "asked", Path(work) / "done"
        words = write_inputs(folder, source, runs, corrected)
        environment = {
            **os.environ,
            "PYTHONPATH": str(CHECKOUT),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }
        ran = subprocess.run(
            [*COMMAND, *words, *out],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
        )
        if ran.returncode:
            raise ValueError(f"The diagnosis of a part of {source.name} was refused: {ran.stderr.strip()[-500:]}")
        done.mkdir()
        for name in keep:
            if (folder / name).is_file():
                shutil.copy(folder / name, done / Path(name).name)
        try:
            done.rename(place)
        except OSError:  # another process was faster
            if not place.is_dir():
                raise
    return place


def corrected_by(source: Source, one: Sequence[Run]) -> PartOne:
    """The model corrected by part one; taken from the folder if it is there."""
    names = ("corrected.yaml", "corrected.urdf", "diagnosis.json")
    place = _said(source, one, "", ("--out", "report"), [f"report/{name}" for name in names])

    def text(name: str) -> str:
        return (place / name).read_text() if (place / name).is_file() else ""

    return PartOne(text("corrected.yaml"), text("corrected.urdf"), json.loads(text("diagnosis.json")))


def null_diagnosis(source: Source, first: PartOne, two: Sequence[Run]) -> dict:
    """What is said of part two with the corrected model while nothing has been added."""
    name = "diagnosis.json"
    return json.loads((_said(source, two, first.corrected, ("--json", name), (name,)) / name).read_text())
