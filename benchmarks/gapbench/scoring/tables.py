"""Results as markdown tables that also line up in a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence

from .figures import BASELINE_FIGURES, FIGURES, Cases, beyond, missed, of_kind
from .proportions import middle, proportion
from .reliability import reliability

FLOORS = (2.0, 4.0)
OWN = "phantom-dyn"
LITTLE_BEYOND = 3.0  # noise floors: a gap of which the tolerance leaves no more is hard to tell from it
WIDTH = 120  # of a line of prose


def wrapped(text: str) -> str:
    """One paragraph in lines of at most `WIDTH` characters."""
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)


def cell(value: object) -> str:
    """A value as printed."""
    if value is None:
        return "-"
    return f"{value:.2g}" if isinstance(value, float) else str(value)


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A markdown table with columns of equal width."""
    texts = [list(header), *([cell(value) for value in row] for row in rows)]
    widths = [max(len(row[i]) for row in texts) for i in range(len(header))]
    lines = ["| " + " | ".join(t.ljust(w) for t, w in zip(row, widths, strict=True)) + " |" for row in texts]
    return "\n".join([lines[0], "|" + "|".join("-" * (w + 2) for w in widths) + "|", *lines[1:]])


def aims(cases: Cases) -> str:
    """Every figure for gaps of at least two and four noise floors, and for all cases, beside what is to be reached."""
    groups = [beyond(cases, floor) for floor in (*FLOORS, 0.0)]
    rows = []
    for figure in FIGURES:
        scores = [figure.of(group) for group in groups]
        met = {None: "", True: "yes", False: "no"}[figure.met(scores[0])]
        rows.append((figure.name, figure.aim or "-", scores[0], met, *scores[1:]))
    return table(("figure", "to reach", "gap of 2 floors or more", "reached", "4 or more", "all"), rows)


def beside(cases: Cases, baselines: Mapping[str, Cases]) -> str:
    """The same figures of the baselines for gaps of at least two noise floors, over the cases that they were given."""
    given = {x.id for group in baselines.values() for x in group}
    methods = {OWN: [x for x in cases if x.id in given], **baselines}
    rows: list[tuple[object, ...]] = [
        (figure.name, *(figure.of(beyond(group, FLOORS[0])) for group in methods.values()))
        for figure in BASELINE_FIGURES
    ]
    rows.append(("cases", *(len(group) for group in methods.values())))
    rows.append(("no answer", *(sum(x.verdict == "failed" for x in group) for group in methods.values())))
    rows.append(("seconds per case (median)", *(middle(x.seconds for x in group) for group in methods.values())))
    return table(("gap of 2 floors or more", *methods), rows)


def _row(name: str, cases: Cases) -> tuple[object, ...]:
    return (
        name,
        len(cases),
        proportion(x.top1 for x in cases),
        proportion(x.top1_strict for x in cases),
        proportion(x.in_set for x in cases),
        proportion(x.joint for x in cases),
        proportion(x.extra for x in cases),
        proportion(not x.claims for x in cases),
        proportion(e for x in cases for e in x.covered),
        middle(e for x in cases for e in x.errors),
        middle(x.seconds for x in cases),
    )


def singles(cases: Cases) -> str:
    """Single effects of at least two noise floors: by robot and by effect."""
    large = beyond(of_kind(cases, "single"), FLOORS[0])
    rows = [_row("all", large)]
    rows += [_row(r, [x for x in large if x.robot == r]) for r in sorted({x.robot for x in large})]
    rows += [_row(e, [x for x in large if x.effect == e]) for e in sorted({x.effect for x in large})]
    header = (
        "single effects",
        "cases",
        "top-1",
        "strict",
        "truth in set",
        "joint",
        "extra",
        "no claim",
        "95 % covers",
        "magnitude error",
        "seconds",
    )
    return table(header, rows)


def misses(cases: Cases) -> str:
    """One sentence on the singles of at least two noise floors that are not named; empty without such singles."""
    large, not_named = beyond(of_kind(cases, "single"), FLOORS[0]), missed(cases, FLOORS[0])
    if not large:
        return ""
    silent = sum(not x.claims for x in not_named)
    little = sum(x.beyond < LITTLE_BEYOND for x in not_named)
    return wrapped(
        f"Of {len(large)} singles with a gap of {FLOORS[0]:g} floors or more the truth is not named in "
        f"{len(not_named)}; in {silent} of these nothing at all is named, and {little} of these keep less than "
        f"{LITTLE_BEYOND:g} floors beyond the tolerance."
    )


def others(cases: Cases) -> str:
    """Nulls, pairs and causes outside the catalogue, by robot or by cause."""
    rows: list[tuple[object, ...]] = []
    nulls = of_kind(cases, "null")
    for robot in sorted({x.robot for x in nulls}):
        mine = [x for x in nulls if x.robot == robot]
        rows.append((f"null, {robot}", len(mine), "false claims", proportion(x.false_claim for x in mine)))
    pairs = beyond(of_kind(cases, "pair"), FLOORS[0])
    for robot in sorted({x.robot for x in pairs}):
        mine = [x for x in pairs if x.robot == robot]
        rows.append((f"pair, {robot}", len(mine), "both named", proportion(x.all_named for x in mine)))
    outside = beyond(of_kind(cases, "outside"), FLOORS[0])
    for cause in sorted({x.effect for x in outside}):
        mine = [x for x in outside if x.effect == cause]
        rows.append((f"outside, {cause}", len(mine), "unknown, or named", proportion(x.outside_right for x in mine)))
    return table(("other cases", "cases", "figure", "share"), rows)


def calibration(cases: Cases) -> str:
    """Stated probability against the share that is right, over all listed answers."""
    rows = [(b.name, len(b.right), b.stated, proportion(b.right)) for b in reliability(cases) if b.right]
    return table(("stated probability", "answers", "mean stated", "right"), rows)
