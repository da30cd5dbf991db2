# pyright: reportAttributeAccessIssue=false
"""Compare the compiled core with its goals: regressor, refit from the triangular factors, a million samples.

python benchmarks/core_speed.py    # prints the table, exits with 1 where a target is missed
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import pinocchio_loops
from benchmarks.comparison import Row, missed, more_than, own, several_sines, table
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import rigid_body_regressor

ROBOT, SAMPLES = "example:ur10", 15_000
FASTER, WRITING = 5.0, 4.0
REFIT_MS, MEMORY_MB = 5.0, 500.0
COUNTS = (100_000, 500_000, 1_000_000)
LINEAR = 1.3
"""A million samples may take this many times ten times the seconds of 100 000, to allow for the machine."""


def least(calls: tuple[Callable[[], object], ...], repeats: int) -> list[float]:
    """Shortest time [s] of each call; the calls alternate, so that changes of the machine's load affect all."""
    times = np.empty((repeats, len(calls)))
    for once in times:
        for k, call in enumerate(calls):
            start = time.process_time()
            call()
            once[k] = time.process_time() - start
    return times.min(axis=0).tolist()


def _written() -> np.ndarray:
    out = np.empty((SAMPLES, 6, 60))
    out[...] = 1.0
    return out


def regressor_rows(repeats: int = 20) -> list[Row]:
    """Compare the regressor with a Python loop over Pinocchio, and with writing the same array."""
    robot = load_robot(ROBOT)
    motion = several_sines(robot.nv, SAMPLES, 500.0, np.random.default_rng(0))
    rigid_body_regressor(robot, motion)  # compile, or load from disk
    ours, loop, writing = least(
        (
            lambda: rigid_body_regressor(robot, motion),
            lambda: pinocchio_loops.regressor(robot.model, motion.q, motion.v, motion.a),
            _written,
        ),
        repeats,
    )
    each = [f"{1e6 * seconds / SAMPLES:.2f} us" for seconds in (ours, loop, writing)]
    work = "UR10, regressor of one sample"
    times = ours / writing
    return [
        Row(f"{work}, against a Python loop over Pinocchio", each[1], each[0], *more_than(loop / ours, FASTER)),
        Row(
            f"{work}, against writing it",
            each[2],
            each[0],
            f"{times:.1f} times writing",
            f"at most {WRITING:g}",
            times <= WRITING,
        ),
    ]


def million_rows(counts: tuple[int, ...] = COUNTS, repeats: int = 2) -> list[Row]:
    """Time, memory and refit for many samples, each count in a process of its own; the shorter time of two runs."""
    runs = [[own("own_worker.py", "stream", ROBOT, count) for _ in range(repeats)] for count in counts]
    seconds = [min(run["seconds"] for run in several) for several in runs]
    refit = min(run["refit"] for several in runs for run in several) * 1e3
    peak = max(run["peak_mb"] for run in runs[-1])
    growth = seconds[-1] / seconds[0] / (counts[-1] / counts[0])
    words = ", ".join(f"{count // 1000} k in {s:.2f} s" for count, s in zip(counts, seconds, strict=True))
    many = f"UR10, {counts[-1]} samples in recordings of 50 000 read one by one"
    return [
        Row("UR10, refit from the triangular factors", "", f"{refit:.1f} ms", "", "under 5 ms", refit < REFIT_MS),
        Row(
            f"{many}: time",
            "",
            words,
            f"{growth:.2f} of the time of as many times {counts[0] // 1000} k",
            f"linear (at most {LINEAR:g})",
            growth <= LINEAR,
        ),
        Row(f"{many}: peak of the process", "", f"{peak:.0f} MB", "", "under 500 MB", peak < MEMORY_MB),
    ]


def core_rows() -> list[Row]:
    """All rows."""
    return regressor_rows() + million_rows()


def main() -> int:
    """Print the table; return 1 if a goal is missed."""
    rows = core_rows()
    print(table(rows))
    return missed(rows)


if __name__ == "__main__":
    sys.exit(main())
