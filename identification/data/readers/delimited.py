# pyright: reportAttributeAccessIssue=false
"""Reads CSV and similar text tables.

Values may be separated by comma, semicolon, tab or spaces. Comment lines and a byte-order mark are allowed. NumPy reads
all columns as numbers at once, which is fast. Only if this fails, the lines are read one by one, so that the error
message can name line, column and value.
"""

from __future__ import annotations

import csv
import re
from itertools import islice
from pathlib import Path

import numpy as np

from identification.data.readers.array_files import MOST_IN_LIST, numbered, require_unique
from identification.data.readers.contract_columns import column_of
from identification.data.recording import RawTable
from phantom_dyn.array_types import Array
from phantom_dyn.errors import LogError, listed, shortened

# A list in a cell, such as ``[0.1, 0.2]``. Whether its parts are numbers is checked later.
_LIST = re.compile(r"\[([^\[\]]*)\]", re.DOTALL)
# Blank lines and comment lines.
_SKIPPED = re.compile(rb"(?m)^[ \t\r]*(?:#[^\n]*)?\n")


def _text(path: Path) -> bytes:
    """Content of a file in which every line ends with a line feed, after a check that it is text."""
    data = path.read_bytes()
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise LogError(f"{path.name} is UTF-16 text: save it as UTF-8.")
    data = data.removeprefix(b"\xef\xbb\xbf")
    if b"\0" in data[:4096]:
        raise LogError(
            f"{path.name} is no log: give CSV, NPZ, Parquet, a ROS 1 or ROS 2 bag (.bag, .db3) or MCAP file."
        )
    if not data.strip():
        raise LogError(
            f"{path.name} is empty: a log needs a line of column names and rows of numbers; record it again."
        )
    if data.lstrip()[:1] in (b"<", b"{", b"["):
        raise LogError(f"{path.name} is no log (it looks like XML or JSON): give CSV, NPZ, Parquet, a bag or MCAP.")
    if b"\r" in data and b"\n" not in data:
        data = data.replace(b"\r", b"\n")
    return data if data.endswith(b"\n") else data + b"\n"


def _separator(header: str) -> str:
    """The separator in a header line; a space means any white space."""
    counts = {mark: header.count(mark) for mark in ("\t", ";", ",")}
    best = max(counts, key=lambda mark: counts[mark])
    return best if counts[best] else " "


def _cells(line: str, separator: str) -> list[str]:
    """Values of one line without surrounding white space."""
    if separator == " ":
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=separator), [])]


def _number(cell: str) -> float | None:
    """Value of a cell, or None if it is text."""
    if "_" in cell:
        return None
    try:
        return float(cell)
    except ValueError:
        return None


def _decoded(line: bytes) -> str:
    """A line as text: decoded as UTF-8, or if that fails, as Windows code page 1252."""
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        return line.decode("cp1252", errors="replace")


def _data_lines(data: bytes):
    """Number (from 1) and text of each line that is neither blank nor a comment."""
    for number, line in enumerate(data.split(b"\n"), start=1):
        stripped = line.strip()
        if stripped and not stripped.startswith(b"#"):
            yield number, _decoded(stripped)


def _header(file: str, data: bytes) -> tuple[list[str], str, bool]:
    """Column names, separator, and True if the names are on a line of their own, False if in a comment."""
    first = next(_data_lines(data), None)
    if first is None:
        raise LogError(f"{file} has only comments: a log needs a line of column names and rows of numbers; add them.")
    number, line = first
    separator = _separator(line)
    cells = _cells(line, separator)
    if not all(_number(cell) is not None for cell in cells):
        return cells, separator, True
    # Some programs write the column names into the last comment.
    before = [line.strip() for line in data.split(b"\n")[: number - 1]]
    comment = next((_decoded(line.lstrip(b"# ")).strip() for line in reversed(before) if line.startswith(b"#")), "")
    names = _cells(comment, _separator(comment))
    if comment and len(names) == len(cells):
        return names, separator, False
    raise LogError(
        f"{file} has no column names: line {number} holds numbers; put a line such as t,q.<joint>,tau.<joint> first."
    )


def _require_names(file: str, names: list[str]) -> None:
    """Raise an error for a column without name, or two columns with the same name."""
    # The first column may be the index of a pandas table, see `_without_index`.
    if "" in names[1:]:
        raise LogError(f"{file}: column {names.index('', 1) + 1} has no name: name every column in the first line.")
    require_unique(file, names)


def _without_index(file: str, columns: dict[str, Array], names: list[str]) -> tuple[str, ...]:
    """Remove a first column without name that counts the rows, as pandas writes it; returns a warning.

    Raises:
        LogError: If a first column without name holds anything else.
    """
    if names[0]:
        return ()
    index = columns.pop("", None)
    if index is None or np.any(np.diff(index) != 1):
        raise LogError(
            f"{file}: column 1 has no name: name every column in the first line, or, if it is the index of a table of "
            "pandas, write the file with index=False."
        )
    return (f"{file}: column 1 not used: it has no name and counts the rows.",)


