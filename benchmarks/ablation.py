"""Measure how many wrong answers each gate and named number of a diagnosis prevents, and how many right ones it costs.

    python benchmarks/ablation.py follow --cases CASES.yaml --store DIR    # run each case once and follow all numbers
    python benchmarks/ablation.py numbers --cases CASES.yaml --store DIR --minutes 60
    python benchmarks/ablation.py table --store DIR --page docs/ablation.md --part numbers

CASES.yaml lists the sets. ``{make: field, sealed: FOLDER, each: 6}`` means a draw with open answers in the folders
``cases`` and ``answers``, of which the six fastest of each kind are taken. ``{make: second, given: FOLDER}`` means
cases of `benchmarks/given_cases.py`, ``{make: loads, loads: FOLDER, each: 2}`` recordings with weighed loads. An
entry with ``names: [..]`` takes only these cases.

A first run of each case follows every number (`benchmarks/ablation_numbers.py`) and counts every gate. It shows which
changes cannot alter the answer; these are not run. A number is changed only if half or twice its value would alter a
comparison. A gate is left out only if it refused something, and a gate of the search only if no other gate refused the
same. Numbers are changed in groups. A group that changes the answer is halved until the responsible number is found.
The groups grow with every case in which their numbers change no answer. A number that changed the answer of one case
is not in the groups of the next cases; ``--again`` changes it there alone, after all others.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.ablation_numbers import CHECKOUT, FACTORS, Named, named_numbers
from benchmarks.ablation_runs import Case, Variant, cases_of, load_everything, run, stored_result, warm_up
from benchmarks.ablation_table import (
    answer_of,
    base_of,
    gates_table,
    gates_to_leave_out,
    may_change,
    met_in,
    numbers_table,
)
from benchmarks.markers import between_markers

FOLDERS = ("identification/diagnosis", "identification/engine", "identification/gates")
GROUP = 8  # numbers in the first group
MOST_IN_A_GROUP = 32  # numbers in the largest group; half of these rarely change an answer, so halving costs little
PACKAGES = ("identification", "phantom_dyn")
# NumPy and deques accept only integers for these counts
UNFOLLOWED = {
    "identification.diagnosis.fit.full_fit:_MODEL_DRAWS",
    "identification.diagnosis.judge.strong_motion:_SEGMENT",
    "identification.diagnosis.noise.sensor_noise:_SEGMENTS",
    "identification.diagnosis.search.fits:_RECENT",
}


def deciding(names: Sequence[str], differs: Callable[[Sequence[str]], bool]) -> list[str]:
    """The numbers that change an answer alone, found by halving groups that change it.

    Args:
        names: Keys of the numbers.
        differs: Function that returns True if the answer differs with these numbers changed.
    """
    if not names or not differs(names):
        return []
    if len(names) == 1:
        return list(names)
    half = len(names) // 2
    return [*deciding(names[:half], differs), *deciding(names[half:], differs)]


@dataclass(frozen=True)
class Store:
    """Results of the runs, one file for each case, written after each variant so that nothing is run twice."""

    folder: Path

    def file(self, key: str) -> Path:
        """The file of a case."""
        return self.folder / f"{key}.json"

    def of(self, key: str) -> dict[str, dict]:
        """Results of a case by variant: ``follow``, ``without GATE``, ``0.5 NUMBER NUMBER``."""
        path = self.file(key)
        return json.loads(path.read_text()) if path.is_file() else {}

    def add(self, key: str, variant: str, result: Mapping) -> None:
        """Add a result."""
        path, known = self.file(key), self.of(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(".part")
        part.write_text(json.dumps({**known, variant: result}, indent=1) + "\n")
        part.replace(path)

    def cases(self) -> Iterator[tuple[str, dict[str, dict]]]:
        """All cases that were followed, with their results."""
        for path in sorted(self.folder.glob("*/*.json")):
            key = f"{path.parent.name}/{path.stem}"
            results = self.of(key)
            if "follow" in results or "stored" in results:
                yield key, results


def follow(case: Case, numbers: Sequence[Named], unfollowed: set[str]) -> dict:
    """Run a case with every number followed; numbers with which the code fails are added to ``unfollowed``."""
    while True:
        result = run(case, Variant(numbers=tuple(n for n in numbers if n.key not in unfollowed), follow=True))
        met = _named_in(result["error"], [n for n in numbers if n.key not in unfollowed]) if result["error"] else []
        if result["trace"] is not None or not met:
            return {**result, "kind": case.kind, "skip": sorted(unfollowed)}
        unfollowed.update(met)


def _named_in(error: str, numbers: Sequence[Named]) -> list[str]:
    """Named numbers that may have caused an error, from its traceback.

    These are the numbers in the innermost line that contains any, or without such a line all numbers of the innermost
    modules.
    """
    lines = error.splitlines()
    frames = [
        (".".join(Path(line.split('"')[1]).relative_to(CHECKOUT).with_suffix("").parts), lines[k + 1])
        for k, line in enumerate(lines[:-1])
        if line.startswith('  File "') and any(Path(line.split('"')[1]).is_relative_to(CHECKOUT / p) for p in PACKAGES)
    ]
    for _, text in reversed(frames):
        named = [n.key for n in numbers if n.name in re.findall(r"\w+", text)]
        if named:
            return named
    return [n.key for n in numbers if n.module in {module for module, _ in frames[-3:]}]


def vary_gates(case: Case, gates: Sequence[str], store: Store, until: float) -> None:
    """Run a case without each gate that may change its answer."""
    results = store.of(case.key)
    for gate in gates_to_leave_out(base_of(results), gates):
        if f"without {gate}" not in results and time.time() < until:
            store.add(case.key, f"without {gate}", run(case, Variant(gates=(gate,))))


def vary_numbers(case: Case, numbers: Sequence[Named], store: Store, until: float, *, again: bool = False) -> None:
    """Run a case with half and twice each number that may change its answer, in groups, see `deciding`.

    Args:
        case: Case that was followed before.
        numbers: Named numbers.
        store: Results.
        until: Time after which no run starts [s].
        again: If True, run only the numbers that change the answer of another case, each alone.

    Raises:
        TimeoutError: If a run would start after ``until``.
    """
    by_key = {n.key: n for n in numbers}
    base = store.of(case.key)["follow"]
    for k, factor in enumerate(FACTORS):

        def differs(names: Sequence[str], factor: float = factor) -> bool:
            variant = " ".join([str(factor), *names])
            known = store.of(case.key)
            if variant not in known:
                if time.time() > until:
                    raise TimeoutError
                chosen = tuple(by_key[name] for name in names)
                store.add(case.key, variant, run(case, Variant(numbers=chosen, factor=factor)))
            return answer_of(store.of(case.key)[variant]) != answer_of(base)

        others = {key: runs for key, runs in store.cases() if key != case.key}
        elsewhere = met_in(others, factor)
        for group in groups_of(may_change(base, by_key, k), elsewhere, again=again):
            deciding(group, differs)


def groups_of(
    names: Sequence[str], elsewhere: Mapping[str, tuple[int, int]], *, again: bool = False
) -> Iterator[list[str]]:
    """Groups of numbers to change in one run.

    Args:
        names: Numbers that may change a case.
        elsewhere: For each number, in how many other cases it was run, and in how many of these it changed the answer.
        again: If True, only the numbers that changed the answer of another case, each alone.
    """
    if again:
        yield from ([name] for name in names if elsewhere.get(name, (0, 0))[1])
        return
    remaining = sorted(
        (name for name in names if not elsewhere.get(name, (0, 0))[1]), key=lambda n: -elsewhere.get(n, (0,))[0]
    )
    while remaining:
        size = min(GROUP * 2 ** elsewhere.get(remaining[0], (0,))[0], MOST_IN_A_GROUP)
        yield remaining[:size]
        remaining = remaining[size:]


def gate_names() -> tuple[str, ...]:
    """Names of all gates, in their order."""
    from identification.gates import GATES, gate_name

    return tuple(gate_name(gate) for gate in GATES)


def chosen_cases(path: Path) -> list[Case]:
    """The cases of a list of sets in random order, so that a run of any length covers every set."""
    cases = [case for entry in yaml.safe_load(path.read_text()) for case in cases_of(entry)]
    random.Random(3).shuffle(cases)
    return cases


def seconds_of(store: Store, case: Case) -> float:
    """Time that the followed run of a case took [s]."""
    return store.of(case.key).get("follow", {}).get("seconds", 0.0)


def one_make_after_the_other(cases: Sequence[Case], seconds: Mapping[str, float]) -> list[Case]:
    """Order cases so that a run of any length covers every make and kind, with the fastest cases first."""

    def places(ordered: Sequence[Case], group: Callable[[Case], object]) -> dict[str, int]:
        """How many cases of its group precede each case, by its key."""
        found: Counter[object] = Counter()
        out = {}
        for case in ordered:
            out[case.key] = found[group(case)]
            found[group(case)] += 1
        return out

    fastest_first = sorted(cases, key=lambda case: seconds[case.key])
    in_kind = places(fastest_first, lambda case: (case.make, case.kind))
    kinds_in_turn = sorted(fastest_first, key=lambda case: in_kind[case.key])
    in_make = places(kinds_in_turn, lambda case: case.make)
    return sorted(kinds_in_turn, key=lambda case: (in_make[case.key], seconds[case.key]))


def with_table(page: str, part: str, table: str) -> str:
    """The page with another table between the markers of a part, ``gates`` or ``numbers``."""
    return between_markers(page, f"<!-- {part} -->", f"<!-- end of {part} -->", f"\n{table}\n")


def main(words: Sequence[str] | None = None) -> None:
    """Follows, varies, or writes the table."""
    parser = argparse.ArgumentParser(description="Which gates and numbers of the diagnosis decide, and what they cost.")
    parser.add_argument("what", choices=("stored", "follow", "gates", "numbers", "table"))
    parser.add_argument("--cases", type=Path, metavar="FILE", help="list of sets")
    parser.add_argument("--store", type=Path, required=True, metavar="DIR", help="where results are kept")
    parser.add_argument("--minutes", type=float, default=60.0, help="no run begins after these; default: 60")
    parser.add_argument(
        "--only",
        nargs="*",
        default=[],
        metavar="TEXT",
        help="numbers whose key holds one of these; gates of these names",
    )
    parser.add_argument("--again", action="store_true", help="numbers that decide another case, each by itself")
    parser.add_argument("--page", type=Path, metavar="FILE", help="page that gets the tables between their markers")
    parser.add_argument(
        "--part", nargs="*", choices=("gates", "numbers"), default=("gates", "numbers"), help="tables; default: both"
    )
    given = parser.parse_args(words)
    store, until = Store(given.store), time.time() + 60.0 * given.minutes
    numbers = named_numbers(FOLDERS)
    if given.what == "table":
        results = dict(store.cases())
        parts = {"gates": gates_table(results, gate_names()), "numbers": numbers_table(results, numbers)}
        for part in given.part:
            if given.page is None:
                print(parts[part])
            else:
                given.page.write_text(with_table(given.page.read_text(), part, parts[part]))
        return
    if given.what != "stored":
        load_everything()
    numbers = [n for n in numbers if not given.only or any(text in n.key for text in given.only)]
    gates = [gate for gate in gate_names() if not given.only or gate in given.only]
    unfollowed = {n.key for n in numbers if n.key in UNFOLLOWED}
    cases = chosen_cases(given.cases)
    if given.what == "numbers":  # each takes dozens of runs
        cases = one_make_after_the_other(cases, {case.key: seconds_of(store, case) for case in cases})
    if given.what != "stored" and cases:
        warm_up(cases[0])
    for case in cases:
        known = store.of(case.key)
        if time.time() > until:
            break
        if given.what == "stored" and case.stored is not None and "stored" not in known:
            store.add(case.key, "stored", stored_result(case.stored, case))
        elif given.what == "follow" and "follow" not in known:
            store.add(case.key, "follow", follow(case, numbers, unfollowed))
        elif given.what == "gates" and known:
            vary_gates(case, gates, store, until)
        elif given.what == "numbers" and "follow" in known:
            try:
                vary_numbers(case, numbers, store, until, again=given.again)
            except TimeoutError:
                break
        else:
            continue
        print(case.key, case.kind, answer_of(base_of(store.of(case.key))), flush=True)


if __name__ == "__main__":
    main()
