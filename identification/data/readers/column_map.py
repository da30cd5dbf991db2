"""Reads column maps: YAML files that state the standard name, unit and sign of each column of a log.

```yaml
t: {from: time_ms, unit: ms}
q.j1: {from: enc1, counts: 8192}     # counts per revolution of the joint
q.j2: {from: enc2, unit: deg, offset: -90}  # added after unit, sign and gear: the log's zero is not the model's
tau.j1: {from: load1, unit: Nmm, sign: -1}
v: {from: "vel_{joint}", unit: deg/s}  # every column vel_<joint>
x: "enc[{number}]"                   # enc[0], enc[1], ...: the joints in the robot's order
tau.j2: {from: load2, gear: 100}     # on the motor's side of a gear of 100
tau: {compensated: gravity}          # a controller subtracted gravity from the torques: the model's is added
tau.j3: {compensated: [gravity, friction]}  # gravity and friction of one joint
tau.j4: {low_pass: 20}               # the torque went through a first-order low pass at 20 Hz, which is inverted
tau.j5: {late: 0.01}                 # the torque was recorded 0.01 s late, which is taken back
rate: 100                            # rows per second [Hz], for a log without a column of time
ignore: [q.gripper]                  # columns that are left out
```
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from identification.data.readers.contract_columns import JOINT_QUANTITIES, column_of
from identification.data.readers.map_source import (
    COMPENSATED,
    JOINT,
    LARGEST_NUMBER,
    LATE,
    LOW_PASS,
    NUMBER,
    SMALLEST,
    Source,
    source_of,
)
from identification.data.readers.numbered_joints import joints_of_numbers
from identification.data.recording import RawTable
from phantom_dyn.array_types import Array
from phantom_dyn.errors import LogError, known_names, shortened
from phantom_dyn.model.files.settings_file import describe, read_settings

Read = TypeVar("Read")

# Parts of a torque that a controller may have subtracted.
_PARTS = ("gravity", "friction")
# Example of the value of each key that only torques may have.
_EXAMPLES = {COMPENSATED: _PARTS[0], LOW_PASS: "20", LATE: "0.01"}
WHOLE_KEYS = ("rate", "ignore")
"""Keys of a map that are not columns."""


@dataclass(frozen=True)
class ColumnMap:
    """A column map after validation.

    Attributes:
        file: Name of the map, for messages.
        sources: Sources by standard name, or by quantity alone if the source has a ``{joint}`` or ``{number}``.
        ignored: Columns of the log to leave out.
        compensated: For each joint, or ``""`` for all, the parts that a controller subtracted from its torque.
        low_pass: For each joint, or ``""`` for all, the cut-off of the low pass on its torque [Hz].
        rate: Rows per second of a log without a column of time [Hz]; None if it has one.
        late: For each joint, or ``""`` for all, the time by which its torque was recorded late [s].
    """

    file: str
    sources: Mapping[str, Source]
    ignored: tuple[str, ...] = ()
    compensated: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    low_pass: Mapping[str, float] = field(default_factory=dict)
    rate: float | None = None
    late: Mapping[str, float] = field(default_factory=dict)


def read_column_map(path: str | Path) -> ColumnMap:
    """Read a column map from a YAML file; the module's docstring shows its form.

    Args:
        path: The file.

    Raises:
        LogError: If it cannot be read, or a key, unit, sign or count is not valid; one sentence says which.
    """
    path = Path(path)
    content = read_settings(path, LogError)
    ignored = content.pop("ignore", [])
    if not isinstance(ignored, list) or not all(isinstance(name, str) for name in ignored):
        raise LogError(f"{path.name}: ignore is {describe(ignored)}, wanted a list of column names.")
    rate = _rate(path.name, content.pop("rate", None), content)
    if not content and not ignored and rate is None:
        raise LogError(f"{path.name} is empty: a column map needs entries such as t: TIME_COLUMN.")
    entries = {str(key): value for key, value in content.items()}
    entries, compensated = _split_off(path.name, entries, COMPENSATED, _compensated_parts)
    entries, low_pass = _split_off(path.name, entries, LOW_PASS, partial(_number, "the cut-off in Hz"))
    entries, late = _split_off(path.name, entries, LATE, partial(_number, "the time by which it is late [s]"))
    sources = {key: source_of(path.name, key, value) for key, value in entries.items() if value != {}}
    _require_own_columns(path.name, sources)
    return ColumnMap(path.name, sources, tuple(ignored), compensated, low_pass, rate, late)


def _require_own_columns(file: str, sources: Mapping[str, Source]) -> None:
    """Raise an error if two entries take the same column.

    Entries of the same quantity may share a column, except torques and currents.
    """
    first: dict[str, str] = {}
    for key, source in sources.items():
        quantity = key.partition(".")[0]
        other = first.setdefault(source.name, key)
        if other != key and (quantity in ("tau", "i") or other.partition(".")[0] != quantity):
            raise LogError(
                f"{file}: {shortened(other)} and {shortened(key)} are both from {shortened(source.name)!r}: give each "
                "the column that it was recorded in, or leave one of them out."
            )


def _rate(file: str, given: Any, content: Mapping[Any, Any]) -> float | None:
    """Rows per second that a map states [Hz]; None if it states none."""
    if given is None:
        return None
    if not isinstance(given, int | float) or isinstance(given, bool) or not SMALLEST <= given <= LARGEST_NUMBER:
        raise LogError(f"{file}: rate is {describe(given)}, wanted the rows a second of a log without time [Hz].")
    if "t" in content:
        raise LogError(f"{file}: both rate and t are given: leave rate out where the log has a time.")
    return float(given)


def require_joints(columns: ColumnMap, joints: Sequence[str]) -> None:
    """Raise an error if an entry names a joint that the robot does not have; temperatures may be of other parts.

    Args:
        columns: A map that a user wrote.
        joints: All joints of the robot: active, passive and locked ones.

    Raises:
        LogError: The message lists the joints and suggests the nearest one.
    """
    for key in columns.sources:
        column = column_of(key)
        if column is None or column.quantity not in JOINT_QUANTITIES or column.quantity == "temp":
            continue
        if column.of not in joints:
            raise LogError(
                f"{columns.file}: {shortened(key)} is of the joint {shortened(column.of)}, which the robot does not "
                f"have: {known_names(column.of, joints, 'joints')}"
            )


def _split_off(
    file: str, entries: Mapping[str, Any], name: str, read: Callable[[str, Any], Read]
) -> tuple[dict[str, Any], dict[str, Read]]:
    """The entries without their key ``name``, which only torques may have, and the values of this key by joint.

    Args:
        file: Name of the map, for messages.
        entries: Entries of the map.
        name: ``compensated``, ``low_pass`` or ``late``.
        read: Function that checks a value; its first argument says where the value is.

    Returns:
        The entries, and the values; the joint ``""`` means all joints.
    """
    out, values = dict(entries), {}
    for key, entry in entries.items():
        if not isinstance(entry, dict) or name not in entry:
            continue
        where = f"{file}: {shortened(key)}.{name}"
        quantity, _, joint = key.partition(".")
        if quantity != "tau":
            raise LogError(f"{where} is for torques: write tau: {{{name}: {_EXAMPLES[name]}}}, or tau.<joint>.")
        out[key] = {other: value for other, value in entry.items() if other != name}
        values[joint] = read(where, entry[name])
    return out, values


def _compensated_parts(where: str, given: Any) -> tuple[str, ...]:
    """The parts that a key ``compensated`` lists."""
    parts = given if isinstance(given, list) else [given]
    if not parts or any(part not in _PARTS for part in parts):
        raise LogError(f"{where} is {describe(given)}, wanted {' or '.join(_PARTS)}, or [{', '.join(_PARTS)}].")
    return tuple(dict.fromkeys(parts))


def _number(meaning: str, where: str, given: Any) -> float:
    """The number of a key ``low_pass`` or ``late``; ``meaning`` says in a message what is wanted."""
    if not isinstance(given, int | float) or isinstance(given, bool) or not SMALLEST <= given <= LARGEST_NUMBER:
        raise LogError(f"{where} is {describe(given)}, wanted {meaning}, above 0 (1e-6 to 1e12).")
    return float(given)


def _times(raw: RawTable, columns: ColumnMap, rate: float, out: Mapping[str, Array]) -> Array:
    """Times of the rows [s], from the rate that a map states."""
    if "t" in raw.names and "t" not in columns.ignored:
        raise LogError(
            f"{columns.file}: rate is given, but {raw.file} has a column t: leave rate out, or add ignore: [t]."
        )
    return np.arange(len(next(iter(out.values()), ()))) / rate


def matching(name: str, names: Sequence[str]) -> dict[str, str]:
    """Columns that match a name with the placeholder ``{joint}`` or ``{number}``, by the text in its place.

    For example, ``vel_{joint}`` matches ``vel_a`` and ``vel_b``, with the texts ``a`` and ``b``.
    """
    place, inside = (NUMBER, "([0-9]{1,4})") if NUMBER in name else (JOINT, "(.+)")
    before, after = name.split(place)
    pattern = re.compile(re.escape(before) + inside + re.escape(after))
    return {m.group(1): m.group(0) for column in names if (m := pattern.fullmatch(column))}


def _expanded(
    columns: ColumnMap, raw: RawTable, joints: Sequence[str] | None
) -> tuple[dict[str, Source], tuple[str, ...]]:
    """Source of each standard column, and warnings on numbered joints.

    An entry for all joints becomes one source per joint. An entry for a single joint has priority.
    """
    out: dict[str, Source] = {}
    numbered: dict[str, dict[int, str]] = {}
    for key, source in columns.sources.items():
        if column_of(key) is not None:
            continue
        found = matching(source.name, raw.names)
        if not found:
            raise LogError(
                f"{columns.file}: {key} takes {shortened(source.name)}, but no column of {raw.file} looks so: "
                f"{known_names(source.name, raw.names, 'columns')}"
            )
        if NUMBER in source.name:
            numbered[key] = {int(number): name for number, name in found.items()}
        else:
            out |= {f"{key}.{joint}": replace(source, name=name) for joint, name in found.items()}
    warnings: tuple[str, ...] = ()
    if numbered:
        positions = numbered.get("q") or next(iter(numbered.values()))
        joint_of_number, warnings = joints_of_numbers(raw, positions, joints)
        for key, found in numbered.items():
            unknown = sorted(set(found) - set(positions))
            if unknown:
                raise LogError(
                    f"{columns.file}: {raw.file} has {shortened(found[unknown[0]])}, and no position has that number: "
                    "say in the map which column belongs to which joint."
                )
            source = columns.sources[key]
            out |= {
                f"{key}.{joint_of_number[number]}": replace(source, name=found[number])
                for number in sorted(found)
                if number in joint_of_number
            }
    out |= {key: source for key, source in columns.sources.items() if column_of(key) is not None}
    return out, warnings


def mapped(raw: RawTable, columns: ColumnMap, joints: Sequence[str] | None = None) -> RawTable:
    """The columns of a file under their standard names and in SI units; other columns are kept as they are.

    Args:
        raw: Columns under the names of the file.
        columns: The column map.
        joints: Joint names of the robot, in the order in which a file may number them; None without a robot.

    Raises:
        LogError: If the map names a column that the file does not have, or a column without numbers.
    """
    sources, number_warnings = _expanded(columns, raw, joints)
    for name in [*(source.name for source in sources.values()), *columns.ignored]:
        if name not in raw.names:
            raise LogError(
                f"{columns.file}: {raw.file} has no column {shortened(name)}: {known_names(name, raw.names, 'columns')}"
            )
    replaced = {source.name for source in sources.values()} | set(columns.ignored)
    # Numbered columns are also left out if no joint of the robot has their number.
    for source in columns.sources.values():
        if NUMBER in source.name:
            replaced |= set(matching(source.name, raw.names).values())
    out = {name: values for name, values in raw.columns.items() if name not in replaced}
    for key, source in sources.items():
        if source.name in raw.problems:
            raise LogError(raw.problems[source.name])
        out[key] = raw.columns[source.name] * source.factor + source.offset
    if columns.rate is not None:
        out = {"t": _times(raw, columns, columns.rate, out), **out}
    return RawTable(
        raw.file,
        out,
        (*raw.warnings, *number_warnings),
        columns.compensated,
        columns.low_pass,
        {key: source.name for key, source in sources.items()},
        raw.references_held,
        columns.late,
        problems={name: text for name, text in raw.problems.items() if name not in replaced and name not in sources},
        place=raw.place,
    )