def _raise_uneven(file: str, data: bytes, names: list[str], separator: str, own_line: bool) -> None:
    """Raise an error for the first line whose number of values differs from the number of names."""
    looks_like_log = any(column_of(name) is not None for name in names)
    for number, line in islice(_data_lines(data), 1 if own_line else 0, None):
        cells = _cells(line, separator)
        if len(cells) == len(names):
            looks_like_log = looks_like_log or any(_number(cell) is not None for cell in cells)
            continue
        if not looks_like_log and sum(_number(cell) is not None for cell in cells) < 2:
            raise LogError(
                f"{file} is no log: its first lines hold no table of numbers; give CSV with a line of column names, "
                "NPZ, Parquet, a bag or MCAP."
            )
        raise LogError(
            f"{file}, line {number} has {len(cells)} values where {len(names)} columns are named: every row must "
            "have the same length; mend or delete that line."
        )


def _as_numbers(body: bytes, names: list[str], separator: str) -> list[Array] | None:
    """All columns as float arrays; None if a value is no number, or rows differ in length."""
    lines = body.decode("latin-1").splitlines()
    try:
        table = np.loadtxt(lines, delimiter=separator, comments=None, quotechar='"', ndmin=2)
    except ValueError:
        return None
    return list(np.ascontiguousarray(table.T)) if table.shape[1] == len(names) else None


def _column_or_problem(file: str, name: str, cells: list[str], lines: list[int]) -> Array | str:
    """Numbers of a column, or a message on its first value that is no number."""
    values = np.empty(len(cells))
    for k, cell in enumerate(cells):
        value = _number(cell)
        if value is None:
            where = f"{file}, line {lines[k]}, column {shortened(name)}"
            if not cell:
                return f"{where} is empty: a number is needed there; write it or delete the row."
            wanted = "the decimal point as a point" if _number(cell.replace(",", ".", 1)) is not None else "a number"
            return f"{where} holds {shortened(cell)!r} where a number should be: write {wanted}."
        values[k] = value
    return values


def _line_by_line(
    file: str, data: bytes, names: list[str], separator: str, own_line: bool
) -> tuple[dict[str, Array], dict[str, str]]:
    """Columns that hold numbers, and a message for each other column."""
    _raise_uneven(file, data, names, separator, own_line)
    lines_with_numbers = list(islice(_data_lines(data), 1 if own_line else 0, None))
    lines = [number for number, _ in lines_with_numbers]
    rows = [_cells(line, separator) for _, line in lines_with_numbers]
    columns, problems = {}, {}
    for k, name in enumerate(names):
        cells = [row[k] for row in rows]
        is_list = cells[:1] and _LIST.fullmatch(cells[0]) and column_of(name) is None
        read = _list_columns if is_list else _column_or_problem
        result = read(file, name, cells, lines)
        if isinstance(result, str):
            problems[name] = result
        else:
            columns |= result if isinstance(result, dict) else {name: result}
    return columns, problems


def _list_columns(file: str, name: str, cells: list[str], lines: list[int]) -> dict[str, Array] | str:
    """Columns ``q[0]``, ``q[1]``, ... of lists such as ``[0.1, 0.2]``, or a message on the first wrong list."""
    rows: list[list[float]] = []
    for k, cell in enumerate(cells):
        inside = _LIST.fullmatch(cell)
        numbers = [_number(word) for word in re.split(r"[,\s]+", inside.group(1).strip())] if inside else [None]
        kept = [number for number in numbers if number is not None]
        if len(kept) != len(numbers) or (rows and len(kept) != len(rows[0])) or len(kept) > MOST_IN_LIST:
            wanted = f"a list of {len(rows[0])} numbers" if rows else f"a list of at most {MOST_IN_LIST} numbers"
            return f"{file}, line {lines[k]}, column {shortened(name)} holds {shortened(cell)!r}, wanted {wanted}."
        rows.append(kept)
    return numbered(name, np.array(rows))


def _line_of(data: bytes, own_line: bool, row: int) -> str:
    """Where a row (counted from 0) is in the file, such as ``line 7``."""
    found = next(islice(_data_lines(data), row + (1 if own_line else 0), None), None)
    return f"line {found[0]}" if found else f"row {row + 1}"


def read_delimited(path: Path) -> RawTable:
    """Columns of a text table under the file's own names.

    Args:
        path: The file. The column names are in its first line that is no comment, or in the last comment before it.

    Returns:
        Columns of the file; a column with a value that is no number is listed under ``problems``.

    Raises:
        LogError: If the file is empty, no text, or no table, if it has no column names or repeats one, or if its rows
            have different lengths.
    """
    data = _text(path)
    names, separator, own_line = _header(path.name, data)
    _require_names(path.name, names)
    body = _SKIPPED.sub(b"", data)
    if own_line:
        body = body[body.index(b"\n") + 1 :]
    if not body:
        raise LogError(
            f"{path.name} has no rows: there is nothing below its column names {listed(names)}; record it again."
        )
    if separator == " ":
        body = re.sub(rb"[ \t]+", b" ", re.sub(rb"(?m)^[ \t]+|[ \t\r]+$", b"", body))
    arrays = _as_numbers(body, names, separator)
    if arrays is None:
        columns, problems = _line_by_line(path.name, data, names, separator, own_line)
    else:
        columns, problems = dict(zip(names, arrays, strict=True)), {}
    warnings = _without_index(path.name, columns, names)
    return RawTable(path.name, columns, warnings, problems=problems, place=lambda row: _line_of(data, own_line, row))
