"""Measure speed and memory of this library, FIGAROH, MuJoCo's toolbox and bare Pinocchio, and write the table.

The table is written between the markers of docs/large_work.md.

    python benchmarks/speed_table.py                     # or: make speed

One run gives all rows: `compare_figaroh`, `compare_mujoco_sysid` and `core_speed`. The table goes between the markers
``<!-- speed:begin -->`` and ``<!-- speed:end -->`` with the machine and the date; the exit code is 1 where a target is
missed. A tool that cannot be installed leaves a sentence in place of its rows.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import re
import sys
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import compare_figaroh, compare_mujoco_sysid
from benchmarks.comparison import NotInstalled, Row, missed, table
from benchmarks.core_speed import core_rows
from benchmarks.gapbench.scoring.tables import wrapped
from benchmarks.markers import between_markers
from identification.files import write_atomically

PAGE = Path(__file__).resolve().parents[1] / "docs" / "large_work.md"
BEGIN, END = "<!-- speed:begin -->", "<!-- speed:end -->"


def machine(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """Processor, number of cores, system and versions."""
    named = re.search(r"model name\s*:\s*(.+)", cpuinfo.read_text()) if cpuinfo.is_file() else None
    processor = named.group(1).strip() if named else platform.machine()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "pin", "numba"))
    cores = f"{os.cpu_count()} cores"
    return f"{processor}, {cores}, {platform.system()}, Python {platform.python_version()}, {versions}"


def inside(rows: Sequence[Row], sentences: Sequence[str], day: datetime.date, where: str) -> str:
    """Text between the markers."""
    head = (
        f"Measured on {day.isoformat()} with `make speed` in one run on {where}: processor seconds with one thread "
        "each, medians or minima of several runs taken in turn, memory of processes of their own."
    )
    return "\n\n".join([wrapped(head), table(rows), *map(wrapped, sentences)])


def gathered(parts: Sequence[Callable[[], list[Row]]]) -> tuple[list[Row], list[str]]:
    """Rows of all comparisons, and a sentence for each tool that could not be installed."""
    rows, sentences = [], []
    for part in parts:
        try:
            rows += part()
        except NotInstalled as said:
            sentences.append(str(said))
    return rows, sentences


def _parts(repeats: int) -> list[Callable[[], list[Row]]]:
    return [
        lambda: compare_figaroh.figaroh_rows(compare_figaroh.installed(), repeats=repeats),
        lambda: compare_mujoco_sysid.mujoco_rows(compare_mujoco_sysid.installed()),
        core_rows,
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure, write and print; return 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description="Speed and memory beside other tools, into docs/large_work.md.")
    parser.add_argument("--page", type=Path, default=PAGE, help="file with the two markers")
    parser.add_argument("--repeats", type=int, default=3, help="processes of each side of the FIGAROH comparison")
    given = parser.parse_args(arguments)
    # Check the markers before minutes of measuring.
    between_markers(given.page.read_text(), BEGIN, END, "")
    rows, sentences = gathered(_parts(given.repeats))
    text = inside(rows, sentences, datetime.datetime.now(datetime.UTC).date(), machine())
    write_atomically(given.page, between_markers(given.page.read_text(), BEGIN, END, text.strip()))
    print(text)
    return missed(rows)


if __name__ == "__main__":
    sys.exit(main())
