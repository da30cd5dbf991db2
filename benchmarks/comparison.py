"""What the comparisons share: rows of a table, environments of their own, workers in processes of their own."""

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
    """One line of the table; ``reached`` is None where nothing was asked for."""

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
    """An environment could not be made; the message is one sentence."""


def table(rows: Sequence[Row]) -> str:
    """The rows as Markdown, columns aligned so that it reads well in a terminal too."""
    cells = [HEAD, *(row.cells for row in rows)]
    widths = [max(3, *(len(line[k]) for line in cells)) for k in range(len(HEAD))]
    lines = [f"| {' | '.join(word.ljust(w) for word, w in zip(line, widths, strict=True))} |" for line in cells]
    return "\n".join([lines[0], f"| {' | '.join('-' * w for w in widths)} |", *lines[1:]])


def missed(rows: Sequence[Row]) -> int:
    """Exit code: 1 where a row missed what was wanted."""
    return int(any(row.reached is False for row in rows))


def more_than(ratio: float, wanted: float) -> tuple[str, str, bool]:
    """Last three cells of a row whose ratio is to be at least ``wanted``."""
    return f"{ratio:.1f} times faster", f"at least {wanted:g} times", ratio >= wanted


def less_than(share: float, wanted: float, words: str) -> tuple[str, str, bool]:
    """Last three cells of a row whose share of theirs is to be at most ``wanted``."""
    return f"{share:.2f} of theirs", words, share <= wanted


def cache_folder() -> Path:
    """Where environments are kept between runs."""
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "phantom-dyn" / "benchmarks"


def environment(name: str, requirement: str, module: str) -> Path:
    """Python of an environment that holds one other tool; made at the first call.

    Args:
        name: Of its folder.
        requirement: What pip is asked for.
        module: That has to be importable in the end.

    Raises:
        NotInstalled: If it cannot be made.
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
    """What a script of this folder prints last, as JSON, in a process of its own with one thread of linear algebra.

    Args:
        python: Of the environment.
        script: File beside this one.
        words: Its arguments.
        checkout: Folder that its imports may come from.

    Raises:
        RuntimeError: If it fails, with the end of what it said.
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
    """`worker` in this environment, from this checkout."""
    return worker(sys.executable, script, *words, checkout=Path(__file__).resolve().parents[1])


def several_sines(joints: int, samples: int, rate_hz: float, rng: np.random.Generator) -> Motion:
    """Five sines a joint between 0.1 and 1.5 Hz, about a radian in all, with their exact derivatives."""
    t = np.arange(samples) / rate_hz
    q, v, a = (np.zeros((samples, joints)) for _ in range(3))
    for joint in range(joints):
        for hz, size, phase in zip(*rng.uniform([0.1, 0.1, 0.0], [1.5, 0.4, 6.3], (5, 3)).T, strict=True):
            w = 2 * np.pi * hz
            q[:, joint] += size * np.sin(w * t + phase)
            v[:, joint] += size * w * np.cos(w * t + phase)
            a[:, joint] -= size * w**2 * np.sin(w * t + phase)
    return Motion(t, q, v, a)
