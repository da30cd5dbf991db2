# pyright: reportAttributeAccessIssue=false
"""Reads LeRobot datasets of formats v2.1 and v3: a folder with ``meta/info.json`` and Parquet files of episodes.

An episode is a recording. Its path is the folder's path followed by ``episode_000003``. There is no file at this path:
v2.1 has one file for each episode, below ``data/chunk-000``, and v3 has several episodes in one file.
``observation.state`` is read as the measured position and ``action`` as the reference. The dataset does not state the
unit of its joints, so the user has to.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from identification.data.readers.array_files import open_parquet, parquet_columns
from identification.data.recording import RawTable
from identification.files import EPISODE, LEROBOT_INFO, is_lerobot
from phantom_dyn.array_types import Array
from phantom_dyn.errors import LogError, UsageError, listed, shortened
from phantom_dyn.model.files.plain_file import require_plain_file

_LARGEST_INFO = 5_000_000
"""Largest size of ``meta/info.json`` [bytes]: a thousand times the size for a robot with many cameras."""
_MOST_EPISODES = 1_000_000
_STATE, _ACTION = "observation.state", "action"
# Quantity for each suffix of a name in the feature ``observation.state``.
_KINDS = {"pos": "q", "vel": "v", "torque": "tau", "effort": "tau"}
_OTHER_FEATURES = {"observation.velocity": "v", "observation.effort": "tau", "observation.torque": "tau"}


def read_info(folder: Path) -> Mapping[str, Any]:
    """Contents of a dataset's ``meta/info.json``.

    Raises:
        LogError: If it cannot be read, or is not the file of a dataset.
    """
    path = folder / LEROBOT_INFO
    require_plain_file(path, LogError, "the meta/info.json of a LeRobot dataset")
    if path.stat().st_size > _LARGEST_INFO:
        raise LogError(f"{path} has {path.stat().st_size / 1e6:.0f} MB, wanted at most {_LARGEST_INFO / 1e6:.0f} MB.")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, RecursionError) as error:
        reason = shortened(str(error))
        raise LogError(f"{path} is no JSON ({reason}): copy the LeRobot dataset again.") from error
    if not isinstance(content, dict) or not isinstance(content.get("features"), dict):
        raise LogError(f"{path} has no features, so no LeRobot dataset of format v2.1 or v3: convert it first.")
    return content


def episode_count(folder: Path) -> int:
    """Number of episodes in a dataset, from its ``meta/info.json``."""
    count = read_info(folder).get("total_episodes")
    if not isinstance(count, int) or isinstance(count, bool) or not 0 < count <= _MOST_EPISODES:
        raise LogError(
            f"{folder / LEROBOT_INFO}: total_episodes is {shortened(str(count))}, wanted how many episodes there are, "
            "from 1 on: record some, or copy the dataset again."
        )
    return count


def with_episodes(logs: Sequence[str], episodes: str | None) -> list[str]:
    """The given recordings, with each dataset replaced by its episodes.

    Args:
        logs: Paths as they were given.
        episodes: Episodes to read, as ``0:5`` (without the end) or ``3``; None for all.

    Raises:
        UsageError: If the choice is not valid, or there is no dataset to choose from.
        LogError: If a dataset cannot be used.
    """
    if episodes is not None and not any(is_lerobot(Path(log)) for log in logs):
        raise UsageError(f"--episodes {episodes} was given and no LOG is the folder of a LeRobot dataset; leave it out")
    out = []
    for log in logs:
        if not is_lerobot(Path(log)):
            out.append(log)
            continue
        out += [str(Path(log) / EPISODE.format(k)) for k in _chosen(log, episodes, episode_count(Path(log)))]
    return out


def _chosen(log: str, episodes: str | None, count: int) -> range:
    """Numbers of the chosen episodes of a dataset with ``count`` episodes."""
    if episodes is None:
        return range(count)
    if not (found := re.fullmatch(r"(\d{1,7})(?::(\d{1,7}))?", episodes)):
        raise UsageError(f"--episodes {episodes} was given, wanted A:B such as 0:5 (B is left out), or one number")
    first = int(found.group(1))
    end = first + 1 if found.group(2) is None else int(found.group(2))
    if not first < end <= count:
        raise UsageError(f"--episodes {episodes} was given and {log} has the episodes 0 to {count - 1}; choose of them")
    return range(first, end)


def read_dataset(folder: Path) -> RawTable:
    """The only episode of a dataset.

    Raises:
        LogError: If it has several; the message says how to choose one.
    """
    count = episode_count(folder)
    if count > 1:
        raise LogError(
            f"{folder} is a LeRobot dataset of {count} episodes, each a recording: choose with --episodes, or name "
            f"one, as in {folder / EPISODE.format(0)}."
        )
    return read_episode(folder, 0)


def read_episode(folder: Path, episode: int) -> RawTable:
    """One episode of a dataset, with columns such as ``observation.state.elbow_flex.pos``.

    Raises:
        LogError: If the dataset has no such episode or no joint states, or a file of it cannot be used.
    """
    info = read_info(folder)
    name = EPISODE.format(episode)
    for path in _files(folder, episode):
        found = _rows_of(path, episode)
        if found is not None:
            break
    else:
        raise LogError(
            f"{folder} has no {name}: neither data/chunk-*/{name}.parquet (v2.1) nor rows of it in "
            "data/chunk-*/file-*.parquet (v3): copy the dataset again, or choose another episode."
        )
    columns, problems = found
    if not any(column.startswith(_STATE) for column in columns):
        raise LogError(
            problems.get(_STATE)
            or f"{folder}: {name} has no {_STATE} (measured positions), its columns are {listed(columns)}: "
            "record the state of the robot."
        )
    # An action is sent once per frame, and the servos hold it until the next one.
    named = _named(columns, info["features"])
    return RawTable(name, named, references_held=True, problems=problems, asks_units=True)


def _files(folder: Path, episode: int) -> list[Path]:
    """Parquet files that may hold an episode: its own file, or all files with several episodes."""
    own = sorted(folder.glob(f"data/chunk-*/{EPISODE.format(episode)}.parquet"))
    files = own[:1] or sorted(folder.glob("data/chunk-*/file-*.parquet"))
    for path in files:
        require_plain_file(path, LogError, "a Parquet file of a LeRobot dataset")
    return files


def _rows_of(path: Path, episode: int) -> tuple[dict[str, Array], dict[str, str]] | None:
    """Columns of the joints in the rows of an episode; None if a file has no such rows."""
    file = open_parquet(path)
    import pyarrow as pa
    import pyarrow.compute as pc

    wanted = [
        name
        for name in file.schema_arrow.names
        if name in ("timestamp", "episode_index", _STATE, _ACTION, *_OTHER_FEATURES)
    ]
    for name in ("timestamp", "episode_index"):
        if name not in wanted:
            raise LogError(f"{path} has no column {name}, so it is no file of a LeRobot dataset: copy it again.")
    groups = [k for k in range(file.num_row_groups) if _may_hold(file.metadata.row_group(k), episode)]
    if not groups:
        return None
    table = file.read_row_groups(groups, columns=wanted)
    table = table.filter(pc.equal(table.column("episode_index"), episode))
    if not table.num_rows:
        return None
    kinds = dict(zip(table.schema.names, table.schema.types, strict=True))
    numbers = [
        name
        for name, kind in kinds.items()
        if name != "episode_index" and (pa.types.is_floating(kind) or pa.types.is_nested(kind))
    ]
    if not pa.types.is_floating(kinds["timestamp"]):
        raise LogError(f"{path}: column timestamp holds {kinds['timestamp']}, wanted seconds as a float.")
    return parquet_columns(path.name, table.select([name for name in numbers if not pa.types.is_struct(kinds[name])]))


def _may_hold(group: Any, episode: int) -> bool:
    """False if the statistics of a row group exclude an episode."""
    for k in range(group.num_columns):
        column = group.column(k)
        if column.path_in_schema == "episode_index":
            found = column.statistics
            return found is None or not found.has_min_max or found.min <= episode <= found.max
    return True


def _named(columns: Mapping[str, Array], features: Mapping[str, Any]) -> dict[str, Array]:
    """Columns such as ``action[0]``, renamed if ``meta/info.json`` states their names."""
    out: dict[str, Array] = {}
    for column, values in columns.items():
        feature, bracket, place = column.partition("[")
        if not bracket:
            out[column] = values
            continue
        names = _names(features.get(feature))
        width = sum(other.startswith(f"{feature}[") for other in columns)
        known = len(names) == width and len(set(names)) == width
        out[f"{feature}.{names[int(place[:-1])]}" if known else column] = values
    return out


def _names(feature: Any) -> list[str]:
    """Names that a feature states, as a list or in a mapping such as ``{"motors": [...]}``; empty without names."""
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict):
        names = next((value for value in names.values() if isinstance(value, list)), None)
    if not isinstance(names, list) or not all(isinstance(name, str) and name.strip() for name in names):
        return []
    return names


def units_question(raw: RawTable, joints: Sequence[str] | None) -> str:
    """The message that asks for the unit of a dataset's joints, with a column map to copy.

    Args:
        raw: An episode.
        joints: Joint names of the robot; None without a robot.
    """
    return (
        f"{raw.file}: a LeRobot dataset does not say the unit of its joints: save this map as columns.yaml, with unit: "
        "deg if the robot was recorded in degrees, unit: rad if in radians, or counts: N if from -100 to 100 (N is "
        "819200 / (range_max - range_min) of that joint in the calibration of a 4096-step servo), and give --columns "
        "columns.yaml:\n" + "\n".join(["t: timestamp", *_lines(raw.names, joints)])
    )


def _lines(names: Sequence[str], joints: Sequence[str] | None) -> list[str]:
    """Entries of a column map for the joints of a dataset."""
    lines: list[str] = []
    for feature, quantity in ((_STATE, "q"), *_OTHER_FEATURES.items(), (_ACTION, "q_ref")):
        start = len(feature)
        columns = [name for name in names if name.startswith((f"{feature}.", f"{feature}["))]
        parts = {name: _joint_and_kind(name[start:], quantity) for name in columns}
        known = {joint for joint, _ in parts.values()}
        positions = [name for name, (_, kind) in parts.items() if kind == quantity]
        joint_by_order: dict[str, str] = {}
        if joints is not None and not known & set(joints) and len(positions) == len(joints):
            joint_by_order = dict(zip(positions, joints, strict=True))
        for name, (joint, kind) in parts.items():
            if kind is not None:
                lines.append(_line(kind, joint_by_order.get(name, joint), name, joints))
    return lines


def _joint_and_kind(rest: str, quantity: str) -> tuple[str, str | None]:
    """Joint and quantity of ``.elbow_flex.pos`` or ``[3]``; None for quantities of an action other than positions."""
    if rest.startswith("["):
        return rest[1:-1], quantity
    name = rest[1:]
    before, _, suffix = name.rpartition(".")
    if not before or suffix not in _KINDS:
        return name, quantity
    kind = _KINDS[suffix]
    if quantity == "q_ref":
        return before, "q_ref" if kind == "q" else None
    return before, kind if quantity == "q" else quantity


def _line(kind: str, joint: str, name: str, joints: Sequence[str] | None) -> str:
    """Entry of one column, commented out if the user has to decide something first."""
    quoted = json.dumps(name)
    unit = {"q": "deg", "q_ref": "deg", "v": "deg/s", "tau": "Nm"}[kind]
    entry = f"{kind}.{joint}: {{from: {quoted}, unit: {unit}}}"
    if "gripper" in joint and kind in ("q", "q_ref"):
        return f"# {entry}  # often 0 to 100: give counts: N, or lock it in robot.yaml and leave it out"
    return entry if joints is None or joint in joints else f"# {entry}  # which joint of the robot is it?"
