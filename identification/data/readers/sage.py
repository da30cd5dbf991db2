"""Reads the files in the folder of SAGE's ``state_motor.csv``: references (``control.csv``) and joint names."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from identification.data.readers.delimited import read_delimited
from identification.data.readers.references import with_references
from identification.data.recording import RawTable
from phantom_dyn.errors import LogError
from phantom_dyn.model.files.plain_file import require_plain_file

_CONTROL, _JOINTS = "control.csv", "joint_list.txt"
_LARGEST = 1_000_000
"""Largest size of the list of joints [bytes]: a thousand times the size for a humanoid."""


def with_neighbours(path: Path, raw: RawTable) -> RawTable:
    """The states of a motion, with joint names and references (``control[0]``, ...) from the files in the same folder.

    Args:
        path: The file ``state_motor.csv``.
        raw: Columns of this file.

    Raises:
        LogError: If a file beside it cannot be used.
    """
    names = _joint_names(path.parent / _JOINTS)
    control = path.parent / _CONTROL
    if control.exists() and control != path and "timestamp" in raw.columns:
        require_plain_file(control, LogError, "SAGE's control.csv")
        commands = read_delimited(control)
        places = [name for name in commands.columns if name.startswith("positions[")]
        if "timestamp" not in commands.columns or not places:
            raise LogError(f"{control} has no columns timestamp and positions, so it is no control.csv of SAGE.")
        columns = {f"control{name.removeprefix('positions')}": commands.columns[name] for name in places}
        timed = replace(raw, columns={**raw.columns, "t": raw.columns["timestamp"]})
        found = with_references(timed, _CONTROL, commands.columns["timestamp"], columns)
        raw = replace(found, columns={name: values for name, values in found.columns.items() if name != "t"})
    return replace(raw, joint_names=names)


def _joint_names(path: Path) -> tuple[str, ...]:
    """Names in SAGE's list of joints, separated by lines or commas; empty without such a file."""
    if not path.exists():
        return ()
    require_plain_file(path, LogError, "SAGE's joint_list.txt")
    if path.stat().st_size > _LARGEST:
        raise LogError(f"{path} has {path.stat().st_size / 1e6:.0f} MB, wanted the names of the joints: move it.")
    text = path.read_text(encoding="utf-8", errors="replace")
    return tuple(name for name in text.replace(",", "\n").split() if name)
