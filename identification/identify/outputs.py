"""Writing the files of an identification: all of them, or none where one of them could not be written."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path

from identification.files import temporary_beside
from identification.identify.exports import MJCF, URDF
from identification.identify.json_output import json_text
from identification.identify.result import Identification
from phantom_dyn.errors import UsageError

NAMES = ("identification.json", "report.html", URDF, MJCF)


def check_folder(out: Path) -> None:
    """Refuse a folder that cannot be written to, before any work is done.

    Raises:
        UsageError: If it is no folder, one of our files is a folder, or there is no right to write.
    """
    if out.exists() and not out.is_dir():
        raise UsageError(f"--out {out} is a file, wanted a folder; name another folder")
    taken = next((out / name for name in NAMES if (out / name).is_dir()), None)
    if taken is not None:
        raise UsageError(f"--out: {taken} is a folder, wanted a file; remove it or name another place")
    nearest = next(parent for parent in (out, *out.absolute().parents) if parent.exists())
    if not nearest.is_dir():
        raise UsageError(f"--out: cannot make {out}: {nearest} is no folder; name another place")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise UsageError(f"--out: no right to write in {nearest}; name another place")


def write_outputs(found: Identification, out: Path) -> tuple[Path, ...]:
    """Write ``identification.json``, ``report.html`` and the models into a folder, made where it is missing.

    A model of an earlier run that this one cannot write is removed, as it would pass for this one's.

    Args:
        found: What was identified.
        out: The folder; other files in it are kept.

    Returns:
        The files written.

    Raises:
        UsageError: If a file cannot be written; nothing is written then.
    """
    # Drawing loads matplotlib, which whoever wants the numbers alone need not wait for.
    from identification.identify.report import report_html

    check_folder(out)
    texts = {"identification.json": json_text(found), "report.html": report_html(found)}
    texts |= {export.file: export.text for export in found.exports if export.text}
    with ExitStack() as renamed_together:
        for name, text in texts.items():
            renamed_together.enter_context(temporary_beside(out / name)).write_bytes(text.encode())
    for export in found.exports:
        if not export.text:
            (out / export.file).unlink(missing_ok=True)
    return tuple(out / name for name in texts)
