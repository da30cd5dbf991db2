"""Run a case without a gate or with another value of a number, and judge the answer.

Each run is a child of this process: modules are loaded once, and runs do not influence each other.
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import io
import json
import os
import pkgutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import given_cases
from benchmarks.ablation_numbers import Named, Trace, followed, plain, replace_number, scaled
from benchmarks.blind.makes.real.context import entry_without_context
from benchmarks.gapbench.cases import robot_and_log
from benchmarks.gapbench.scoring.judged import judged

TIMEOUT = 240  # longest time of a run [s]: without a gate that ends a search, it may not end
BESIDE_ROBOT = "corrected.yaml"


@dataclass(frozen=True)
class Outcome:
    """Whether an answer is right, and whether it states something wrong; it may be neither if it states nothing."""

    right: bool
    wrong: bool


@dataclass(frozen=True)
class Case:
    """A recording with a known answer.

    Attributes:
        make: Origin of the case; cases of a make share robots, motions and noise.
        name: Name of the folder.
        kind: Kind of the answer: ``null``, ``single``, ``pair``, ``outside``, or the kind of a known load.
        steps: Command-line arguments of each diagnosis in order; ``{out}`` stands for a folder.
        outcome: Function that judges what the diagnosis wrote to that folder.
        stored: Folder of the draw with a stored diagnosis of the case, or None.
    """

    make: str
    name: str
    kind: str
    steps: tuple[tuple[str, ...], ...]
    outcome: Callable[[Path], Outcome]
    stored: Path | None = None

    @property
    def key(self) -> str:
        """Make and name, which identify the case."""
        return f"{self.make}/{self.name}"


@dataclass(frozen=True)
class Variant:
    """What a run changes: nothing, a gate that accepts everything, or numbers that are multiplied by a factor.

    With ``follow`` the numbers keep their values and are followed, see `ablation_numbers.Followed`.
    """

    gates: tuple[str, ...] = ()
    numbers: tuple[Named, ...] = ()
    factor: float = 1.0
    follow: bool = False


def sealed_case(folder: Path, name: str, make: str) -> Case:
    """A case of a draw with open answers, in the subfolders ``cases`` and ``answers``."""
    case, answer = folder / "cases" / name, json.loads((folder / "answers" / f"{name}.json").read_text())
    found = robot_and_log(case)
    assert found is not None
    robot, log = found
    logs = sorted(str(path) for path in case.glob("log*") if path.suffix == Path(log).suffix)
    known = ("--with", str(case / BESIDE_ROBOT)) if (case / BESIDE_ROBOT).is_file() else ()
    words = (str(case / robot), *logs, *known, "--json", "{out}/diagnosis.json")

    def outcome(out: Path) -> Outcome:
        said = read_or_none(out / "diagnosis.json")
        one = judged(answer, entry_without_context(answer, {"diagnosis": said, "seconds": 0.0}))
        right = {"null": not one.false_claim, "single": one.top1, "pair": one.all_named}
        wrong = one.false_claim if one.kind == "null" else one.extra or one.wrong_but_fits
        return Outcome(right.get(one.kind, one.verdict == "unknown"), wrong)

    stored = folder if (folder / "results" / f"{name}.json").is_file() else None
    return Case(make, name, answer["kind"], (words,), outcome, stored)


def stored_result(folder: Path, case: Case) -> dict:
    """Result of a stored diagnosis in the form of `run`, with the gates that refused according to its ledger."""
    entry = json.loads((folder / "results" / f"{case.name}.json").read_text())
    said = entry["diagnosis"] or {"verdict": "failed", "findings": [], "ledger": []}
    with tempfile.TemporaryDirectory(prefix="ablation-") as place:
        (Path(place) / "diagnosis.json").write_text(json.dumps(entry["diagnosis"]))
        outcome = case.outcome(Path(place))
    failed = [next((gate["gate"] for gate in one["gates"] if not gate["passed"]), None) for one in said["ledger"]]
    return {
        **_stored_parts(said, outcome),
        "kind": case.kind,
        "seconds": entry["seconds"],
        "refused": sorted({gate for gate in failed if gate is not None}),
    }


def _stored_parts(diagnosis: Mapping, outcome: Outcome) -> dict:
    """The parts of a diagnosis and its outcome that are stored."""
    findings = [_short(one) for one in diagnosis["findings"]]
    return {"right": outcome.right, "wrong": outcome.wrong, "verdict": diagnosis["verdict"], "findings": findings}


def given_case(folder: Path, make: str) -> Case:
    """A case of `benchmarks/given_cases.py`."""
    words = (str(folder / "robot.urdf"), str(given_cases.log_of(folder)), "--json", "{out}/diagnosis.json")

    def outcome(out: Path) -> Outcome:
        return of_given(given_cases.answered(folder, read_or_none(out / "diagnosis.json")))

    return Case(make, folder.name, given_cases.answered(folder, None).kind, (words,), outcome)


def of_given(case: given_cases.Answered) -> Outcome:
    """The outcome of a given case by its accepted answers."""
    places = frozenset().union(*case.accepted)
    findings = [] if case.said is None else case.said["findings"]

    def there(finding: Mapping) -> bool:
        rivals = [{(at["effect"], at["joint"]) for at in rival["effects"]} for rival in finding["rivals"]]
        return (finding["effect"], finding["joint"]) in places or any(rival <= places for rival in rivals)

    if case.kind == "null":
        return Outcome(case.verdict == "no_gap" and not findings, case.verdict not in ("no_gap", "failed"))
    if case.kind == "outside":
        return Outcome(case.verdict == "unknown", case.verdict == "explained")
    claims = set(case.claims)
    leads = bool(case.claims) and case.claims[0] in places
    right = leads if case.kind == "single" else all(bool(claims & one) for one in case.accepted)
    return Outcome(right, not all(there(finding) for finding in findings))


def known_load(folder: Path, book: Mapping, make: str) -> Case:
    """A real recording with a weighed load, whose true values are in a file beside it."""
    spec = importlib.util.spec_from_file_location("known_loads_score", folder.parent / "score.py")
    assert spec is not None
    assert spec.loader is not None
    score = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(score)
    steps = []
    for step in book["steps"]:
        logs = [str(folder / log) for log in step["logs"]]
        words = [str(folder / step["robot"]), *logs, "--robot-config", str(folder / step["config"])]
        words += ["--out", f"{{out}}/{book['id']}_{step['name']}", *step.get("flags", [])]
        for other in step.get("with", []):
            words += ["--with", f"{{out}}/{book['id']}_{other}/corrected.yaml"]
        if "recordings" in step:
            words += ["--recordings", str(folder / step["recordings"])]
        steps.append(tuple(words))

    def outcome(out: Path) -> Outcome:
        one = score.judge(book, out)
        return Outcome(bool(one["right"]), bool(one["confident"]) or (book["kind"] == "NULL" and bool(one["false"])))

    return Case(make, book["id"], book["kind"], tuple(steps), outcome)


def command_case(folder: Path, entry: Mapping, make: str) -> Case:
    """A case by its command ``words``, right ``verdicts``, effects that must be ``named``, and others that ``may``."""
    named, may = set(entry.get("named", ())), set(entry.get("may", ()))
    files = [str(folder / word) if (folder / word).exists() else word for word in entry["words"]]

    def outcome(out: Path) -> Outcome:
        said = read_or_none(out / "diagnosis.json") or {"verdict": "refused", "findings": []}
        each = [
            {one["effect"], *(at["effect"] for rival in one["rivals"] for at in rival["effects"])}
            for one in said["findings"]
        ]
        right = said["verdict"] in entry["verdicts"] and named <= set().union(*each)
        return Outcome(right, any(one.isdisjoint(named | may) for one in each))

    return Case(make, entry["name"], "known", ((*files, "--json", "{out}/diagnosis.json"),), outcome)


def read_or_none(path: Path) -> dict | None:
    """Content of a JSON file, or None without the file."""
    return json.loads(path.read_text()) if path.is_file() else None


def load_everything() -> None:
    """Import every module of the packages, so that child processes find each number and gate."""
    import identification

    for found in pkgutil.walk_packages(identification.__path__, "identification."):
        if not found.name.endswith("__main__"):
            importlib.import_module(found.name)


def warm_up(case: Case) -> None:
    """Diagnose a case in this process, so that child processes have numba and compiled functions loaded."""
    from identification.cli.main import main

    with (
        tempfile.TemporaryDirectory(prefix="ablation-") as out,
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.redirect_stderr(io.StringIO()),
    ):
        for step in case.steps:
            main(["diagnose", *(word.format(out=out) for word in step)])


@dataclass
class GateCounts:
    """For each gate by name: how often it was evaluated, refused a claim, and was the only gate to refuse."""

    asked: dict[str, int]
    refused: dict[str, int]
    alone: dict[str, int]


# Gates that only report the decision of another function; without that function they refuse nothing.
DECIDED_BY: Mapping[str, tuple[str, str, object]] = {
    "plausible size": ("identification.diagnosis.search.rival_sets", "implausible_size", lambda *_: None),
    "likelier than rivals": ("identification.diagnosis.search.rival_sets", "_leader", lambda *_: (None, ())),
}


def leave_out(names: Iterable[str], counts: GateCounts | None = None) -> None:
    """Let the named gates accept everything in this process; ``counts`` gets how often each gate refuses."""
    from identification import gates

    chosen = frozenset(names)
    for gate in gates.GATES:
        name = gates.gate_name(gate)

        @functools.wraps(gate)
        def instead(*given: object, _gate: Callable = gate, _name: str = name, **options: object) -> object:
            result = _gate(*given, **options)
            if counts is not None:
                counts.asked[_name] = counts.asked.get(_name, 0) + 1
                counts.refused[_name] = counts.refused.get(_name, 0) + (not result.passed)
            return replace(result, passed=True) if _name in chosen else result

        for module in list(sys.modules.values()):
            if module is not gates and module is not None and getattr(module, gate.__name__, None) is gate:
                setattr(module, gate.__name__, instead)
    for name in chosen & set(DECIDED_BY):
        module_name, function, answer = DECIDED_BY[name]
        setattr(sys.modules[module_name], function, answer)


def count_alone(counts: GateCounts) -> None:
    """Evaluate all gates of the search for every claim, and count gates that refuse alone; answers do not change."""
    from identification.diagnosis.search import claims
    from identification.engine.claims import until_failed

    def to_the_end(results: Iterable) -> tuple:
        every = tuple(results)
        failed = [one.gate for one in every if not one.passed]
        if len(failed) == 1:
            counts.alone[failed[0]] = counts.alone.get(failed[0], 0) + 1
        return until_failed(every)

    claims.until_failed = to_the_end  # type: ignore[attr-defined]


def write_plain_numbers() -> None:
    """Write plain numbers into results of gates and files while numbers are followed."""
    from identification.engine.claims import GateResult
    from identification.reporting.stored import diagnosis_files

    written = diagnosis_files._plain
    diagnosis_files._plain = lambda value: written(plain(value))

    made = GateResult.__init__

    def instead(self: object, gate: str, value: object, needed: object, unit: str, passed: object) -> None:
        made(self, gate, plain(value), plain(needed), unit, bool(passed))  # type: ignore[arg-type]

    GateResult.__init__ = instead  # type: ignore[method-assign]


def run(case: Case, variant: Variant) -> dict:
    """Run a variant of a case in a child process: outcome, verdict, findings, seconds, and the trace."""
    with tempfile.TemporaryDirectory(prefix="ablation-") as place:
        out, start = Path(place), time.perf_counter()
        child = os.fork()
        if child == 0:
            _child(case, variant, out)
        signal.signal(signal.SIGALRM, lambda *_: os.kill(child, signal.SIGKILL))
        signal.alarm(TIMEOUT)
        _, status = os.waitpid(child, 0)
        signal.alarm(0)
        words = case.steps[-1]
        last = Path(words[words.index("--out") + 1].format(out=out)) if "--out" in words else out
        said = read_or_none(last / "diagnosis.json") or {"verdict": "failed", "findings": []}
        outcome = case.outcome(out)
        return {
            **_stored_parts(said, outcome),
            "seconds": round(time.perf_counter() - start, 1),
            "ended": os.waitstatus_to_exitcode(status),
            "trace": read_or_none(out / "trace.json"),
            "error": (out / "error.txt").read_text() if (out / "error.txt").is_file() else None,
        }


def _short(finding: Mapping) -> str:
    """A finding and its rivals in words."""
    at = f"{finding['effect']} {finding['joint'] or ''}".strip()
    listed = [" & ".join(f"{e['effect']} {e['joint'] or ''}".strip() for e in r["effects"]) for r in finding["rivals"]]
    return " or ".join([at, *sorted(listed)])


def _child(case: Case, variant: Variant, out: Path) -> None:
    """Run a variant in a child process, write its results into a folder, and end the process."""
    code = 1
    try:
        with (out / "said.txt").open("w") as said, contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            trace, counts = Trace(), GateCounts({}, {}, {})
            if variant.follow:
                for named in variant.numbers:
                    replace_number(named, followed(named, trace))
                write_plain_numbers()
                leave_out((), counts)
                count_alone(counts)
            else:
                for named in variant.numbers:
                    replace_number(named, scaled(named.value, variant.factor))
                leave_out(variant.gates)
            from identification.cli.main import main

            for step in case.steps:
                code = main(["diagnose", *(word.format(out=out) for word in step)])
            if variant.follow:
                (out / "trace.json").write_text(json.dumps({**vars(trace), "gates": vars(counts)}))
    except BaseException:  # a child reports errors and never returns
        (out / "error.txt").write_text(traceback.format_exc()[-3000:])
    finally:
        os._exit(code)


def cases_of(entry: Mapping) -> list[Case]:
    """The cases of a listed set, see `benchmarks/ablation.py`; ``each`` limits the number of each kind."""
    make, each = entry["make"], entry.get("each")
    if "sealed" in entry:
        folder = Path(entry["sealed"])
        cases = [sealed_case(folder, name, make) for name in _one_robot_after_the_other(folder)]
    elif "given" in entry:
        cases = [given_case(path.parent, make) for path in sorted(Path(entry["given"]).glob("*/answer.json"))]
    elif "commands" in entry:
        cases = [command_case(Path(one["folder"]), one, make) for one in entry["commands"]]
    else:
        folder = Path(entry["loads"])
        cases = [known_load(folder, book, make) for book in json.loads((folder / "cases.json").read_text())["cases"]]
    if "names" in entry:
        cases = [case for case in cases if case.name in entry["names"]]
    taken: Counter[str] = Counter()
    out = []
    for case in cases:
        taken[case.kind] += 1
        if each is None or taken[case.kind] <= each:
            out.append(case)
    return out


def _one_robot_after_the_other(folder: Path) -> list[str]:
    """Names of the cases of a draw in turn over the robots, the fastest of each robot first.

    Without stored results all count as equally fast.
    """
    seconds: dict[tuple[str, str], list[tuple[float, str]]] = {}
    stored = sorted((folder / "results").glob("*.json"))
    for path in stored or sorted((folder / "answers").glob("*.json")):
        answer = json.loads((folder / "answers" / path.name).read_text())
        took = json.loads(path.read_text())["seconds"] if stored else 0.0
        seconds.setdefault((answer["robot"], answer["kind"]), []).append((took, path.stem))
    ranked = [
        (place, robot, name) for (robot, _), some in seconds.items() for place, (_, name) in enumerate(sorted(some))
    ]
    return [name for _, _, name in sorted(ranked)]
