"""The score of a tool on a set of cases: figures, calibration, table and JSON."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from math import isfinite, nan
from pathlib import Path

from ..generator.effects import SINGLE_EFFECTS
from .figures import Cases, Score, beyond, of_kind
from .judged import Judged, judged
from .proportions import average, proportion
from .reliability import bins_as_json, calibration_error
from .submission import AnswerError, read_answer, ready
from .tables import FLOORS, calibration, singles, table, wrapped

SURE = 0.9  # stated probability above which a wrong answer is confident
INSIDE = ("single", "pair")
GAPS = ("single", "pair", "outside")


def confident_and_wrong(case: Judged) -> bool:
    """Whether an answer with a stated probability above `SURE` is wrong."""
    return any(stated > SURE and not right for stated, right in case.stated)


def _intervals(cases: Cases) -> list[bool]:
    return [held for case in of_kind(cases, *INSIDE) for held in case.covered]


def figures(cases: Cases) -> dict[str, Score]:
    """Every figure of the card by its name."""
    one, both = of_kind(cases, "single"), of_kind(cases, *INSIDE)
    return {
        "nulls accused": proportion(x.false_claim for x in of_kind(cases, "null")),
        "cause leading": proportion(x.top1 for x in one),
        "cause listed": proportion(x.in_set for x in both),
        "causes listed per case": average(x.set_size for x in both if x.claims),
        "joint right": proportion(x.joint for x in both),
        "both causes of a pair": proportion(x.all_named for x in of_kind(cases, "pair")),
        "cause too many": proportion(x.extra for x in both),
        "no cause named": proportion(not x.claims for x in both),
        "unknown outside": proportion(x.outside_right for x in of_kind(cases, "outside")),
        "fits but wrong": proportion(
            x.wrong_but_fits for x in of_kind(cases, *GAPS) if isfinite(x.gap_closed) or x.kind == "outside"
        ),
        "confident and wrong": proportion(confident_and_wrong(x) for x in cases if x.stated),
        "size within its 95 % interval": proportion(_intervals(cases)),
    }


def judge_all(truths: Iterable[dict], answers: Path) -> tuple[list[Judged], list[str]]:
    """Every case judged, and a sentence for each fault; a case without an answer, or with a faulty one, has failed.

    Args:
        truths: What the generator wrote of each case.
        answers: Folder with a file ``<case id>.json`` for each.
    """
    cases, said = [], []
    unknown: set[str] = set()
    for truth in truths:
        path, diagnosis = answers / f"{truth['id']}.json", None
        if path.is_file():
            try:
                diagnosis = ready(truth, read_answer(path))
                unknown |= {f["effect"] for f in diagnosis["findings"]} - set(SINGLE_EFFECTS)
            except AnswerError as error:
                said += map(str, error.args)
        else:
            said.append(f"{path.name} is not there: the case counts as wrong; write an answer for every case.")
        seconds = (diagnosis or {}).get("seconds")
        cases.append(judged(truth, {"diagnosis": diagnosis, "seconds": nan if seconds is None else seconds}))
    return cases, said + [_no_cause(name) for name in sorted(unknown)]


def _no_cause(name: str) -> str:
    near = get_close_matches(name, SINGLE_EFFECTS, 1)
    meant = f"did you mean {near[0]}?" if near else "the card lists the names of causes."
    return f"The answers name {name}, which no case has: {meant}"


def text_of(cases: Sequence[Judged]) -> str:
    """The score as markdown."""
    groups = [figures(beyond(cases, floor)) for floor in (*FLOORS, 0.0)]
    rows = [(name, *(group[name] for group in groups)) for name in groups[0]]
    parts = [
        wrapped(
            "In brackets: 95 % intervals. The gap is the root mean square of what the cause changes, in noise floors; "
            "of a pair that of the smaller cause."
        ),
        table(("figure", *(f"gap of {floor:g} floors or more" for floor in FLOORS), "all"), rows),
        f"Cases: {len(cases)}. Without a valid answer: {sum(x.verdict == 'failed' for x in cases)}.",
        singles(cases),
        calibration(cases),
    ]
    error = calibration_error(cases)
    if isfinite(error):
        parts.append(f"Mean distance of stated probability and share right: {error:.2f}.")
    return "\n\n".join(parts) + "\n"


def json_of(cases: Sequence[Judged], faults: Sequence[str] = ()) -> dict:
    """The same for programs, with the outcome of every case."""
    groups = {f"gap >= {floor:g}": figures(beyond(cases, floor)) for floor in (*FLOORS, 0.0)}
    names = figures(cases)
    error = calibration_error(cases)
    return {
        "schema": "gapbench-score/1",
        "figures": {name: {group: of[name].as_json() for group, of in groups.items()} for name in names},
        "calibration": bins_as_json(cases),
        "calibration_error": error if isfinite(error) else None,
        "faults": list(faults),
        "cases": [x.as_json() for x in cases],
    }


def side_by_side(methods: Mapping[str, Cases]) -> str:
    """The figures of several tools over all their cases, a column each."""
    each = {name: figures(cases) for name, cases in methods.items()}
    rows = [(figure, *(of[figure] for of in each.values())) for figure in figures(())]
    return table(("figure", *each), rows)
