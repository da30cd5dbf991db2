"""A file of a user must be an ordinary one: a pipe keeps its reader waiting, and some devices never end."""

from __future__ import annotations

import stat
from pathlib import Path

from phantom_dyn.errors import PhantomDynError

_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def require_plain_file(path: Path, error: type[PhantomDynError], wanted: str) -> None:
    """Refuse a folder, pipe, socket or device in the place of a file, without opening it.

    Args:
        path: What was given; if it is not there, whoever opens it says so.
        error: What to raise.
        wanted: What the file should be, with its article.

    Raises:
        PhantomDynError: Of the type ``error``.
    """
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError):
        return
    kind = next((name for is_one, name in _KINDS if is_one(mode)), None)
    if kind == "a folder":
        raise error(f"{path} is a folder, wanted {wanted}: name the file itself.")
    if kind is not None:
        raise error(f"{path} is {kind}, wanted {wanted}: save what it gives as an ordinary file and name that.")
