"""How many deliberate mistakes in the code the tests notice: mutation testing on a random sample.

    make mutants                     # 150 mutants
    make mutants SAMPLE=0            # all of them
    make mutants SAMPLE=30 SEED=7 ONLY=judge/bounds

A mutant is one file with one operator, comparison, constant or keyword replaced (operators of cosmic-ray). It is put
into a copy of the checkout and the tests that cover the file are run until one fails: then the mutant is killed. What
survives is listed with its line: a fact that no test states, or a change that makes no difference. Annotations,
decorators, texts and replacements that fail whatever the code says (a bit shift of floats) count as no mutants.

The libraries are imported once; each mutant is tested in a fork of that process, so that it costs seconds.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from math import sqrt
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).resolve().parents[1]
COPIED = ("phantom_dyn", "identification", "benchmarks", "tests", "urdf")
LIBRARIES = (
    "numpy scipy.signal scipy.stats scipy.optimize scipy.interpolate scipy.linalg pinocchio numba jaxtyping "
    "beartype.claw msgspec yaml xarray cvxpy control matplotlib.figure pytest hypothesis jinja2 rich.console"
).split()
# Processor time that a mutant gets: this many times what the tests need without one, and some seconds.
PATIENCE, GRACE = 4.0, 10.0
OUTPUT = "output.txt"  # of the last tests, in the copy
SHIFTS = ("RShift", "LShift", "BitXor")


@dataclass(frozen=True)
class Area:
    """Code to change and the tests that cover it.

    Attributes:
        code: Folder or file in the checkout.
        tests: Folders and files of tests; those named after the changed file are run first.
        compiled: False where the code holds compiled functions: numba keeps callers that have the old one inlined.
        slow: Words of pytest's ``-k`` that leave slow tests out.
    """

    code: str
    tests: tuple[str, ...]
    compiled: bool = True
    slow: str = ""


AREAS = (
    Area("phantom_dyn/effects", ("tests/phantom_dyn/effects",), compiled=False),
    Area("identification/diagnosis/judge", ("tests/identification/diagnosis/judge",), slow="not stated_size"),
    Area("identification/diagnosis/noise", ("tests/identification/diagnosis/noise",)),
    Area("identification/data/signals.py", ("tests/identification/data/test_signals.py",)),
)


@dataclass(frozen=True)
class Place:
    """A change that an operator may make.

    Attributes:
        area: Where the file belongs.
        path: The file, from the checkout.
        line: Number of the line, from 1.
        operator: Name that cosmic-ray gives it.
        occurrence: Number of the change among all that the operator may make in the file, from 0.
        key: File, line as written, operator and its number in such lines: the same after a change elsewhere.
    """

    area: Area
    path: str
    line: int
    operator: str
    occurrence: int
    key: str


@dataclass(frozen=True)
class Mutant:
    """One change of one file: the line before and after, and the whole file after."""

    place: Place
    before: str
    after: str
    code: str


def wilson(share: int, whole: int, z: float = 1.96) -> tuple[float, float]:
    """Wilson's 95 % interval of a probability, from ``share`` successes in ``whole`` trials."""
    if whole == 0:
        return 0.0, 1.0
    p, scale = share / whole, 1.0 + z**2 / whole
    middle = (p + z**2 / (2 * whole)) / scale
    half = z * sqrt(p * (1 - p) / whole + z**2 / (4 * whole**2)) / scale
    return middle - half, middle + half


def left_out(source: str) -> Callable[[int, int], bool]:
    """Says of a line (from 1) and a column (from 0) whether it is annotation, decorator or text."""
    spans = []
    for node in ast.walk(ast.parse(source)):
        parts: list[ast.AST | None] = []
        if isinstance(node, ast.arg | ast.AnnAssign):
            parts = [node.annotation]
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            parts = [*node.decorator_list, node.returns if isinstance(node, ast.FunctionDef) else None]
        elif isinstance(node, ast.JoinedStr):
            parts = [node]
        for part in parts:
            if isinstance(part, ast.expr) and part.end_lineno is not None and part.end_col_offset is not None:
                spans.append(((part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset)))
    return lambda line, column: any(start <= (line, column) < end for start, end in spans)


def worth_trying(name: str) -> bool:
    """False for replacements that end in an error or change nothing on numbers, whatever the code around them says."""
    if name.startswith("ReplaceBinaryOperator"):
        new = name.rsplit("_", 1)[1]
        return new not in SHIFTS and ("Bit" in name.rsplit("_", 2)[1]) == ("Bit" in new)
    if name.startswith("ReplaceComparisonOperator"):
        return name in ("ReplaceComparisonOperator_Is_IsNot", "ReplaceComparisonOperator_IsNot_Is") or "Is" not in name
    return name not in ("RemoveDecorator", "ExceptionReplacer") and not name.startswith("ReplaceUnaryOperator_USub_Inv")


