"""Confusion matrix of true and reported effects, as text and as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchmarks.gapbench.scoring.judged import Judged


@dataclass(frozen=True)
class Confusion:
    """Counts by true effect (rows) and leading finding, or verdict without a finding (columns)."""

    rows: tuple[str, ...]
    columns: tuple[str, ...]
    counts: tuple[tuple[int, ...], ...]


def confusion(cases: Sequence[Judged]) -> Confusion:
    """Counts over all cases except pairs, with rows for the effects, nulls, and causes outside the catalogue.

    A twin of the truth counts as the truth. Columns that are also rows come first, in the order of the rows.
    """
    kinds = ("single", "null", "outside")
    cases = [x for x in cases if x.kind in kinds]
    rows = tuple(dict.fromkeys(x.effect for x in sorted(cases, key=lambda x: (kinds.index(x.kind), x.effect))))
    answers = {_column(x) for x in cases}
    columns = (*[r for r in rows if r in answers], *sorted(answers - set(rows)))
    counts = tuple(tuple(sum(x.effect == r and _column(x) == c for x in cases) for c in columns) for r in rows)
    return Confusion(rows, columns, counts)


def _column(case: Judged) -> str:
    """Column of a case: its leading finding, or the true effect if the finding is a twin of it."""
    return case.effect if case.top1 and case.kind == "single" else case.leading


def confusion_text(table: Confusion) -> str:
    """The matrix as text: rows have names, columns have numbers with a legend below."""
    width = max((len(r) for r in table.rows), default=0)
    lines = [" " * width + "".join(f"{i:>4}" for i in range(1, len(table.columns) + 1))]
    for name, row in zip(table.rows, table.counts, strict=True):
        lines.append(name.ljust(width) + "".join(f"{n if n else '.':>4}" for n in row))
    lines += [f"{i:>3} {name}" for i, name in enumerate(table.columns, start=1)]
    return "\n".join(lines)


def draw_confusion(table: Confusion, path: Path) -> None:
    """The matrix as a figure: numbers are counts, the shade is the share of the row."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.0 + 0.32 * len(table.columns), 2.6 + 0.27 * len(table.rows)), layout="constrained")
    axes = figure.subplots()
    if table.rows:
        shares = [[n / max(1, sum(row)) for n in row] for row in table.counts]
        axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        for i, row in enumerate(table.counts):
            for j, n in enumerate(row):
                if n:
                    dark = shares[i][j] > 0.6
                    axes.text(j, i, str(n), ha="center", va="center", size=8, color="white" if dark else "black")
    axes.set_xticks(range(len(table.columns)), [_plain(c) for c in table.columns], rotation=60, ha="right")
    axes.set_yticks(range(len(table.rows)), [_plain(r) for r in table.rows])
    axes.set_xlabel("leading finding, or the verdict without one")
    axes.set_ylabel("truth")
    # Without date and version in the file, the same counts give the same bytes.
    figure.savefig(path, dpi=110, metadata={"Software": None})


def _plain(name: str) -> str:
    return name.replace("_", " ")
