"""Checks of the paths that a user gives, and atomic writing of files.

Nothing here imports a large library, so that a command can refuse a wrong path at once.
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import secrets
import shutil
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path

from phantom_dyn.errors import LogError, UsageError, nearest, shortened
from phantom_dyn.model.robot_files import looks_like_robot

LOG_ENDINGS = (".csv", ".npz", ".parquet")
"""Endings of the formats that a log is written in."""
_BAG_ENDINGS = (".bag", ".db3", ".mcap")
MARK = ".phantom-dyn"
"""Part of the names of temporary files and folders. A later run finds the leftovers of a killed run by this part."""
_LONGEST_WAIT_S = 30.0
"""Longest wait for a locked folder [s]: a run writes its files in less than a second."""
LOG_FORMATS = "CSV, NPZ, Parquet, a ROS 1 or ROS 2 bag (.bag, .db3 or its folder), MCAP or a LeRobot folder"
"""Formats of a recording that can be read, in words for messages."""

LEROBOT_INFO = Path("meta", "info.json")
"""File by which a LeRobot dataset is recognised."""
EPISODE = "episode_{:06d}"
"""Name that stands for one episode of a LeRobot dataset in a path below its folder; such a file need not exist."""


def is_lerobot(path: Path) -> bool:
    """True for the folder of a LeRobot dataset."""
    return (path / LEROBOT_INFO).is_file()


def lerobot_episode(path: Path) -> tuple[Path, int] | None:
    """Dataset folder and number of the episode that a path names, None for other paths.

    The path is ``dataset/episode_3``, or the file of an episode in a dataset of version 2.1.
    """
    found = re.fullmatch(r"episode_(\d{1,7})(\.parquet)?", path.name)
    if found is None:
        return None
    folder = path.parent.parent.parent if found.group(2) else path.parent
    return (folder, int(found.group(1))) if is_lerobot(folder) else None


def require_existing(path: str | Path) -> None:
    """Refuse a log that does not exist; the message names the most similar file in its folder.

    Raises:
        LogError: If the file or folder does not exist.
    """
    path = Path(path)
    if path.exists() or lerobot_episode(path) is not None:
        return
    if path.is_symlink():
        raise LogError(f"{path} is a link that leads to no file ({path.readlink()}): name the file itself.")
    folder = path.parent
    if not folder.is_dir():
        raise LogError(f"{path} does not exist, nor does its folder: give a log ({LOG_FORMATS}).")
    guess = nearest(path.name, sorted(entry.name for entry in folder.iterdir()))
    meant = f"; did you mean {guess}?" if guess else f": give a log ({LOG_FORMATS})."
    raise LogError(f"{path} does not exist{meant}")


def require_ending(path: Path) -> None:
    """Refuse to write a log to a path whose ending is not one of `LOG_ENDINGS`.

    Raises:
        UsageError: The sentence names the endings.
    """
    if path.suffix.lower() not in LOG_ENDINGS:
        raise UsageError(
            f"{path} ends in {path.suffix or 'nothing'}, wanted a log that ends in {', '.join(LOG_ENDINGS)}"
        )


def require_writable(path: Path, option: str) -> None:
    """Refuse a file that cannot be written, before any work is done; nothing is created.

    Raises:
        UsageError: If the path is a folder, a device or a pipe, if one of its parents is a file, or if the folder is
            not writable.
    """
    if path.is_dir():
        raise UsageError(f"{option}: {path} is a folder, wanted a file; remove it or name another place")
    if path.exists() and not path.is_file():
        raise UsageError(f"{option}: {path} is a device or pipe, wanted a file; name a file")
    folder = next(parent for parent in path.absolute().parents if parent.exists())
    if not folder.is_dir():
        raise UsageError(f"{option}: cannot write {path}: {folder} is no folder; name a file in another place")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise UsageError(f"{option}: cannot write {path}: no right to write in {folder}; name another place")


def require_writable_folder(folder: Path, names: Iterable[str]) -> None:
    """Refuse an output folder that cannot be written to, before any work is done; nothing is created.

    Raises:
        UsageError: If ``folder`` is a file, or one of the files cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"--out {folder} is a file, wanted a folder; name another folder")
    for name in names:
        require_writable(folder / name, "--out")


def require_not_read(read: Iterable[str | Path | None], written: Iterable[Path]) -> None:
    """Refuse to write over an input file, such as a recording that is also given as the output file of ``--json``.

    Args:
        read: Input files; None and names that are not files are ignored.
        written: Files that would be written.

    Raises:
        UsageError: The sentence names the file.
    """
    given = [Path(path) for path in read if path is not None and Path(path).is_file()]
    for target in written:
        if target.is_file() and any(target.samefile(path) for path in given):
            raise UsageError(f"{target} is read, and would be written over: name another place for what is written")


