"""Writes tables of many diagnoses: for a terminal, as CSV and as JSON (schema ``gap-diagnoses/1``)."""

from __future__ import annotations

import csv
import io
import json
import textwrap
from collections import Counter
from pathlib import Path
from typing import Any

from identification.batch.diagnose_each import REFUSED, TABLES, DiagnosedRecording, DiagnosedRecordings
from identification.batch.fleet_page import fleet_lines, fleet_page
from identification.csv_cells import text_cell
from identification.file_sets import renamed_together
from identification.words.diagnosis_words import joined
from identification.words.numbers_and_names import NO_BREAK
from phantom_dyn import __version__
from phantom_dyn.errors import printable, shortened

SCHEMA = "gap-diagnoses/1"
WIDTH = 100
_NAME_WIDTH = 32  # largest width of a recording's name in the table
_SHOWN = 3  # largest number of causes in one line of the table


def table(result: DiagnosedRecordings) -> str:
    """Table for a terminal: one line per recording with verdict and causes, and the number of each verdict."""
    names = [shortened(name, _NAME_WIDTH) for name in _names(result)]
    width = max(len("recording"), *map(len, names))
    verdict_width = max(len("verdict"), *(len(row.verdict) for row in result.rows))
    lines = [f"{'recording':<{width}}  {'verdict':<{verdict_width}}  cause"]
    for name, row in zip(names, result.rows, strict=True):
        head = f"{name:<{width}}  {row.verdict:<{verdict_width}}  "
        lines.append(
            textwrap.fill(head + printable(_cause_words(row)), WIDTH, subsequent_indent=" " * len(head)).rstrip()
        )
    return "\n".join([*lines, "", counts(result), *map(printable, fleet_lines(result))]).replace(NO_BREAK, " ")


def _names(result: DiagnosedRecordings) -> list[str]:
    """File names of the recordings; with the name of the folder if the recordings are in several folders."""
    logs = [Path(row.log) for row in result.rows]
    several = len({log.parent for log in logs}) > 1
    return [f"{log.parent.name}/{log.name}" if several else log.name for log in logs]


def counts(result: DiagnosedRecordings) -> str:
    """One line with the number of recordings of each verdict."""
    number = Counter(row.verdict for row in result.rows)
    counted = ", ".join(f"{count} {verdict}" for verdict, count in number.most_common())
    return f"{len(result.rows)} {'recording' if len(result.rows) == 1 else 'recordings'}: {counted}"


def csv_text(result: DiagnosedRecordings) -> str:
    """The table as CSV: one row per recording, with the residual of every joint before and after correction."""
    out = io.StringIO()
    joints = [f"{column}.{joint}" for joint in result.joint_names for column in ("rms_before", "rms_after")]
    head = ["log", "folder", "verdict", "findings", "unexplained", *joints, "seconds", "refusal", "run"]
    writer = csv.DictWriter(out, head, lineterminator="\n")
    writer.writeheader()
    writer.writerows(_csv_row(row) for row in result.rows)
    return out.getvalue()


def json_text(result: DiagnosedRecordings) -> str:
    """The table as JSON: one entry per recording, with the content of its ``diagnosis.json``."""
    rows = [
        {
            "log": row.log,
            "folder": row.folder,
            "verdict": row.verdict,
            "refusal": row.refusal,
            "diagnosis": row.document,
        }
        for row in result.rows
    ]
    content = {"schema": SCHEMA, "robot": result.robot, "version": __version__, "recordings": rows}
    return json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def write_tables(
    result: DiagnosedRecordings, *, out: str | Path | None = None, json_file: str | Path | None = None
) -> tuple[Path, ...]:
    """Write the tables and ``fleet.html`` into a folder, and the JSON table to another file.

    Args:
        result: The diagnoses.
        out: The folder; None for no folder.
        json_file: Additional file for the JSON table; None for none.

    Returns:
        Paths of the written files.

    Raises:
        UsageError: If a file cannot be written; no file is written then.
    """
    contents: dict[Path, str] = {}
    if out is not None:
        texts = (json_text(result), csv_text(result), fleet_page(result))
        contents = dict(zip((Path(out) / name for name in TABLES), texts, strict=True))
    if json_file is not None:
        contents[Path(json_file)] = json_text(result)
    with renamed_together(Path("." if out is None else out)) as beside:
        for path, text in contents.items():
            beside(path).write_bytes(text.encode("utf-8", "backslashreplace"))
    return tuple(contents)


def _csv_row(row: DiagnosedRecording) -> dict[str, Any]:
    """Cells of a recording by column."""
    texts = {"log": row.log, "folder": row.folder, "verdict": row.verdict, "refusal": row.refusal}
    out: dict[str, Any] = {name: text_cell(text) for name, text in texts.items()}
    document: Any = row.document
    if document is None:
        return out
    out["findings"] = "; ".join(" ".join(filter(None, (f["effect"], f["joint"]))) for f in document["findings"])
    out["unexplained"] = document["unexplained"]["fraction_of_explainable"]
    for joint in document["joints"]:
        out[f"rms_before.{joint['joint']}"], out[f"rms_after.{joint['joint']}"] = (
            joint["rms_before"],
            joint["rms_after"],
        )
    return out | {"seconds": document["seconds"], "run": document["run"]}


def _cause_words(row: DiagnosedRecording) -> str:
    """The causes that a diagnosis found, else its verdict in words, or the reason why the recording was refused."""
    if row.verdict == REFUSED:
        return row.refusal or ""
    if not row.causes:
        return row.sentence
    causes = list(row.causes)
    if len(causes) > _SHOWN:
        return f"{joined(causes[:_SHOWN], last=', ')} and {len(causes) - _SHOWN} more"
    return joined(causes)
