"""Count the instructions of a diagnosis: a cost that does not depend on other programs on the machine.

    python benchmarks/instructions.py                # one joint and three joints
    python benchmarks/instructions.py one-joint
    python benchmarks/instructions.py --folder DIR   # keep the recordings there for the next run

Valgrind's callgrind counts them, so it has to be installed (on Debian: ``apt-get install valgrind``); a run takes
about fifty times as long. The measured command is ``diagnose --quick`` with imports. Choices that depend on the
processor are fixed: OpenBLAS uses its kernels for Haswell, numba compiles for a generic processor, and hashes have one
seed. So one version of the code and its libraries gives the same number within a few tenths of a per cent.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.cost_goals import GOALS, words_for

ROWS = ("one-joint", "three-joints")
FIXED = {
    "NUMBA_CPU_NAME": "generic",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_CORETYPE": "Haswell",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONHASHSEED": "0",
}
COUNTED = re.compile(r"Collected : (\d+)")


def instructions(words: list[str], folder: Path) -> int:
    """Instructions of a command in a fresh process; its functions are compiled before.

    Args:
        words: Arguments of the Python interpreter.
        folder: Folder for compiled functions.

    Raises:
        RuntimeError: If callgrind counted nothing; the message has its output.
    """
    environment = {**os.environ, **FIXED, "NUMBA_CACHE_DIR": str(folder / "compiled")}
    environment.pop("OPENBLAS_L2_SIZE", None)
    command = [sys.executable, *words]
    subprocess.run(command, env=environment, check=True, capture_output=True)
    counter = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder / 'callgrind.out'}"]
    done = subprocess.run([*counter, *command], env=environment, capture_output=True, text=True, check=False)
    found = COUNTED.search(done.stderr)
    if done.returncode or found is None:
        raise RuntimeError(f"callgrind counted nothing: {done.stderr[-500:]}")
    return int(found.group(1))


def main() -> None:
    """Count the selected rows."""
    parser = argparse.ArgumentParser(description="How many instructions a diagnosis takes.")
    parser.add_argument("rows", nargs="*", metavar="NAME", help=f"of {', '.join(ROWS)} (default: both)")
    parser.add_argument("--folder", type=Path, help="where recordings and compiled functions are kept")
    given = parser.parse_args()
    if unknown := set(given.rows) - set(ROWS):
        parser.error(f"unknown rows {', '.join(sorted(unknown))}; there are {', '.join(ROWS)}")
    if shutil.which("valgrind") is None:
        parser.error("valgrind was not found: install it, on Debian with apt-get install valgrind")
    goals = {goal.name: goal for goal in GOALS}
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or Path(temporary)
        folder.mkdir(exist_ok=True)
        for name in given.rows or ROWS:
            count = instructions(words_for(goals[f"answer-{name}"], folder), folder)
            print(f"{name:<14} {count / 1e9:7.2f} thousand million instructions", flush=True)


if __name__ == "__main__":
    main()
