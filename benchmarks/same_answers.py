"""Check whether two versions of the code give the same answers to forty recordings.

    python benchmarks/same_answers.py record --out before.json --tree ../before
    python benchmarks/same_answers.py record --out after.json
    python benchmarks/same_answers.py compare before.json after.json

This is for changes that should not change an answer. Only the command line is used, as ``python -m
identification.cli``, so modules may move. The recordings are 28 sealed cases of development seeds and 12 real ones
(PHANTOM_DYN_DATA), kept in a cache folder, so both versions get the same files. Everything in a diagnosis is kept
except run, seconds and version; the schema, the ledger and sentences are not compared.
``--rule above_chance.LEAST_GAIN=30`` judges with another threshold.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.same_answers_cases import CHECKOUT, Recording, fingerprint, prepared, recordings

CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "phantom-dyn" / "same_answers"
TIMEOUT = 1200.0  # longest time of a diagnosis [s]
LIMITS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
NOT_KEPT = ("run", "seconds", "version")
NOT_COMPARED = ("schema", "robot", "ledger", "files", "data_warnings", "say", "why")  # wording, which may differ
NAMES = ("quantity", "effect", "joint", "parameter", "recording")  # keys that identify the entries of a list
SHOWN = 4  # largest number of differences in a line
RTOL = 1e-9

Leaf = str | float | bool | None


@dataclass(frozen=True)
class Comparison:
    """How two answers to one recording differ: in words, and the relative difference of each size beyond the limit."""

    words: tuple[str, ...]
    sizes: Mapping[str, float]


@dataclass(frozen=True)
class Judge:
    """The code that judges: a checkout, with other values of decision rules.

    Attributes:
        tree: The checkout.
        rules: Rules such as ``above_chance.LEAST_GAIN=30``: a file of ``identification/gates`` or
            ``contract_levels`` and a threshold in it; without a file, one of ``decision_rules``.
    """

    tree: Path
    rules: tuple[str, ...] = ()

    @property
    def command(self) -> list[str]:
        """The first words of the command line."""
        if not self.rules:
            return [sys.executable, "-m", "identification.cli"]
        lines = ["import importlib", "import sys"]
        for rule in self.rules:
            place, value = rule.split("=")
            module, name = module_of(place)
            lines.append(f"rules = importlib.import_module({module!r})")
            lines.append(f"rules.{name} = type(rules.{name})({float(value)!r})")
        lines += ["from identification.cli.main import main", "sys.exit(main())"]
        return [sys.executable, "-c", "\n".join(lines)]


def module_of(rule: str) -> tuple[str, str]:
    """The module with a threshold, and the threshold's name in it."""
    file, dot, name = rule.rpartition(".")
    if not dot:
        return "identification.diagnosis.decision_rules", name
    shared = file == "contract_levels"
    return ("identification.engine." if shared else "identification.gates.") + file, name


def judged(recording: Recording, judge: Judge, cache: Path) -> dict:
    """Answer of a tree's code to one recording, from a process of its own; or the reason of its refusal."""
    folder = prepared(recording, cache)
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "diagnosis.json"
        command = [*judge.command, "diagnose", *recording.words, "--json", str(file)]
        environment = {**os.environ, **LIMITS, "PYTHONPATH": str(judge.tree)}
        done = subprocess.run(
            command, cwd=folder, env=environment, capture_output=True, text=True, timeout=TIMEOUT, check=False
        )
        if done.returncode == 0:
            said = {key: value for key, value in json.loads(file.read_text()).items() if key not in NOT_KEPT}
        else:
            said = {"verdict": "refused", "why": (done.stderr.strip().splitlines() or [""])[-1]}
    return {"inputs": fingerprint(recording, folder), **said}


def record(chosen: Sequence[Recording], judge: Judge, cache: Path, out: Path, jobs: int) -> None:
    """Write the answers of a tree; after each recording the file contains all answers so far."""
    answers: dict[str, dict] = {}

    def timed(recording: Recording) -> tuple[dict, float]:
        start = time.perf_counter()
        return judged(recording, judge, cache), time.perf_counter() - start

    with ThreadPoolExecutor(jobs) as pool:
        running = {pool.submit(timed, recording): recording.name for recording in chosen}
        for one in as_completed(running):
            name, (answer, seconds) = running[one], one.result()
            answers[name] = answer
            part = out.with_suffix(".part")
            part.write_text(json.dumps(answers, indent=1, sort_keys=True, ensure_ascii=False) + "\n")
            part.replace(out)
            print(f"{name}: {answer['verdict']}, {seconds:.1f} s", flush=True)


def entry_name(entry: object, index: int) -> str:
    """Name of a list entry: its effect and joint, or its index."""
    if not isinstance(entry, Mapping):
        return str(index)
    if isinstance(entry.get("effects"), list):
        return " with ".join(entry_name(effect, k) for k, effect in enumerate(entry["effects"]))
    return " ".join(str(entry[key]) for key in NAMES if entry.get(key) is not None) or str(index)


def named(entries: Sequence) -> dict[str, object]:
    """The entries of a list by name; a repeated name gets its index as a suffix."""
    out: dict[str, object] = {}
    for index, entry in enumerate(entries):
        name = entry_name(entry, index)
        out[name if name not in out else f"{name} ({index})"] = entry
    return out


