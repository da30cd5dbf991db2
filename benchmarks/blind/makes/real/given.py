"""Corrects a model with part one of a recording, and diagnoses part two without an added effect.

Both are results of the command line in a process of its own. They are kept in a folder whose name contains a hash of
the data and of the code, so that each is computed once.
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
    """Results of the diagnosis of part one.

    Attributes:
        corrected: Text of ``corrected.yaml``; empty if nothing was found.
        urdf: Text of ``corrected.urdf``, with the corrections that a URDF can hold; empty without this file.
        diagnosis: Content of ``diagnosis.json``.
    """

    corrected: str
    urdf: str
    diagnosis: dict

    @property
    def band(self) -> float:
        """End of the judged band [Hz]."""
        return float(self.diagnosis["band_hz"][1])


def log_text(run: Run, joints: Sequence[str]) -> str:
    """A log as CSV with twelve digits, more than a recording resolves."""
    header = ["t", *(f"q.{x}" for x in joints), *(f"tau.{x}" for x in joints)]
    rows = np.column_stack([run.t, run.q, run.tau])
    return "\n".join([",".join(header), *(",".join(f"{x:.12g}" for x in row) for row in rows), ""])


def log_names(count: int) -> tuple[str, ...]:
    """Names of the logs of a case."""
    return ("log.csv",) if count == 1 else tuple(f"log_{k:02d}.csv" for k in range(1, count + 1))


def write_inputs(folder: Path, source: Source, runs: Sequence[Run], corrected: str) -> list[str]:
    """Write model and logs into a folder; return the arguments of ``diagnose``."""
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
    """Hash of the code of the diagnosis."""
    out = hashlib.sha256()
    for package in ("phantom_dyn", "identification"):
        for path in sorted((CHECKOUT / package).rglob("*.py")):
            out.update(path.read_bytes())
    return out.digest()


def _key(source: Source, runs: Sequence[Run], corrected: str) -> str:
    """Name of the folder for the results of a diagnosis: a hash of the code, the model and the logs."""
    out = hashlib.sha256(_code() + source.urdf.encode() + source.yaml.encode() + corrected.encode())
    for run in runs:
        for values in (run.t, run.q, run.tau):
            out.update(np.ascontiguousarray(values, dtype=float).tobytes())
    return f"{source.name}-{out.hexdigest()[:16]}"


def _diagnosed(source: Source, runs: Sequence[Run], corrected: str, out: Sequence[str], keep: Sequence[str]) -> Path:
    """Folder with the kept files of a diagnosis, which runs only if the folder does not exist.

    Args:
        source: The recorded robot.
        runs: Its logs.
        corrected: Text of a ``corrected.yaml`` to diagnose with; empty for none.
        out: Options of the command that make it write files.
        keep: Paths of the files to keep.

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
    """The diagnosis of part one and the model that it corrects."""
    names = ("corrected.yaml", "corrected.urdf", "diagnosis.json")
    place = _diagnosed(source, one, "", ("--out", "report"), [f"report/{name}" for name in names])

    def text(name: str) -> str:
        return (place / name).read_text() if (place / name).is_file() else ""

    return PartOne(text("corrected.yaml"), text("corrected.urdf"), json.loads(text("diagnosis.json")))


def null_diagnosis(source: Source, first: PartOne, two: Sequence[Run]) -> dict:
    """The diagnosis of part two with the corrected model, without an added effect."""
    name = "diagnosis.json"
    return json.loads((_diagnosed(source, two, first.corrected, ("--json", name), (name,)) / name).read_text())
