"""A page that sets what a paper states beside what this project computes: rows, sections and their Markdown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

LEAD = (
    "`make papers` writes this page from the code. *Published*: as printed. *Difference*: ours less the published "
    "value, as a share of the published one; *none* where ours rounds to what is printed. A cell says where the paper, "
    "or the copy that was at hand, gives no value."
)
HEAD = "| quantity | published | ours | difference | reason, or what is assumed |\n|---|---|---|---|---|"
NOT_GIVEN = "not given"
LOST = "lost in the copy"


@dataclass(frozen=True)
class Row:
    """One table row: a quantity as published and as computed.

    Attributes:
        what: The quantity.
        published: As printed, with its unit.
        ours: As computed, with its unit.
        difference: Between both; empty where nothing can be compared.
        reason: Why they differ, or what had to be assumed.
    """

    what: str
    published: str
    ours: str
    difference: str = ""
    reason: str = ""


@dataclass(frozen=True)
class Section:
    """Rows of one section, table or figure of a paper.

    Attributes:
        title: Number and title of the section of the paper.
        shown_by: The command, example or function that computes the rows.
        rows: In the order of the paper.
    """

    title: str
    shown_by: str
    rows: tuple[Row, ...]

    def text(self) -> str:
        """The section as Markdown."""
        lines = [
            f"| {row.what} | {row.published} | {row.ours} | {row.difference} | {row.reason} |" for row in self.rows
        ]
        return "\n".join([f"## {self.title}\n", f"Computed by {self.shown_by}.\n", HEAD, *lines])


@dataclass(frozen=True)
class Page:
    """The page of one paper.

    Attributes:
        name: Of its file, without ending.
        title: Of the paper.
        source: Who wrote it, and where it was published.
        sections: One function for each section.
    """

    name: str
    title: str
    source: str
    sections: tuple[Callable[[], Section], ...]

    def text(self) -> str:
        """The page as Markdown."""
        sections = [section().text() for section in self.sections]
        return "\n\n".join([f"# {self.title}", self.source, LEAD, *sections]) + "\n"


def compared(what: str, printed: str, value: float, unit: str, *, reason: str = "", digits: int | None = None) -> Row:
    """Row of a number that is printed, and of ours.

    Args:
        what: The quantity.
        printed: The number as printed: its decimals say how far both are compared.
        value: Ours, in the same unit.
        unit: Of both.
        reason: Why they differ, or what had to be assumed.
        digits: Decimals of ours; those of the printed number and one more by default.
    """
    decimals = len(printed.partition(".")[2])
    shown = f"{value:.{decimals + 1 if digits is None else digits}f}"
    return Row(what, f"{printed} {unit}".rstrip(), f"{shown} {unit}".rstrip(), difference(printed, value), reason)


def difference(printed: str, value: float) -> str:
    """``none`` where the value rounds to the printed number, else their difference in per cent."""
    decimals, number = len(printed.partition(".")[2]), float(printed)
    if abs(value - number) <= 0.5 * 10.0**-decimals * (1 + 1e-9):
        return "none"
    if number == 0:
        return f"{value:+.2g}"
    share = 100 * (value - number) / abs(number)
    return f"{share:+.0f} %" if abs(share) >= 10 else f"{share:+.2g} %"


def exact(error: float, unit: str = "", *, none: str = "exact to rounding") -> str:
    """Largest error of an identity, or that there is none beyond rounding."""
    rounding = 1e-9
    return none if error < rounding else f"{error:.2g} {unit}".rstrip()
