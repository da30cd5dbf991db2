"""A file for a library that reads paths alone, of which nothing is left however the process ends."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
