"""Escapes text for the cells of a CSV file, so that a spreadsheet does not run a name such as ``=A1`` as a formula."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable

_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def text_cell(text: str | None) -> str | None:
    """Text of a cell, with an apostrophe in front of text that begins like a formula: spreadsheets show it as text."""
    return f"'{text}" if text is not None and text.startswith(_FORMULA) else text


def header_line(names: Iterable[str]) -> str:
    """Header of a CSV file: the names of the columns in one line, quoted if they hold a comma or a quotation mark."""
    line = io.StringIO()
    csv.writer(line, lineterminator="").writerow(list(names))
    return line.getvalue()
