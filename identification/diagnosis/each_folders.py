"""Which recordings are meant, and which folder each gets for its files."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from identification.diagnosis.outputs import check_targets
from identification.readers import require_existing
from phantom_dyn.errors import LogError, UsageError

TABLES = ("diagnoses.json", "diagnoses.csv")
"""Files beside the folders: one row a recording."""
ENDINGS = (".csv", ".npz", ".parquet", ".bag", ".db3", ".mcap")
"""What a recording in a folder ends in; a file that is named may end in anything."""
_BAG = "metadata.yaml"


def logs_in(path: str) -> list[str]:
    """The recordings of a folder by name, those of its folders left out; of a file or a ROS 2 bag the path itself.

    Raises:
        LogError: If there is no recording in the folder.
    """
    folder = Path(path)
    if not folder.is_dir() or (folder / _BAG).exists():
        return [path]
    found = [entry for entry in sorted(folder.iterdir()) if _is_log(entry)]
    if not found:
        raise LogError(
            f"{path} holds no recording: wanted files that end in {', '.join(ENDINGS)}, or ROS 2 bags; name another "
            "folder, or the files themselves."
        )
    return [str(entry) for entry in found]


def _is_log(entry: Path) -> bool:
    if entry.is_dir():
        return (entry / _BAG).exists()
    return entry.suffix.lower() in ENDINGS and entry.name not in TABLES and not entry.name.startswith(".")


def require_logs(logs: Sequence[str | Path]) -> tuple[Path, ...]:
    """Full paths of recordings.

    Raises:
        LogError: If there is none, or one is not there or given twice.
    """
    if isinstance(logs, str | Path) or not logs:
        raise LogError(f"{logs!r} was given, wanted a list of at least one recording: give the paths of files.")
    seen: dict[Path, None] = {}
    for log in logs:
        require_existing(log)
        # Several files that mean one, by links or dots, would write into the same folder or count twice.
        if Path(log).resolve() in seen:
            raise LogError(f"{log} is given twice: give every recording once.")
        seen[Path(log).resolve()] = None
    return tuple(Path(os.path.abspath(log)) for log in logs)  # noqa: PTH100  pathlib keeps the dots of a/../b


def folder_names(paths: Sequence[Path]) -> tuple[str, ...]:
    """A name for each recording's folder: its own without the ending, longer where that names several.

    Args:
        paths: Full paths, each once.

    Returns:
        Names that differ, also where capitals count for nothing: ``run``, else ``run.csv``, else ``monday_run.csv``
        and so on, else with a number.
    """
    lengths = [0] * len(paths)
    longest = max(len(path.parts) for path in paths)
    while True:
        names = [_name(path, length) for path, length in zip(paths, lengths, strict=True)]
        count = Counter([*(name.lower() for name in names), *TABLES])
        twice = [place for place, name in enumerate(names) if count[name.lower()] > 1]
        if not twice:
            return tuple(names)
        if max(lengths[place] for place in twice) > longest:
            return tuple(f"{name}_{place + 1}" if place in twice else name for place, name in enumerate(names))
        for place in twice:
            lengths[place] += 1


def _name(path: Path, length: int) -> str:
    if length == 0 and not path.is_dir():
        return path.stem
    parts = path.parts[1:]
    return "_".join(parts[-max(length, 1) :])


def check_folders(out: Path, names: Sequence[str]) -> None:
    """Refuse a folder for the files that cannot be written, before any work is done.

    Raises:
        UsageError: If a target is of the wrong kind or its folder may not be written to.
    """
    check_targets(out, None)
    for name in names:
        check_targets(out / name, None)
    for table in TABLES:
        if (out / table).is_dir():
            raise UsageError(f"--out: {out / table} is a folder, wanted a file; remove it or name another place")
