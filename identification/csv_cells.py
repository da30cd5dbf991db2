"""Text for the cells of a CSV file, written so that a spreadsheet does not compute a name as a formula."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def text_cell(text: str | None) -> str | None:
    """Text of a cell, with an apostrophe in front if it begins like a formula; spreadsheets then show it as text."""
    return f"'{text}" if text is not None and text.startswith(_FORMULA) else text


def header_line(names: Iterable[str]) -> str:
    """Names of columns as one line; a name with a comma or a quotation mark is quoted."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow(list(names))
    return line.getvalue()
