"""Checks that a path is an ordinary file, and makes temporary files for libraries that can only read from a path.

Pipes and devices are refused, because reading them may never end. A temporary file is removed even if the process is
killed.
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
        path: The path that was given. A missing file is accepted here: opening it raises an error.
        error: Type of the error to raise.
        wanted: Kind of file that is wanted, with an article, for the message.

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
    """Path of a temporary file while the context is open; on Linux the file has no name in any folder.

    Args:
        content: Content of the file.
        suffix: End of the name on other systems.
    """
    make = tempfile.TemporaryFile if _OPEN_FILES.is_dir() else tempfile.NamedTemporaryFile
    with make(suffix=suffix) as file:
        file.write(content)
        file.flush()
        yield _OPEN_FILES / str(file.fileno()) if _OPEN_FILES.is_dir() else Path(file.name)
