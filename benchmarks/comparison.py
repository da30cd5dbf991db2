"""Parts that the comparisons share: table rows, environments of other tools, and workers in processes of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import venv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phantom_dyn.motion import Motion

HEAD = ("work", "theirs", "ours", "ratio", "wanted", "")
_INSTALL_SECONDS, _RUN_SECONDS = 900, 900


@dataclass(frozen=True)
class Row:
    """One row of the table; ``reached`` is None without a goal."""

    work: str
    theirs: str
    ours: str
    ratio: str
    wanted: str = ""
    reached: bool | None = None

    @property
    def cells(self) -> tuple[str, ...]:
        word = {True: "reached", False: "missed", None: ""}[self.reached]
        return self.work, self.theirs, self.ours, self.ratio, self.wanted, word


class NotInstalled(RuntimeError):
    """An environment could not be created; the message is one sentence."""


def table(rows: Sequence[Row]) -> str:
    """The rows as a Markdown table with aligned columns."""
    cells = [HEAD, *(row.cells for row in rows)]
    widths = [max(3, *(len(line[k]) for line in cells)) for k in range(len(HEAD))]
    lines = [f"| {' | '.join(word.ljust(w) for word, w in zip(line, widths, strict=True))} |" for line in cells]
    return "\n".join([lines[0], f"| {' | '.join('-' * w for w in widths)} |", *lines[1:]])


def missed(rows: Sequence[Row]) -> int:
    """Exit code: 1 if a row missed its goal."""
    return int(any(row.reached is False for row in rows))


def more_than(ratio: float, wanted: float) -> tuple[str, str, bool]:
    """Last three cells of a row whose ratio should be at least ``wanted``."""
    return f"{ratio:.1f} times faster", f"at least {wanted:g} times", ratio >= wanted


def less_than(share: float, wanted: float, words: str) -> tuple[str, str, bool]:
    """Last three cells of a row whose share of the other tool's value should be at most ``wanted``."""
    return f"{share:.2f} of theirs", words, share <= wanted


def cache_folder() -> Path:
    """Folder in which environments are kept between runs."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "phantom-dyn" / "benchmarks"


def environment(name: str, requirement: str, module: str) -> Path:
    """Python interpreter of an environment with one other tool; the first call creates it.

    Args:
        name: Name of the folder.
        requirement: Requirement for pip.
        module: Module that must be importable afterwards.

    Raises:
        NotInstalled: If the environment cannot be created.
    """
    folder = cache_folder() / name
    python = folder / "bin" / "python"
    if python.exists() and _imports(python, module):
        return python
    sys.stderr.write(f"Installing {requirement} into an environment of its own (first call only)\n")
    try:
        venv.create(folder, with_pip=True, clear=True)
        words = [str(python), "-m", "pip", "install", "-qq", "--disable-pip-version-check", requirement]
        subprocess.run(words, check=True, capture_output=True, timeout=_INSTALL_SECONDS)
    except (OSError, subprocess.SubprocessError) as error:
        raise NotInstalled(
            f"{requirement} could not be installed ({type(error).__name__}): the comparison with it is left out."
        ) from error
    if not _imports(python, module):
        raise NotInstalled(f"{requirement} was installed but {module} cannot be imported: its comparison is left out.")
    return python


def _imports(python: Path, module: str) -> bool:
    words = [str(python), "-c", f"import {module}"]
    return subprocess.run(words, capture_output=True, timeout=_RUN_SECONDS).returncode == 0


def worker(python: Path | str, script: str, *words: object, checkout: Path | None = None) -> dict[str, Any]:
    """Run a script of this folder in a process with one thread for linear algebra; return the last JSON that it prints.

    Args:
        python: Python interpreter.
        script: File in this folder.
        words: Arguments of the script.
        checkout: Folder for its imports, or None.

    Raises:
        RuntimeError: If it fails; the message has the end of its output.
    """
    threads = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
    given = {**os.environ, **threads, "MPLBACKEND": "Agg"}
    given.pop("PYTHONPATH", None)
    if checkout is not None:
        given["PYTHONPATH"] = str(checkout)
    path = Path(__file__).with_name(script)
    done = subprocess.run(
        [str(python), str(path), *map(str, words)], capture_output=True, text=True, timeout=_RUN_SECONDS, env=given
    )
    if done.returncode:
        raise RuntimeError(f"{script} ended with exit code {done.returncode}:\n{done.stderr[-2000:]}")
    return json.loads(done.stdout.splitlines()[-1])


def own(script: str, *words: object) -> dict[str, Any]:
    """Run `worker` in this environment with this checkout."""
    return worker(sys.executable, script, *words, checkout=Path(__file__).resolve().parents[1])


def several_sines(joints: int, samples: int, rate_hz: float, rng: np.random.Generator) -> Motion:
    """Five sines for each joint between 0.1 and 1.5 Hz, about a radian in all, with exact derivatives."""
    t = np.arange(samples) / rate_hz
    q, v, a = (np.zeros((samples, joints)) for _ in range(3))
    for joint in range(joints):
        for hz, size, phase in zip(*rng.uniform([0.1, 0.1, 0.0], [1.5, 0.4, 6.3], (5, 3)).T, strict=True):
            w = 2 * np.pi * hz
            q[:, joint] += size * np.sin(w * t + phase)
            v[:, joint] += size * w * np.cos(w * t + phase)
            a[:, joint] -= size * w**2 * np.sin(w * t + phase)
    return Motion(t, q, v, a)
