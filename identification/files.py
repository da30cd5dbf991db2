"""Writing files so that a reader never sees half of one: under a temporary name, then renamed."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from phantom_dyn.errors import UsageError


@contextmanager
def temporary_beside(path: str | Path) -> Iterator[Path]:
    """A path to write to, in the folder of ``path``, that becomes ``path`` when the block ends without an error.

    It keeps the suffix of ``path``, for libraries that choose the format by it. Missing folders are made. After
    an error nothing is left, and an older file at ``path`` is as it was.

    Args:
        path: The file that is wanted in the end.

    Yields:
        Path of an empty file in the same folder.

    Raises:
        UsageError: If the file cannot be written there.
    """
    target = Path(path)
    temporary = _empty_file_beside(target)
    try:
        yield temporary
        _check_not_folder(target)
        temporary.replace(target)
    except OSError as error:
        raise UsageError(_refusal(target, error)) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_atomically(path: str | Path, content: bytes | str) -> None:
    """Write ``content`` to ``path`` in one step; text is written as UTF-8 with the line ends that it has.

    Raises:
        UsageError: If the file cannot be written there.
    """
    data = content.encode() if isinstance(content, str) else content
    with temporary_beside(path) as temporary:
        temporary.write_bytes(data)


def _empty_file_beside(target: Path) -> Path:
    """A new empty file in the folder of ``target``, with the rights that any new file gets."""
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        _check_not_folder(target)
        temporary.touch(exist_ok=False)
    except OSError as error:
        raise UsageError(_refusal(target, error)) from error
    return temporary


def _check_not_folder(target: Path) -> None:
    if target.is_dir():
        raise IsADirectoryError(None, "it is a folder")


def _refusal(target: Path, error: OSError) -> str:
    reason = (error.strerror or str(error)).lower()
    return f"cannot write {target}: {reason}; name a file in a folder that you may write to"