def places_in(area: Area, path: Path) -> Iterator[Place]:
    """Places of a file that an operator may change, in the order of the operators' names."""
    trees = importlib.import_module("cosmic_ray.ast")
    known: Any = importlib.import_module("cosmic_ray.operators.provider").OperatorProvider()
    source = path.read_text()
    lines, skipped, nodes = source.splitlines(), left_out(source), list(trees.ast_nodes(trees.get_ast(source)))
    met: Counter[str] = Counter()
    for name in sorted(known):
        if known[name].arguments() or not worth_trying(name):
            continue
        operator = known[name]()
        found = [(node, start) for node in nodes for start, _ in operator.mutation_positions(node)]
        for occurrence, (node, (line, column)) in enumerate(found):
            no_operator = "Binary" in name and node.parent.type in ("parameters", "subscript", "dictorsetmaker")
            if not (no_operator or skipped(line, column)):
                key = f"{path.name} {name} {lines[line - 1].strip()}"
                met[key] += 1
                yield Place(area, str(path.relative_to(CHECKOUT)), line, name, occurrence, f"{key} {met[key]}")


def mutant_at(place: Place) -> Mutant | None:
    """The mutant of a place; None where what comes out is no Python or means the same."""
    operator: Any = importlib.import_module("cosmic_ray.operators.provider").OperatorProvider()[place.operator]()
    source = (CHECKOUT / place.path).read_text()
    code = importlib.import_module("cosmic_ray.mutating").mutate_code(source, operator, place.occurrence)
    try:
        if code is None or ast.dump(ast.parse(code)) == ast.dump(ast.parse(source)):
            return None
    except SyntaxError:
        return None
    old, new = (text.splitlines()[place.line - 1].strip() for text in (source, code))
    return Mutant(place, old, new, code)


def drawn(sample: int, seed: int, only: str) -> list[Mutant]:
    """So many mutants at random, all if ``sample`` is zero, by file and line.

    Each place draws its own number, so that a line that is changed elsewhere leaves the sample as it was.
    """
    places = [place for area in AREAS for file in files(area) if only in str(file) for place in places_in(area, file)]
    print(f"{len(places)} places, of which {sample or 'all'} are tried, seed {seed}", flush=True)
    places.sort(key=lambda place: random.Random(f"{seed} {place.key}").random())
    found = (mutant for mutant in map(mutant_at, places) if mutant is not None)
    return sorted(islice(found, sample or None), key=lambda mutant: (mutant.place.path, mutant.place.line))


def files(area: Area) -> list[Path]:
    """The Python files of an area, sorted."""
    place = CHECKOUT / area.code
    return sorted(place.rglob("*.py")) if place.is_dir() else [place]


def covering(area: Area, path: str, tree: Path) -> list[str]:
    """Test files of an area in a checkout, those that share most of their name with the changed file first."""
    found = [file for place in area.tests for file in sorted((tree / place).rglob("test_*.py"))]
    found += [tree / place for place in area.tests if place.endswith(".py")]
    words = Path(path).stem.split("_")

    def strangeness(file: Path) -> int:
        return -sum(len(word) for word in words if word in file.stem)

    return [str(file.relative_to(tree)) for file in sorted(found, key=strangeness)]


def tested(area: Area, path: str, tree: Path, seconds: float, mutated: bool) -> tuple[str, float]:
    """Outcome of the tests in a fork (passed, failed or timed out) and the processor time that it took [s]."""
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
    """Processor time [s] of an area's tests without a mutant; they have to pass."""
    outcome, seconds = tested(area, area.code, tree, 3600.0, mutated=False)
    if outcome != "passed":
        said = (tree / OUTPUT).read_text()[-2000:]
        raise SystemExit(f"{said}\nThe tests of {area.code} fail without any mutant: mend them first.")
    print(f"{area.code}: the tests take {seconds:.0f} s of processor time", flush=True)
    return seconds


def tried(mutant: Mutant, tree: Path, seconds: float) -> str:
    """Puts a mutant into the copy, runs its tests, and takes it out again: killed, survived or timed out."""
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
    """Killed, survived and timed out for each file, and the share that was noticed with Wilson's interval."""
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
    """Draws mutants and tries each of them; survivors are printed as they are met."""
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
            if outcome != "killed":
                print(f"[{number}] {outcome}: {mutant.place.path}:{mutant.place.line}")
                print(f"    - {mutant.before}\n    + {mutant.after}", flush=True)
        for area in areas:  # what has spoilt the copy meanwhile would count as killed
            needed(area, tree)
    return out


def main(words: Sequence[str] | None = None) -> None:
    """Reads the command line, tries the mutants, and prints the table."""
    parser = argparse.ArgumentParser(description="Share of mutants that the tests notice.")
    parser.add_argument("--sample", type=int, default=150, help="how many mutants; 0 is all of them (default: 150)")
    parser.add_argument("--seed", type=int, default=1, help="of the sample (default: 1)")
    parser.add_argument("--only", default="", help="files with this in their path")
    given = parser.parse_args(words)
    print(table(run(given.sample, given.seed, given.only)))


if __name__ == "__main__":
    main()
