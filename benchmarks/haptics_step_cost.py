"""Measure the processor time of one control step of simulated cheap hardware for each effect, and print a table.

As in Figure 10 of Brouwer and MacLean, Simulating Cheap Hardware, each degradation runs alone over 10 000 cycles of six
degrees of freedom, at a rate that varies between 500 and 2000 Hz. The paper has means on a Xeon of 2.0 GHz in a chart
without numbers; here are medians, which other programs on the machine hardly change.

    python benchmarks/haptics_step_cost.py
"""

from __future__ import annotations

import argparse
import datetime
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.speed_table import machine
from phantom_dyn.haptics.cheap.cheap_axis import CheapAxis, cheap_translation
from phantom_dyn.haptics.cheap.cheap_hardware import COLUMNS, AxisNumbers, at_rest, axis_numbers, run_axis, run_cycle

CYCLES, AXES, BATCH = 10_000, 6, 100
SLOWEST, FASTEST = 500.0, 2000.0  # lowest and highest rate [Hz]

ALL = cheap_translation(slip=1.0, order=600.0, limit=2.0)
EFFECTS = {
    "nothing": CheapAxis(),
    "saturation": CheapAxis(limit=2.0),
    "cogging": CheapAxis(cogging=ALL.cogging),
    "friction": CheapAxis(friction=ALL.friction),
    "inertia": CheapAxis(mass=ALL.mass),
    "inertia and backlash": CheapAxis(mass=ALL.mass, gap=ALL.gap),
    "all": ALL,
}


def motion(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time steps [s], positions [m] and commanded forces [N] of `CYCLES` cycles of `AXES` axes."""
    steps = rng.uniform(1 / FASTEST, 1 / SLOWEST, CYCLES)
    q = 0.01 * np.sin(np.outer(np.cumsum(steps), 3.0 + np.arange(AXES)))
    return steps, np.ascontiguousarray(q.T), rng.standard_normal((AXES, CYCLES))


def compiled_step(axis: CheapAxis, steps: np.ndarray, q: np.ndarray, asked: np.ndarray) -> float:
    """Median processor time [us] of one cycle of all axes in the compiled loop, over batches of 100 cycles."""
    numbers: AxisNumbers = axis_numbers(axis)
    states, out, times = [at_rest() for _ in range(AXES)], np.zeros((BATCH, COLUMNS)), []
    for first in range(0, CYCLES, BATCH):
        part = slice(first, first + BATCH)
        begin = time.thread_time_ns()
        for k in range(AXES):
            run_axis(numbers, states[k], steps[part], q[k, part], asked[k, part], out)
        times.append(time.thread_time_ns() - begin)
    return float(np.median(times)) / BATCH / 1e3


def python_step(axis: CheapAxis, steps: np.ndarray, q: np.ndarray, asked: np.ndarray) -> float:
    """Median processor time [us] of one cycle of all axes that are called one by one from Python, with checks."""
    states, times = [at_rest() for _ in range(AXES)], []
    for cycle in range(CYCLES // 10):
        begin = time.thread_time_ns()
        for k in range(AXES):
            states[k], _ = run_cycle(axis, states[k], float(steps[cycle]), float(q[k, cycle]), float(asked[k, cycle]))
        times.append(time.thread_time_ns() - begin)
    return float(np.median(times)) / 1e3


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    given = motion(np.random.default_rng(0))
    kinds: tuple[Callable[..., float], ...] = (compiled_step, python_step)
    rows = []
    for name, axis in EFFECTS.items():
        for kind in kinds:
            kind(axis, *given)  # run once to compile before measuring
        rows.append((name, *(kind(axis, *given) for kind in kinds)))
    print(f"Measured on {datetime.date.today().isoformat()} on {machine()}.\n")
    print("| effect | compiled loop [us] | one call a cycle from Python [us] |\n|---|---|---|")
    for name, inside, outside in rows:
        print(f"| {name} | {inside:.2f} | {outside:.0f} |")


if __name__ == "__main__":
    main()
