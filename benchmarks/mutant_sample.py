"""Choose the deliberate mistakes of `mutants.py`: possible places, exceptions, and a random sample."""

from __future__ import annotations

import ast
import importlib
import random
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).resolve().parents[1]
SHIFTS = ("RShift", "LShift", "BitXor")


@dataclass(frozen=True)
class Area:
    """Code to change and the tests that cover it.

    Attributes:
        code: Folder or file in the checkout.
        tests: Folders and files of tests; those named after the changed file run first.
        compiled: False if the code has compiled functions: numba keeps callers in which the old function is inlined.
        slow: Expression for pytest's ``-k`` that excludes slow tests.
        apart: Subfolders of independent code, each with a test folder of the same name.
    """

    code: str
    tests: tuple[str, ...]
    compiled: bool = True
    slow: str = ""
    apart: tuple[str, ...] = ()


AREAS = (
    Area(
        "phantom_dyn/effects",
        ("tests/phantom_dyn/effects",),
        compiled=False,
        apart=("drive", "encoder", "friction", "load", "transmission"),
    ),
    Area("identification/gates", ("tests/identification/gates",)),
    Area("identification/diagnosis/judge", ("tests/identification/diagnosis/judge",), slow="not stated_size"),
    Area("identification/diagnosis/noise", ("tests/identification/diagnosis/noise",)),
    Area(
        "identification/data/signals.py",
        tuple(f"tests/identification/data/test_{topic}.py" for topic in ("signals", "band", "spectra")),
    ),
)


@dataclass(frozen=True)
class Place:
    """A change that an operator may make.

    Attributes:
        area: Area of the file.
        path: Path of the file in the checkout.
        line: Number of the line, from 1.
        operator: Name of the change in cosmic-ray.
        occurrence: Index of the change among all that the operator can make in the file, from 0.
        key: File, text of the line, operator and index within equal lines; it does not depend on changes elsewhere.
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


def left_out(source: str) -> Callable[[int, int], bool]:
    """A function that tells for a line (from 1) and column (from 0) whether it is annotation, decorator or text."""
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
    """False for replacements that always raise an error or change nothing for numbers."""
    if name.startswith("ReplaceBinaryOperator"):
        new = name.rsplit("_", 1)[1]
        return new not in SHIFTS and ("Bit" in name.rsplit("_", 2)[1]) == ("Bit" in new)
    if name.startswith("ReplaceComparisonOperator"):
        return name in ("ReplaceComparisonOperator_Is_IsNot", "ReplaceComparisonOperator_IsNot_Is") or "Is" not in name
    return name not in ("RemoveDecorator", "ExceptionReplacer") and not name.startswith("ReplaceUnaryOperator_USub_Inv")


def places_in(area: Area, path: Path) -> Iterator[Place]:
    """Places of a file that an operator can change, in the order of the operators' names."""
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
    """The mutant of a place, or None if the result is not valid Python or equals the original."""
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
    """A number of random mutants, or all if ``sample`` is zero, sorted by file and line.

    Each place draws its own random number, so a change of another line does not change the sample.
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
