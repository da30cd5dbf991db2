"""Runs a baseline on drawn cases and writes its answers."""

from __future__ import annotations

import contextlib
import importlib
import json
import sys
import time
from pathlib import Path

from ..cases import robot_and_log


class BaselineError(Exception):
    """A baseline that cannot run at all; the sentence says what to do."""


def run_baseline(name: str, cases: Path, answers: Path) -> tuple[int, int]:
    """Writes an answer for every case that has none yet.

    Returns:
        How many answers were written, and how many cases the baseline could not read: those have none.

    Raises:
        BaselineError: If there is no case, or the baseline is not installed.
    """
    say = getattr(importlib.import_module(f".{name}", __package__), name)
    folders = sorted(path for path in cases.glob("*") if path.is_dir())
    if not folders:
        raise BaselineError(f"There are no cases in {cases}: draw them with 'gapbench draw public DIR'.")
    answers.mkdir(parents=True, exist_ok=True)
    written = failed = 0
    for folder in folders:
        out, files = answers / f"{folder.name}.json", robot_and_log(folder)
        if out.is_file() or files is None:
            continue
        start = time.perf_counter()
        try:
            with contextlib.redirect_stdout(sys.stderr):  # a toolbox may print every iteration
                said = say(*(folder / file for file in files))
        except Exception as error:  # one case that a baseline cannot do is no reason to leave the others
            print(f"{name}, {folder.name}: {type(error).__name__}: {error}", file=sys.stderr)
            failed += 1
            continue
        if said.get("left_out"):
            raise BaselineError(f"The baseline {name} is left out: {said['left_out']}.")
        out.write_text(json.dumps({**said, "seconds": time.perf_counter() - start}, indent=1) + "\n")
        written += 1
    return written, failed