_MARKS = re.compile(rb"phantom[-_]dyn|gap-diagnos[ie]s/|\brun\"?: \"?[0-9a-f]{32}\b|,run\r?\n", re.IGNORECASE)
"""Marks of files that phantom-dyn wrote: the name of the program or of a schema, or the id of a run."""
_HEAD, _TAIL = 1_000_000, 10_000
"""Numbers of bytes at the start and at the end of a file that are searched for a mark."""


def require_own(folder: Path, names: Iterable[str], *, index: str, unmarked: Sequence[str] = ()) -> None:
    """Refuse to write over, or to remove, a file that phantom-dyn did not write, before any work is done.

    Args:
        folder: Folder of the files.
        names: Names of the files; an empty file is never refused.
        index: Name of the file whose mark shows that phantom-dyn wrote the files in ``unmarked``.
        unmarked: Files whose format has no place for a mark.

    Raises:
        UsageError: The sentence names the file.
    """
    for name in names:
        path = folder / (index if name in unmarked and (folder / index).is_file() else name)
        if (folder / name).is_file() and not _is_own(path):
            raise UsageError(
                f"{folder / name} was not written by phantom-dyn, and would be written over or removed: name another "
                "folder, or move it away"
            )


def require_own_file(path: Path, option: str) -> None:
    """Refuse to write over a file that phantom-dyn did not write, before any work is done.

    Raises:
        UsageError: The sentence names the file and the option that it was given with.
    """
    if path.is_file() and not _is_own(path):
        raise UsageError(
            f"{option}: {path} was not written by phantom-dyn, and would be written over: name another file, or move "
            "it away"
        )


def require_new_log(path: Path, option: str) -> None:
    """Refuse to write a log over any file that is not empty: a log has no mark that says who wrote it.

    Raises:
        UsageError: The sentence names the file and the option that it was given with.
    """
    if path.is_file() and path.stat().st_size:
        raise UsageError(
            f"{option}: {path} exists, and may be a recording of yours, as a log does not say who wrote it: name "
            "another file, or remove this one"
        )


def _is_own(path: Path) -> bool:
    """True for an empty file, and for a file with one of the marks of phantom-dyn near its start or end."""
    try:
        with path.open("rb") as file:
            text = file.read(_HEAD)
            if path.stat().st_size > _HEAD:
                file.seek(-_TAIL, os.SEEK_END)
                text += file.read()
    except OSError:
        return False
    return not text.strip() or _MARKS.search(text) is not None


@contextmanager
def temporary_beside(path: str | Path) -> Iterator[Path]:
    """A temporary path in the folder of ``path``, which is renamed to ``path`` when the block ends without an error.

    The temporary path has the suffix of ``path``, because some libraries choose the format by the suffix. Missing
    folders are created. After an error the temporary file and these folders are removed, and an older file at ``path``
    is unchanged. Temporary files that a killed process has left for the same ``path`` are removed too.

    Args:
        path: The file to be written.

    Yields:
        Path of an empty file in the same folder.

    Raises:
        UsageError: If the file cannot be written there.
    """
    target = Path(path)
    missing = [folder for folder in target.absolute().parents if not folder.exists()]
    try:
        with locked_when_made(lambda: _empty_file_beside(target)) as temporary:
            try:
                yield temporary
                _check_replaceable(target)
                temporary.replace(target)
            finally:
                temporary.unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(refused_write(target, error)) from error
    finally:
        # Only empty folders are removed: the system refuses to remove a folder that holds the new file.
        for folder in missing:
            with suppress(OSError):
                folder.rmdir()


def write_atomically(path: str | Path, content: bytes | str) -> None:
    """Write ``content`` to ``path`` in one step; text is written as UTF-8, and its line ends are not changed.

    Raises:
        UsageError: If the file cannot be written there.
    """
    data = content.encode("utf-8", "backslashreplace") if isinstance(content, str) else content
    with temporary_beside(path) as temporary:
        temporary.write_bytes(data)


def _empty_file_beside(target: Path) -> Path:
    """A new empty file in the folder of ``target``, with the access rights of any new file."""
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(4)}{MARK}{target.suffix}")
    target.parent.mkdir(parents=True, exist_ok=True)
    _check_replaceable(target)
    for left in target.parent.glob(f".{escape(target.stem)}.*{MARK}{escape(target.suffix)}"):
        remove_unless_locked(left)
    temporary.touch(exist_ok=False)
    return temporary