def leaves(value: object, at: str) -> Iterator[tuple[str, Leaf]]:
    """Every value of an answer by its path; for each list and mapping also its keys in order."""
    if isinstance(value, Mapping | list):
        inside = named(value) if isinstance(value, list) else {key: value[key] for key in sorted(compared_keys(value))}
        yield at, f"[{', '.join(inside)}]"
        for name, entry in inside.items():
            yield from leaves(entry, f"{at}: {name}")
    else:
        assert value is None or isinstance(value, str | int | float)
        yield at, value


def compared_keys(answer: Mapping) -> set[str]:
    """Keys of an answer without those for wording."""
    return set(answer).difference(NOT_COMPARED)


def is_size(value: Leaf) -> bool:
    """Whether a value is a number."""
    return isinstance(value, int | float) and not isinstance(value, bool)


def compared(one: Mapping, other: Mapping, rtol: float = RTOL) -> Comparison:
    """How two answers differ; entries that only one of them has are reported by the list that contains them."""
    words, sizes = [], {}
    before, after = (
        {k: v for key in sorted(compared_keys(answer)) for k, v in leaves(answer[key], key)} for answer in (one, other)
    )
    if compared_keys(one) != compared_keys(other):
        words.append(f"parts {sorted(compared_keys(one))} -> {sorted(compared_keys(other))}")
    for path in (path for path in before if path in after):
        a, b = before[path], after[path]
        if is_size(a) and is_size(b):
            a, b = float(a or 0), float(b or 0)
            difference = abs(a - b) / max(abs(a), abs(b)) if a != b else 0.0
            if difference > rtol:
                sizes[path] = difference
        elif a != b:
            words.append(f"{path} {a} -> {b}")
    return Comparison(tuple(words), sizes)


def shortened(entries: Sequence[str]) -> str:
    """The first words of a list, and the number of the others."""
    more = f"; {len(entries) - SHOWN} more" if len(entries) > SHOWN else ""
    return "; ".join(entries[:SHOWN]) + more


def line(found: Comparison) -> str:
    """One line for a comparison."""
    parts = []
    if found.words:
        parts.append(f"DIFFERENT: {shortened(found.words)}")
    if found.sizes:
        largest = sorted(found.sizes, key=lambda path: -found.sizes[path])
        sizes = shortened([f"{path} ({found.sizes[path]:.1e})" for path in largest])
        parts.append(f"sizes differ by up to {found.sizes[largest[0]]:.1e}: {sizes}")
    return "; ".join(parts) or "same"


def compare(before: Mapping[str, dict], after: Mapping[str, dict], rtol: float) -> int:
    """Print one line for each recording, and a count; return 0 if all answers are equal except for sizes."""
    same = moved = different = 0
    for name in dict.fromkeys((*before, *after)):
        if name not in before or name not in after:
            print(f"{name}: DIFFERENT: only in the {'first' if name in before else 'second'} file")
            different += 1
            continue
        found = compared(before[name], after[name], rtol)
        print(f"{name}: {line(found)}")
        different += bool(found.words)
        moved += bool(found.sizes and not found.words)
        same += not (found.sizes or found.words)
    print(f"{same} same, {moved} with other sizes only, {different} different")
    return int(different > 0)


def chosen(names: Sequence[str] | None) -> tuple[Recording, ...]:
    """The recordings with some names, or all."""
    every = {recording.name: recording for recording in recordings()}
    unknown = [name for name in names or () if name not in every]
    if unknown:
        raise SystemExit(f"there is no recording {unknown[0]}: give some of {', '.join(every)}")
    return tuple(every[name] for name in names or every)


def parser() -> argparse.ArgumentParser:
    """The options of the two commands."""
    out = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = out.add_subparsers(dest="command", required=True)
    first = commands.add_parser("record", help="write what a checkout says")
    first.add_argument("--out", type=Path, required=True, metavar="FILE")
    first.add_argument("--tree", type=Path, default=CHECKOUT, metavar="DIR", help="checkout that judges; default: this")
    first.add_argument(
        "--rule", action="append", default=[], metavar="GATE.NAME=VALUE", help="another value of a threshold"
    )
    first.add_argument("--jobs", type=int, default=1, metavar="N", help="recordings at once; default: 1")
    first.add_argument("--cache", type=Path, default=CACHE, metavar="DIR", help=f"of the cases; default: {CACHE}")
    second = commands.add_parser("compare", help="compare two such files")
    second.add_argument("files", type=Path, nargs=2, metavar="FILE")
    second.add_argument("--rtol", type=float, default=RTOL, help=f"of the sizes; default: {RTOL:g}")
    for command in (first, second):
        command.add_argument("--only", nargs="+", metavar="NAME", help="these recordings; default: all")
    return out


def main(words: Sequence[str] | None = None) -> int:
    """Record or compare."""
    given = parser().parse_args(words)
    if given.command == "record":
        tree = given.tree.resolve()
        if not any(tree.glob("identification/cli*")):  # otherwise the installed packages would judge
            raise SystemExit(f"{tree} is no checkout: it has no identification/cli")
        record(chosen(given.only), Judge(tree, tuple(given.rule)), given.cache.resolve(), given.out, given.jobs)
        return 0
    before, after = (json.loads(file.read_text()) for file in given.files)
    if given.only:
        before, after = ({name: side[name] for name in given.only if name in side} for side in (before, after))
    return compare(before, after, given.rtol)


if __name__ == "__main__":
    sys.exit(main())
