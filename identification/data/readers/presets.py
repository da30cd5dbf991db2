"""Built-in column maps (presets), as in ``--columns ur_rtde``: the YAML files in the folder ``presets``.

They are column maps with four extensions. A list of entries gives alternatives: the first one whose column is in the
file is used. An entry whose column is not in the file is ignored, except for time and position. ``{topic}`` in a name
stands for any text. ``{only}`` in a key stands for the only joint of the robot.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from identification.data.readers.bags.unitree import MOTOR_ORDERS
from identification.data.readers.column_map import ColumnMap, matching, read_column_map
from identification.data.readers.map_source import Source, source_of
from identification.data.recording import RawTable
from phantom_dyn.errors import LogError, known_names, listed, shortened
from phantom_dyn.model.files.settings_file import read_settings

_FOLDER = Path(__file__).parent / "presets"
PRESETS = tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))
"""Names of the presets."""
_TOPIC, _ONLY = "{topic}", "{only}"
_PLACES = {_TOPIC: "(.*)", "{joint}": "[^/]+", "{number}": "[0-9]{1,4}"}
_ORDERS = {"lowstate": MOTOR_ORDERS}


@dataclass(frozen=True)
class Preset:
    """A built-in column map.

    Attributes:
        name: Name for ``--columns``.
        entries: Alternatives by key, as in its file.
        documented_joint_orders: Orders of joint names that the format's documentation gives for its numbers.
    """

    name: str
    entries: dict[str, list[Any]]
    documented_joint_orders: tuple[tuple[str, ...], ...] = ()


def preset_of(columns: str | Path) -> Preset | None:
    """The preset that ``--columns`` names; None if it names a file.

    Raises:
        LogError: If it is a word that names neither a preset nor a file; the message lists the presets.
    """
    word = str(columns)
    if Path(word).exists() or Path(word).suffix or Path(word).name != word:
        return None
    if word not in PRESETS:
        raise LogError(
            f"{shortened(word)} is neither a file with a column map nor a preset: "
            f"{known_names(word, PRESETS, 'presets')}"
        )
    content = read_settings(_FOLDER / f"{word}.yaml", LogError)
    entries = {key: value if isinstance(value, list) else [value] for key, value in content.items()}
    return Preset(word, entries, _ORDERS.get(word, ()))


def usable_columns(columns: str | Path) -> str | Path:
    """The value of ``--columns`` after a check; a path is made absolute, so that it is valid in any working folder.

    Raises:
        LogError: If it is neither a preset nor a usable column map.
    """
    if preset_of(columns) is not None:
        return str(columns)
    read_column_map(columns)
    return Path(columns).absolute()


def fitting_presets(names: Sequence[str]) -> tuple[str, ...]:
    """Presets that fit the columns of a file."""
    raw = RawTable("log", {}, problems=dict.fromkeys(names, ""))
    out = []
    for name in PRESETS:
        preset = preset_of(name)
        try:
            if preset is not None and map_of(preset, raw, None).sources:
                out.append(name)
        except LogError:
            continue
    return tuple(out)


def map_of(preset: Preset, raw: RawTable, joints: Sequence[str] | None) -> ColumnMap:
    """The column map of a preset for one file.

    Args:
        preset: The preset.
        raw: The columns of the file.
        joints: Joints of the robot; None without a robot.

    Raises:
        LogError: If the file has no column that the preset names for time or position, or if several topics fit.
    """
    label = f"--columns {preset.name}"
    sources: dict[str, Source] = {}
    for key, alternatives in preset.entries.items():
        for value in alternatives:
            found = _source_in_file(label, raw, key.partition(".")[0], value)
            if found is not None:
                sources[_key(label, key, joints)] = found
                break
    for quantity, what in (("t", "time"), ("q", "position")):
        if not any(key.partition(".")[0] == quantity for key in sources):
            wanted = next(entries for key, entries in preset.entries.items() if key.partition(".")[0] == quantity)
            raise LogError(
                f"{label}: {raw.file} has no {what} as that preset names it ({listed(map(_name, wanted))}), its "
                f"columns are {listed(raw.names)}: name another preset ({', '.join(PRESETS)}) or the file of a map "
                "of your own."
            )
    return ColumnMap(label, sources)


def _name(value: Any) -> str:
    """Column name of an entry, which is a name alone or ``{from: NAME, ...}``."""
    return value if isinstance(value, str) else value["from"]


def _key(label: str, key: str, joints: Sequence[str] | None) -> str:
    """A key with the robot's only joint in place of ``{only}``."""
    if _ONLY not in key:
        return key
    if joints is not None and len(joints) != 1:
        raise LogError(
            f"{label} is of one joint and the robot has {len(joints)} ({listed(joints)}): write a column map that says "
            "which of them was recorded, and lock the others in robot.yaml."
        )
    return key.replace(_ONLY, "1" if joints is None else joints[0])


def _source_in_file(label: str, raw: RawTable, quantity: str, value: Any) -> Source | None:
    """The source of an entry; None if the file has no such column."""
    name = _name(value)
    if _TOPIC in name:
        topics = _topics(name, raw.names)
        if len(topics) > 1:
            raise LogError(
                f"{label}: {raw.file} has several topics that fit it ({listed(topics)}): export one of them, or write "
                "a column map."
            )
        if not topics:
            return None
        name = name.replace(_TOPIC, topics[0])
    for_all_joints = "{" in name
    if not (matching(name, raw.names) if for_all_joints else name in raw.names):
        return None
    given = name if isinstance(value, str) else {**value, "from": name}
    return source_of(label, quantity if for_all_joints or quantity == "t" else f"{quantity}.joint", given)


def _topics(name: str, names: Sequence[str]) -> list[str]:
    """Texts in place of ``{topic}`` with which a name is that of a column of the file."""
    parts = re.split(r"(\{\w+\})", name)
    pattern = re.compile("".join(_PLACES.get(part, re.escape(part)) for part in parts))
    return list(dict.fromkeys(m.group(1) for column in names if (m := pattern.fullmatch(column))))