@contextmanager
def locked_when_made(make: Callable[[], Path]) -> Iterator[Path]:
    """A new file or folder, locked by this process; the system releases the lock when the process ends in any way.

    Args:
        make: Creates the file or folder, at a new path in each call. The function is called again if another run has
            taken the file or folder for a leftover and removed it before it was locked.
    """
    while True:
        place = make()
        descriptor = _locked(place)
        if descriptor is not None:
            break
    try:
        yield place
    finally:
        os.close(descriptor)


def _locked(place: Path) -> int | None:
    """An open descriptor that locks a file or folder; None if another run has removed it first."""
    try:
        descriptor = os.open(place, os.O_RDONLY)
    except FileNotFoundError:
        return None
    # On a file system without locks a later run removes the file as a leftover.
    with suppress(OSError):
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    if place.exists():
        return descriptor
    os.close(descriptor)
    return None


def remove_unless_locked(place: Path) -> None:
    """Remove a file or folder that a killed run has left, unless a running process has locked it."""
    try:
        descriptor = os.open(place, os.O_RDONLY)
    except OSError:
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # The lock is kept during the removal: a run that has just created the file waits for the lock, then finds that
        # the file does not exist, and creates another one.
        if place.is_dir():
            shutil.rmtree(place, ignore_errors=True)
        else:
            place.unlink(missing_ok=True)
    except OSError:
        return
    finally:
        os.close(descriptor)


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """A context in which no other run writes a set of files into a folder; it first waits for runs that are writing.

    Its parent folder is locked, because the folder itself may be exchanged for another one meanwhile.
    """
    try:
        descriptor = os.open(folder.parent, os.O_RDONLY)
    except OSError:  # the parent may be entered but not read
        yield
        return
    try:
        until = time.monotonic() + _LONGEST_WAIT_S
        while not _locked_if_possible(descriptor) and time.monotonic() < until:
            time.sleep(0.01)
        yield
    finally:
        os.close(descriptor)


def _locked_if_possible(descriptor: int) -> bool:
    """True if this run has locked the folder now, or if its file system has no locks."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in (errno.EWOULDBLOCK, errno.EACCES)
    return True


def _check_replaceable(target: Path) -> None:
    """Raise an error if the target is a folder, a device or a pipe."""
    if target.is_dir():
        raise IsADirectoryError(None, "it is a folder")
    # Root could replace a device by a plain file.
    if target.exists() and not target.is_file():
        raise FileExistsError(None, "it is a device or pipe")


def refused_write(target: Path, error: OSError) -> str:
    """Message on a file or folder that cannot be written."""
    reason = (error.strerror or str(error)).lower()
    return f"cannot write {target}: {reason}; name a file in a folder that you may write to"


def looks_like_log(word: str | Path) -> bool:
    """True for a path with the ending of a recording."""
    return str(word).lower().rstrip("/").endswith((*LOG_ENDINGS, *_BAG_ENDINGS))


def require_not_swapped(robot: str | Path, logs: Sequence[str | Path]) -> None:
    """Refuse a recording that was given as the robot.

    Raises:
        UsageError: If the robot looks like a recording. If one of ``logs`` looks like a robot, the message shows the
            right order.
    """
    if not looks_like_log(robot) or looks_like_robot(str(robot)):
        return
    meant = next((log for log in logs if looks_like_robot(str(log))), None)
    if meant is not None:
        raise UsageError(f"{robot} is a recording and {meant} a robot: give the robot first, as in {meant} {robot}")
    raise UsageError(
        f"{robot} was given as the robot and looks like a recording: give the robot first (URDF, MJCF, example:NAME or "
        "a built-in name), then the recordings"
    )


def is_disk_full(error: BaseException) -> bool:
    """True if an error says that a disk or quota is full, or that a file has reached the largest allowed size."""
    return isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)


def unreachable_words(error: OSError) -> str | None:
    """One sentence with advice on a file that cannot be accessed; None for an error that names no file."""
    if error.errno is None or not isinstance(error.filename, str | bytes):
        return None
    place = shortened(os.fsdecode(error.filename), 200)
    reason = (error.strerror or os.strerror(error.errno)).lower()
    if error.errno == errno.ENAMETOOLONG:
        return f"{place} cannot be a file ({reason}): write a shorter one"
    return f"{place} cannot be reached ({reason}): name another place, or give yourself the right to enter this one"


def disk_full_words(error: OSError) -> str:
    """One sentence with advice on an error for which `is_disk_full` is true."""
    reason = (error.strerror or str(error)).lower()
    return f"nothing more can be written ({reason}): free some space, or name a place with more, TMPDIR included"
