"""Ordinary files: those of a user, and those for a library that reads paths alone.

A pipe keeps its reader waiting, and some devices never end, so they are refused. Of a file that is made for a library
nothing is left, however the process ends.
"""

from __future__ import annotations

import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
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


_OPEN_FILES = Path("/proc/self/fd")


@contextmanager
def unnamed_file(content: bytes, *, suffix: str) -> Iterator[Path]:
    """A path to a file with some content while the block lasts; where the system can, it has no name in any folder.

    Args:
        content: Of the file.
        suffix: Of its name, where it needs one.
    """
    make = tempfile.TemporaryFile if _OPEN_FILES.is_dir() else tempfile.NamedTemporaryFile
    with make(suffix=suffix) as file:
        file.write(content)
        file.flush()
        yield _OPEN_FILES / str(file.fileno()) if _OPEN_FILES.is_dir() else Path(file.name)
