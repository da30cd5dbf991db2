"""Atomic writing of several files: a folder holds the old set of files or the new one, even if the process is killed.

1. The files are written into a hidden folder next to the target folder.
2. All other files of the target folder are hard-linked into the hidden folder.
3. One system call exchanges the two folders.

The exchange is impossible if the target contains folders, if a process works in the target, if the target's parent has
no write access, or if the system has no such call. The files are then renamed one by one, the main file last. Runs that
write into one folder at the same time wait for each other. Every text ends with the id of its run, so that a mixture of
two runs can be recognised.
"""

from __future__ import annotations

import ctypes
import os
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from identification.files import (
    MARK,
    locked_folder,
    locked_when_made,
    refused_write,
    remove_unless_locked,
    temporary_beside,
)
from phantom_dyn.errors import UsageError

_HERE, _EXCHANGE = -100, 2  # AT_FDCWD and RENAME_EXCHANGE for renameat2, from Linux headers
_RUN_LINES = {".yaml": "# run: {}", ".py": "# run: {}", ".urdf": "<!-- run: {} -->", ".xml": "<!-- run: {} -->"}
_RUN_LINES[".html"] = _RUN_LINES[".xml"]


def with_run(name: str, text: str, run: str) -> str:
    """The text of a file with the id of its run in a last line, if its format has comments."""
    line = _RUN_LINES.get(Path(name).suffix)
    if line is None or not run:
        return text
    return f"{text}{'' if text.endswith(chr(10)) else chr(10)}{line.format(run)}\n"


def write_together(folder: Path, texts: Mapping[str, str], *, obsolete: Iterable[str] = ()) -> tuple[Path, ...]:
    """Write files into a folder in one step, and remove those of an earlier set.

    Args:
        folder: Target folder; it is made if it is missing, and other files in it are kept.
        texts: Text of each file by its name, the main file last (such as ``diagnosis.json``).
        obsolete: Names of files of earlier sets, which are removed.

    Returns:
        The files, in the order of ``texts``.

    Raises:
        UsageError: If a file cannot be written; then none has changed.
    """
    target = folder.resolve()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        ours = {*texts, *obsolete}
        with locked_folder(target):
            _sweep(target)
            if not _written_and_exchanged(target, texts, ours):
                _written_one_by_one(target, texts, ours)
    except OSError as error:
        raise UsageError(refused_write(folder, error)) from error
    return tuple(folder / name for name in texts)


@contextmanager
def renamed_together(folder: Path) -> Iterator[Callable[[Path], Path]]:
    """A function that returns a temporary path for each file; all files are renamed when the context ends.

    Ask for the path of a file just before you write it: an error names the file whose path was asked for last.

    Args:
        folder: Folder of the files; two runs that write into it rename their files one after the other.

    Raises:
        UsageError: If a file cannot be written; then none of them is.
    """
    with ExitStack() as renamed:
        yield lambda path: renamed.enter_context(temporary_beside(path))
        with locked_folder(folder.resolve()):
            renamed.close()


def _written_and_exchanged(target: Path, texts: Mapping[str, str], ours: set[str]) -> bool:
    """Write the files into a new folder and exchange it with the target; False if that is impossible."""
    if not os.access(target.parent, os.W_OK | os.X_OK) or (target.exists() and _works_inside(target)):
        return False
    with _staging(target.parent, target.name) as staging:
        _write_all(staging, texts)
        if not target.exists():
            with suppress(OSError):  # another run may have made the folder since
                staging.rename(target)
                return True
        if not _kept_files_linked(target, staging, ours) or not _exchanged(staging, target):
            return False
        # After the exchange `staging` is the old folder. Files that another program has made there since step 2 are
        # moved to the new folder.
        for late in [entry for entry in staging.iterdir() if entry.name not in ours]:
            if not os.path.lexists(target / late.name):
                late.rename(target / late.name)
        return True


def _written_one_by_one(target: Path, texts: Mapping[str, str], ours: set[str]) -> None:
    """Write the files into a hidden folder in the target, then rename them one by one."""
    target.mkdir(exist_ok=True)
    with _staging(target, "") as staging:
        _write_all(staging, texts)
        for name in texts:
            if (target / name).is_dir():
                raise IsADirectoryError(None, f"{name} is a folder")
        for name in ours - set(texts):
            (target / name).unlink(missing_ok=True)
        for name in texts:
            (staging / name).replace(target / name)


def _write_all(folder: Path, texts: Mapping[str, str]) -> None:
    for name, text in texts.items():
        # File names in a text may hold bytes that are not UTF-8; they are written as escapes.
        (folder / name).write_bytes(text.encode("utf-8", "backslashreplace"))


@contextmanager
def _staging(parent: Path, name: str) -> Iterator[Path]:
    """An empty hidden folder, which is locked while the context is open and removed afterwards."""

    def made() -> Path:
        folder = parent / f".{name}.{secrets.token_hex(4)}{MARK}"
        folder.mkdir()
        return folder

    with locked_when_made(made) as folder:
        try:
            yield folder
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _sweep(target: Path) -> None:
    """Remove temporary files and folders of killed runs, next to the folder and in it."""
    remains = [
        entry
        for entry in target.parent.iterdir()
        if entry.name.startswith(f".{target.name}.") and entry.name.endswith(MARK) and entry.is_dir()
    ]
    if target.is_dir():
        remains += [entry for entry in target.iterdir() if entry.name.startswith(".") and MARK in entry.name]
    for entry in remains:
        remove_unless_locked(entry)


def _kept_files_linked(target: Path, staging: Path, ours: set[str]) -> bool:
    """Hard-link all files except ``ours`` into the new folder, and copy the folder's owner and mode.

    Returns:
        False if that fails, or if the folder contains anything but files.
    """
    with os.scandir(target) as found:
        entries = list(found)
    for entry in entries:
        if entry.name in ours:
            if entry.is_dir(follow_symlinks=False):
                return False
            continue
        if not (entry.is_file(follow_symlinks=False) or entry.is_symlink()):
            return False
        try:
            os.link(entry.path, staging / entry.name, follow_symlinks=False)
        except OSError:
            return False
    try:
        old = target.stat()
        if (old.st_uid, old.st_gid) != (staging.stat().st_uid, staging.stat().st_gid):
            os.chown(staging, old.st_uid, old.st_gid)
        shutil.copystat(target, staging)
    except OSError:
        return False
    return True


def _exchanged(one: Path, other: Path) -> bool:
    """Exchange two folders in one system call; False if the system has no such call, or it fails."""
    exchange = getattr(ctypes.CDLL(None), "renameat2", None)
    return exchange is not None and exchange(_HERE, os.fsencode(one), _HERE, os.fsencode(other), _EXCHANGE) == 0


def _works_inside(folder: Path) -> bool:
    """True if the folder is the working folder of a process; after an exchange a shell would stay in the old folder."""
    places = [Path("/proc/self/cwd"), *Path("/proc").glob("[0-9]*/cwd")]
    for place in places:
        with suppress(OSError):
            if place.samefile(folder):
                return True
    return False
