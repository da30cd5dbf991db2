"""Measure the share of a command's time that each stage takes, next to the share that the progress line assumes.

    python benchmarks/stage_shares.py            # identify, excite, map and diagnose, on small examples
    python benchmarks/stage_shares.py excite map

Each command runs in a fresh process, after a run that compiles.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from itertools import pairwise
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.diagnosis_cost import fresh_process
from benchmarks.first_run import words_for
from identification.stages import Announcement, Stage
from identification.words.stage_words import NAMES

GRID = "x=0:0:1,y=-0.2:0.3:51,z=-0.2:0.2:41"


def commands(folder: Path) -> dict[str, list[str]]:
    """Arguments of each command; its files are written into the folder."""
    diagnose = words_for(1, folder)
    robot, log = diagnose[1], diagnose[2]
    return {
        "diagnose": diagnose,
        "identify": ["identify", robot, log, "--out", str(folder / "identified")],
        "excite": ["excite", robot, "--duration", "6", "--out", str(folder / "ref.csv")],
        "map": ["map", "phantom_1_5", "--quantity", "apparent_mass", "--grid", GRID, "--out", str(folder / "maps")],
    }


def watched(words: list[str]) -> None:
    """Run a command and print the time of each stage of each part."""
    from identification.cli.main import main as run
    from identification.cli.terminal.progress import Progress

    parts: list[tuple[Mapping[Stage, float], list[tuple[float, Stage | None]]]] = []

    def noted(function: Callable[..., object]) -> Callable[..., object]:
        def called(self: Progress, *given: object) -> object:
            if function.__name__ == "__enter__":
                parts.append((self._stages, []))
            stage = given[0].stage if given and isinstance(given[0], Announcement) else None
            parts[-1][1].append((time.perf_counter(), stage))
            return function(self, *given)

        return called

    for name in ("__enter__", "__exit__", "_take"):
        setattr(Progress, name, noted(getattr(Progress, name)))
    with redirect_stdout(sys.stderr):
        run(words)
    for stages, marks in parts:
        print(f"{words[0]}, {marks[-1][0] - marks[0][0]:.1f} s")
        for stage, taken in shares(stages, marks).items():
            print(f"  {taken:5.1f} %  counted as {stages[stage]:4.1f} %  {NAMES[stage]}")


def shares(stages: Mapping[Stage, float], marks: list[tuple[float, Stage | None]]) -> dict[Stage, float]:
    """Share of the time [%] of each stage; an announcement without a stage belongs to the last stage."""
    order, at, whole = list(stages), 0, marks[-1][0] - marks[0][0]
    out = dict.fromkeys(order, 0.0)
    for (begun, announced), (ended, _) in pairwise(marks):
        at = max(at, order.index(announced) if announced in order else 0)
        out[order[at]] += 100.0 * (ended - begun) / whole
    return out


def main() -> None:
    """Measure the selected commands."""
    parser = argparse.ArgumentParser(description="What part of its time each stage of a command takes.")
    parser.add_argument("commands", nargs="*", help="diagnose, identify, excite, map (default: all)")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        for command, words in commands(Path(name)).items():
            if not given.commands or command in given.commands:
                fresh_process(["-m", "identification.cli", *words])
                script = "import sys; from benchmarks.stage_shares import watched; watched(sys.argv[1:])"
                checkout = Path(__file__).resolve().parents[1]
                subprocess.run([sys.executable, "-c", script, *words], check=True, cwd=checkout)


if __name__ == "__main__":
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    main()
