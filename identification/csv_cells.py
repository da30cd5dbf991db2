"""Cells of a CSV file that a spreadsheet takes for text: a name that begins as a formula does would be computed."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def text_cell(text: str | None) -> str | None:
    """A text for a cell: with an apostrophe in front, as spreadsheets mark text, where it begins as a formula does."""
    return f"'{text}" if text is not None and text.startswith(_FORMULA) else text


def header_line(names: Iterable[str]) -> str:
    """Names of columns as one line, quoted where they hold a comma or a quotation mark."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow(list(names))
    return line.getvalue()
