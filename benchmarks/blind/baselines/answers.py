"""Runs every baseline on one case: ``python answers.py robot.urdf log.csv --json FILE``.

The script is called like the diagnosis, in a folder that contains only the case.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from benchmarks.blind.baselines.always_coulomb import always_coulomb
from benchmarks.blind.baselines.independent_bic import independent_bic
from benchmarks.blind.baselines.least_squares import prepare
from benchmarks.gapbench.baselines.mujoco_sysid import mujoco_sysid


def timed(say: Callable[[], dict], before: float = 0.0) -> dict:
    """An answer and the seconds that it took; after an error, the error message is kept instead."""
    start = time.perf_counter()
    try:
        with contextlib.redirect_stdout(sys.stderr):  # the toolbox prints every iteration
            said = say()
    except Exception as error:  # an error in one baseline must not stop the others
        said = {"verdict": "failed", "findings": [], "joints": [], "said": f"{type(error).__name__}: {error}"}
    return {**said, "seconds": before + time.perf_counter() - start}


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Say what every baseline says of one case.")
    parser.add_argument("robot", type=Path)
    parser.add_argument("log", type=Path)
    parser.add_argument("--json", type=Path, required=True, metavar="FILE")
    parser.add_argument("--without", action="append", default=[], metavar="NAME", help="leave this baseline out")
    given = parser.parse_args(arguments)
    start = time.perf_counter()
    task = prepare(given.robot, given.log)
    reading = time.perf_counter() - start
    out = {
        "always_coulomb": timed(lambda: always_coulomb(task), reading),
        "independent_bic": timed(lambda: independent_bic(task), reading),
    }
    if "mujoco_sysid" not in given.without:
        out["mujoco_sysid"] = timed(lambda: mujoco_sysid(given.robot, given.log))
    given.json.write_text(json.dumps(out, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
