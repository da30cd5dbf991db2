"""Count how many deliberate mistakes in the code the tests notice: mutation testing on a random sample.

    make mutants                     # 150 mutants
    make mutants SAMPLE=0            # all of them
    make mutants SAMPLE=30 SEED=7 ONLY=judge/bounds

A mutant is one file with one operator, comparison, constant or keyword replaced (operators of cosmic-ray). It replaces
the file in a copy of the checkout, and the tests that cover the file run until one fails: the mutant is killed. Those
that survive are listed with their lines: a fact that no test states, or a change without effect. Annotations,
decorators, texts and replacements that always fail (a bit shift of floats) do not count as mutants.

The libraries are imported once. Each mutant is tested in a fork of that process, so it takes only seconds.
"""

from __future__ import annotations

import argparse
import importlib
import os
import resource
import shutil
import signal
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Sequence
from math import sqrt
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.mutant_sample import CHECKOUT, Area, Mutant, drawn

COPIED = ("phantom_dyn", "identification", "benchmarks", "tests", "urdf")
LIBRARIES = (
    "numpy scipy.signal scipy.stats scipy.optimize scipy.interpolate scipy.linalg pinocchio numba jaxtyping "
    "beartype.claw msgspec yaml xarray cvxpy control matplotlib.figure pytest hypothesis jinja2 rich.console"
).split()
# Limit of processor time for a mutant: this many times the tests' time without a mutant, plus some seconds. The time
# does not depend on other processes, and surviving mutants stay far below the limit.
PATIENCE, GRACE = 2.0, 10.0
OUTPUT = "output.txt"  # log of the last tests, in the copy


def wilson(share: int, whole: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's 95 % interval of a probability from a number of successes."""
    if whole == 0:
        return 0.0, 1.0
    p, scale = share / whole, 1.0 + z**2 / whole
    middle = (p + z**2 / (2 * whole)) / scale
    half = z * sqrt(p * (1 - p) / whole + z**2 / (4 * whole**2)) / scale
    return middle - half, middle + half


def covering(area: Area, path: str, tree: Path) -> list[str]:
    """Test files of an area: those named like the changed file first, those of no subfolder last.

    A file in a subfolder of `Area.apart` is covered by the tests of that subfolder and by those of no subfolder.
    """
    found = [file for place in area.tests for file in (tree / place).rglob("test_*.py")]
    found += [tree / place for place in area.tests if place.endswith(".py")]
    kind, words = Path(path).parent.name, Path(path).stem.split("_")
    tops = [(tree / place) for place in area.tests]
    if kind in area.apart:
        found = [file for file in found if file.parent.name == kind or file.parent in tops]

    def order(file: Path) -> tuple[int, bool, str]:
        return -sum(len(word) for word in words if word in file.stem), file.parent not in tops, str(file)

    return [str(file.relative_to(tree)) for file in sorted(found, key=order)]


def tested(area: Area, path: str, tree: Path, seconds: float, mutated: bool) -> tuple[str, float]:
    """Outcome of the tests in a fork (passed, failed or timed out) and their processor time [s]."""
    command = ["-x", "-q", "-n", "0", "-p", "no:cacheprovider", "-p", "no:warnings", "--hypothesis-seed=0"]
    command += ["-k", area.slow] if area.slow else []
    child = os.fork()
    if child == 0:
        code = 70
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 5))
            os.chdir(tree)
            with Path(OUTPUT).open("w") as file:
                os.dup2(file.fileno(), 1)
                os.dup2(file.fileno(), 2)
            sys.path[:0] = [str(tree)]
            sys.dont_write_bytecode = mutated
            importlib.import_module("numba").config.DISABLE_JIT = int(not area.compiled)
            code = int(importlib.import_module("pytest").main([*command, *covering(area, path, tree)]))
        finally:
            os._exit(code)
    _, status, usage = os.wait4(child, 0)
    took = usage.ru_utime + usage.ru_stime
    if os.WIFSIGNALED(status):
        late = os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL)
        return ("timed out" if late else "failed"), took
    return ("passed" if os.WEXITSTATUS(status) == 0 else "failed"), took


