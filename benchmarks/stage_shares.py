"""What part of a command's time each of its stages takes, beside the part that the line of progress counts it as.

    python benchmarks/stage_shares.py            # identify, excite, map and diagnose, on small examples
    python benchmarks/stage_shares.py excite map

Each command runs in a fresh process, behind one run that compiles. Besides the stages it says how far what is shown is
from the time that has passed, at every announcement: root mean square and most, in points.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from contextlib import redirect_stdout
from itertools import pairwise
from pathlib import Path

import numpy as np

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.diagnosis_cost import fresh_process
from benchmarks.first_run import words_for
from identification.cli.terminal.percentage import Percentage, Share
from identification.stages import Announcement, Stage
from identification.words.stage_words import NAMES

GRID = "x=0:0:1,y=-0.2:0.3:51,z=-0.2:0.2:41"


def commands(folder: Path) -> dict[str, list[str]]:
    """Words of each command, whose files are written into the folder."""
    diagnose = words_for(1, folder)
    robot, log = diagnose[1], diagnose[2]
    return {
        "diagnose": diagnose,
        "identify": ["identify", robot, log, "--out", str(folder / "identified")],
        "excite": ["excite", robot, "--duration", "6", "--out", str(folder / "ref.csv")],
        "map": ["map", "phantom_1_5", "--quantity", "apparent_mass", "--grid", GRID, "--out", str(folder / "maps")],
    }


def watched(words: list[str]) -> None:
    """Run a command and print what each stage took, and how far what was shown was from the time that had passed."""
    from identification.cli.main import main as run
    from identification.cli.terminal import progress

    marks: list[tuple[float, Stage | None, float]] = []
    stages: tuple[Share, ...] = ()

    class Watched(Percentage):
        def __init__(self, given: tuple[Share, ...]) -> None:
            nonlocal stages
            stages = given
            super().__init__(given)

        def enter(self, announced: Announcement) -> None:
            marks.append((time.perf_counter(), announced.stage, self.now()))
            super().enter(announced)

        def end(self) -> None:
            marks.append((time.perf_counter(), None, 100.0))
            super().end()

    progress.Percentage = Watched
    with redirect_stdout(sys.stderr):
        run(words)
    print(f"{words[0]}, {marks[-1][0] - marks[0][0]:.1f} s")
    for share, taken in shares(stages, marks).items():
        print(f"  {taken:5.1f} %  counted as {share.percent:4.1f} %  {NAMES[share.stage]}")
    at, shown = np.array([mark[0] for mark in marks]), np.array([mark[2] for mark in marks])
    beside = np.abs(shown - 100.0 * (at - at[0]) / (at[-1] - at[0]))
    print(f"  shown beside passed: {np.sqrt(np.mean(beside**2)):.0f} points, at most {beside.max():.0f}")


def shares(stages: tuple[Share, ...], marks: list[tuple[float, Stage | None, float]]) -> dict[Share, float]:
    """Part of the time [%] that each stage took: an announcement of none or an earlier one is of the last."""
    out = dict.fromkeys(stages, 0.0)
    at, whole = 0, marks[-1][0] - marks[0][0]
    for (begun, announced, _), (ended, _, _) in pairwise(marks):
        at = max(at, next((k for k, share in enumerate(stages) if share.stage is announced), 0))
        out[stages[at]] += 100.0 * (ended - begun) / whole
    return out


def main() -> None:
    """Measure the commands that are named."""
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
