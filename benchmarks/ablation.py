"""Says of every gate and named number of the diagnosis whether it prevents wrong answers, and what right ones it costs.

    python benchmarks/ablation.py follow --cases CASES.yaml --store DIR    # each case once, all numbers followed
    python benchmarks/ablation.py numbers --cases CASES.yaml --store DIR --minutes 60
    python benchmarks/ablation.py table --store DIR --page docs/ablation.md --part numbers

CASES.yaml lists the sets: ``{make: field, sealed: FOLDER, each: 6}`` has ``cases`` and ``answers`` of a draw whose
answers are open and takes the quickest six of each kind, ``{make: second, given: FOLDER}`` has cases of
`benchmarks/given_cases.py`, ``{make: loads, loads: FOLDER, each: 2}`` recordings with weighed loads. An entry with
``names: [..]`` takes these cases alone.

A case is run once with every number followed (`benchmarks/ablation_numbers.py`) and every gate counted. What no
comparison asks, or what no comparison would turn on with half or twice the number, cannot change that case and is not
run. A gate is left out where it refused something, one of the search where it alone did. Numbers are changed in groups,
and a group whose answer differs is halved until the number is found. The groups grow with every case in which their
numbers changed no answer. A number that was found to decide in one case is left out of the groups of the next, and is
run there by itself after all others, with ``--again``.
"""

from __future__ import annotations

import argparse
import json
import random
import re
import sys
import time
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
GROUP = 8  # numbers that are changed in one run at first
MOST_IN_A_GROUP = 32  # half of these would be found to decide seldom enough that halving costs little
PACKAGES = ("identification", "phantom_dyn")
# Counts that NumPy and deques ask to be whole numbers and nothing else.
UNFOLLOWED = {
    "identification.diagnosis.fit.joint_fit:_DRAWS",
    "identification.diagnosis.judge.moved_by_noise:_SEGMENT",
    "identification.diagnosis.noise.sensor_noise:_SEGMENTS",
    "identification.diagnosis.search.fits:_RECENT",
}


def deciding(names: Sequence[str], differs: Callable[[Sequence[str]], bool]) -> list[str]:
    """Of some numbers those that change an answer by themselves, found by halving groups that do.

    Args:
        names: Numbers.
        differs: Whether the answer differs with some of them changed.
    """
    if not names or not differs(names):
        return []
    if len(names) == 1:
        return list(names)
    half = len(names) // 2
    return [*deciding(names[:half], differs), *deciding(names[half:], differs)]


@dataclass(frozen=True)
class Store:
    """Results of runs, one file for each case: variant by variant, so that what is there is not run again."""

    folder: Path

    def file(self, key: str) -> Path:
        """The file of a case."""
        return self.folder / f"{key}.json"

    def of(self, key: str) -> dict[str, dict]:
        """Results of a case by variant: ``follow``, ``without GATE``, ``0.5 NUMBER NUMBER``."""
        path = self.file(key)
        return json.loads(path.read_text()) if path.is_file() else {}

    def add(self, key: str, variant: str, result: Mapping) -> None:
        """Keep a result."""
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
    """A case with every number followed; one that the code can not take in this form is added to ``unfollowed``."""
    while True:
        result = run(case, Variant(numbers=tuple(n for n in numbers if n.key not in unfollowed), follow=True))
        met = _named_in(result["error"], [n for n in numbers if n.key not in unfollowed]) if result["error"] else []
        if result["trace"] is not None or not met:
            return {**result, "kind": case.kind, "skip": sorted(unfollowed)}
        unfollowed.update(met)


def _named_in(error: str, numbers: Sequence[Named]) -> list[str]:
    """Numbers of the innermost line of a traceback that names some; else all of the modules it ends in."""
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
    """Run a case without each gate that may matter in it."""
    results = store.of(case.key)
    for gate in gates_to_leave_out(base_of(results), gates):
        if f"without {gate}" not in results and time.time() < until:
            store.add(case.key, f"without {gate}", run(case, Variant(gates=(gate,))))


def vary_numbers(case: Case, numbers: Sequence[Named], store: Store, until: float, *, again: bool = False) -> None:
    """Run a case with half and twice each number that may matter in it, in groups that are halved where they do.

    Args:
        case: Followed before.
        numbers: Named numbers.
        store: Of the results.
        until: Time at which no run begins any more [s].
        again: Numbers that decide another case, each by itself, in place of those that decide none so far.

    Raises:
        TimeoutError: If that time has come.
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
    """Groups of numbers that are changed in one run.

    Args:
        names: Numbers that may change a case.
        elsewhere: In how many other cases each was run, and in how many of these it changes the answer.
        again: Those that change the answer of another case, each by itself, in place of the others.
    """
    if again:
        yield from ([name] for name in names if elsewhere.get(name, (0, 0))[1])
        return
    left = sorted(
        (name for name in names if not elsewhere.get(name, (0, 0))[1]), key=lambda n: -elsewhere.get(n, (0,))[0]
    )
    while left:
        size = min(GROUP * 2 ** elsewhere.get(left[0], (0,))[0], MOST_IN_A_GROUP)
        yield left[:size]
        left = left[size:]


def gate_names() -> tuple[str, ...]:
    """Names of all gates, in their order."""
    from identification.gates import GATES, gate_name

    return tuple(gate_name(gate) for gate in GATES)


def chosen_cases(path: Path) -> list[Case]:
    """The cases of a list of sets, mixed, so that those of any time are of every set."""
    cases = [case for entry in yaml.safe_load(path.read_text()) for case in cases_of(entry)]
    random.Random(3).shuffle(cases)
    return cases


def seconds_of(store: Store, case: Case) -> float:
    """Seconds that a case took where it was followed [s]."""
    return store.of(case.key).get("follow", {}).get("seconds", 0.0)


def one_make_after_the_other(cases: Sequence[Case], seconds: Mapping[str, float]) -> list[Case]:
    """The quickest case of every make and kind, then the next of each: those of any time are of every make."""
    place: dict[tuple[str, str], int] = {}
    of_make: dict[str, int] = {}
    ranked = []
    for case in sorted(cases, key=lambda case: seconds[case.key]):
        nth = place[case.make, case.kind] = place.get((case.make, case.kind), -1) + 1
        ranked.append((nth, seconds[case.key], case))
    out = []
    for nth, took, case in sorted(ranked, key=lambda one: one[:2]):
        turn = of_make[case.make] = of_make.get(case.make, -1) + 1
        out.append((turn, took, nth, case))
    return [case for *_, case in sorted(out, key=lambda one: one[:3])]


def with_table(page: str, part: str, table: str) -> str:
    """A page with another table between the markers of a part, ``gates`` or ``numbers``."""
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