def needed(area: Area, tree: Path) -> float:
    """Processor time [s] of an area's tests without a mutant; these must pass."""
    outcome, seconds = tested(area, area.code, tree, 3600.0, mutated=False)
    if outcome != "passed":
        said = (tree / OUTPUT).read_text()[-2000:]
        raise SystemExit(f"{said}\nThe tests of {area.code} fail without any mutant: mend them first.")
    print(f"{area.code}: the tests take {seconds:.0f} s of processor time", flush=True)
    return seconds


def tried(mutant: Mutant, tree: Path, seconds: float) -> str:
    """Put a mutant into the copy, run its tests, and restore the file: killed, survived or timed out."""
    file = tree / mutant.place.path
    source, stat = file.read_bytes(), file.stat()
    file.write_text(mutant.code)
    try:
        outcome, _ = tested(mutant.place.area, mutant.place.path, tree, seconds, mutated=True)
    finally:
        file.write_bytes(source)
        os.utime(file, ns=(stat.st_atime_ns, stat.st_mtime_ns))
    return {"passed": "survived", "failed": "killed"}.get(outcome, outcome)


def table(outcomes: Iterable[tuple[Mutant, str]]) -> str:
    """Mutants killed, survived and timed out for each file, and the killed share with Wilson's interval."""
    counts: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0])
    for mutant, outcome in outcomes:
        for name in (mutant.place.path, "all"):
            counts[name][("killed", "survived", "timed out").index(outcome)] += 1
    lines = [f"{'file':62} {'killed':>7} {'survived':>9} {'timed out':>10}   noticed"]
    for name, (killed, survived, late) in sorted(counts.items(), key=lambda item: (item[0] == "all", item[0])):
        noticed, whole = killed + late, killed + survived + late
        low, high = wilson(noticed, whole)
        share = f"{noticed / whole:4.0%} ({low:.0%} to {high:.0%})"
        lines.append(f"{name:62} {killed:7} {survived:9} {late:10}   {share}")
    return "\n".join(lines)


def run(sample: int, seed: int, only: str) -> list[tuple[Mutant, str]]:
    """Draw mutants and try each of them; print those that survive with their change."""
    chosen = drawn(sample, seed, only)
    for name in LIBRARIES:
        importlib.import_module(name)
    out = []
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        shutil.copy(CHECKOUT / "pyproject.toml", tree)
        for name in COPIED:
            shutil.copytree(CHECKOUT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
        areas = sorted({mutant.place.area for mutant in chosen}, key=lambda area: area.code)
        limits = {area: PATIENCE * needed(area, tree) + GRACE for area in areas}
        for number, mutant in enumerate(chosen, start=1):
            outcome = tried(mutant, tree, limits[mutant.place.area])
            out.append((mutant, outcome))
            print(f"[{number}] {outcome}: {mutant.place.path}:{mutant.place.line}", flush=True)
            if outcome != "killed":
                print(f"    - {mutant.before}\n    + {mutant.after}", flush=True)
        for area in areas:  # otherwise a damaged copy would count as a killed mutant
            needed(area, tree)
    return out


def main(words: Sequence[str] | None = None) -> None:
    """Read the command line, try the mutants, and print the table."""
    parser = argparse.ArgumentParser(description="Share of mutants that the tests notice.")
    parser.add_argument("--sample", type=int, default=150, help="how many mutants; 0 is all of them (default: 150)")
    parser.add_argument("--seed", type=int, default=1, help="of the sample (default: 1)")
    parser.add_argument("--only", default="", help="files with this in their path")
    given = parser.parse_args(words)
    print(table(run(given.sample, given.seed, given.only)))


if __name__ == "__main__":
    main()
