"""Reads ``recordings.yaml``, which states known differences between recordings, and the recordings themselves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from identification.data.change_kinds import KINDS, Kind
from identification.data.changes import Change, KnownPayload, robot_in
from identification.data.reading import read_recording
from identification.data.recording import Recording
from identification.scenarios.motion_only import states_controllers, with_controller_torque
from phantom_dyn.errors import ParameterError, UsageError, known_names, shortened
from phantom_dyn.model.files.settings_file import LARGEST, describe, list_at, load_mapping, number_at, text_at
from phantom_dyn.model.robot import Controller, Robot

RECORDING_KEYS = ("file", "payload", "controller", "changed", "exclude", "files")
PAYLOAD_KEYS = ("mass", "center")
_GAINS = ("kp", "kd", "delay")
CONTROLLER_KEYS = ("kind", *_GAINS)


def read_changes(path: str | Path, logs: Sequence[str | Path], joints: Sequence[str]) -> tuple[Change, ...]:
    """Known changes of each recording from a ``recordings.yaml``, in the order of the recordings.

    A recording that the file does not name has no change. If a recording is split into several files (positions in one,
    torques in another), its first file identifies it. Paths are relative to the folder of the ``recordings.yaml`` or to
    the working folder; a file name alone is enough if it is unique.

    Args:
        path: The file.
        logs: The recordings of the diagnosis, held-out ones last.
        joints: Names of the robot's joints.

    Raises:
        ParameterError: If the file cannot be read, names no recording of the diagnosis or one twice, or a key or value
            is unknown; one sentence says where and what to do.
    """
    path = Path(path)
    content = load_mapping(path, ParameterError)
    _require_known(content, str(path), "", ("recordings",))
    if "recordings" not in content:
        raise ParameterError(f"{path}: the key recordings is missing, wanted a list of entries such as - file: a.csv.")
    entries = list_at(content["recordings"], str(path), "recordings")
    out = [Change(Path(log).name) for log in logs]
    seen: dict[int, str] = {}
    for k, entry in enumerate(entries):
        key = f"recordings[{k}]"
        change = _change(entry, str(path), key, joints)
        change = replace(change, beside=tuple(_existing_path(file, path, key) for file in change.beside))
        at = _recording_index(change.file, path, key, logs)
        if at in seen:
            raise ParameterError(
                f"{path}: {key}.file is {shortened(change.file)}, which {seen[at]} has said already: join the two."
            )
        seen[at] = key
        out[at] = replace(change, file=out[at].file)
    return tuple(out)


def changed_from_first(names: str, logs: Sequence[str | Path]) -> tuple[Change, ...]:
    """Changes of recordings that differ from the first one by unknown amounts.

    Args:
        names: Kinds of change, separated by commas.
        logs: The recordings of the diagnosis, held-out ones last.

    Raises:
        UsageError: If there is nothing to compare the first one with, or a name is no kind of change.
    """
    kinds = [name.strip() for name in names.split(",")]
    for kind in kinds:
        if kind not in KINDS:
            raise UsageError(
                f"--changed names {shortened(kind) or 'nothing'}, {known_names(kind, KINDS, 'kinds of change')}"
            )
    if len(logs) < 2:
        raise UsageError(
            "--changed was given with one LOG: give the one to compare with first, and the changed one behind it"
        )
    stated: tuple[Kind, ...] = tuple(one for one in KINDS if one in kinds)
    return tuple(Change(Path(log).name, changed=stated if k else ()) for k, log in enumerate(logs))


def _recording_index(file: str, path: Path, key: str, logs: Sequence[str | Path]) -> int:
    """Index of the recording that a path or file name identifies."""
    places = {(folder / file).resolve() for folder in (path.parent, Path())}
    exact = [k for k, log in enumerate(logs) if Path(log).resolve() in places]
    found = exact or [k for k, log in enumerate(logs) if Path(log).name == file]
    if len(found) == 1:
        return found[0]
    if found:
        raise ParameterError(
            f"{path}: {key}.file is {shortened(file)}, and {len(found)} recordings have that name: give its path."
        )
    raise ParameterError(
        f"{path}: {key}.file is {shortened(file)}, which is not among the recordings that were given: "
        f"{known_names(file, [Path(log).name for log in logs], 'recordings')}"
    )


def _change(entry: Any, file: str, key: str, joints: Sequence[str]) -> Change:
    if not isinstance(entry, Mapping):
        raise ParameterError(f"{file}: {key} is {describe(entry)}, wanted a mapping with file and what was different.")
    _require_known(entry, file, key, RECORDING_KEYS)
    name, *beside = _files(entry, file, key)
    return Change(
        file=name,
        beside=tuple(beside),
        payload=_payload(entry["payload"], file, f"{key}.payload") if "payload" in entry else None,
        controllers=_controllers(entry["controller"], file, f"{key}.controller", joints)
        if "controller" in entry
        else {},
        changed=_changed(entry["changed"], file, f"{key}.changed") if "changed" in entry else (),
        exclude=_stretches(entry["exclude"], file, f"{key}.exclude") if "exclude" in entry else (),
    )


def _files(entry: Mapping[Any, Any], file: str, key: str) -> list[str]:
    """The files of a recording; the first one identifies it."""
    if ("file" in entry) == ("files" in entry):
        raise ParameterError(
            f"{file}: {key} wants either file, the recording that the entry is about, or files, several of one "
            "recording side by side."
        )
    if "file" in entry:
        return [text_at(entry["file"], file, f"{key}.file")]
    names = [
        text_at(name, file, f"{key}.files[{k}]") for k, name in enumerate(list_at(entry["files"], file, f"{key}.files"))
    ]
    if not names:
        raise ParameterError(f"{file}: {key}.files is empty, wanted names such as [pos.csv, tau.csv].")
    return names


def _existing_path(file: str, path: Path, key: str) -> str:
    """Path of a further file of a recording, in the folder of the ``recordings.yaml`` or in the working folder."""
    for folder in (path.parent, Path()):
        if (folder / file).exists():
            return str(folder / file)
    raise ParameterError(f"{path}: {key}.files names {shortened(file)}, which does not exist: correct the name.")


def _payload(entry: Any, file: str, key: str) -> KnownPayload:
    if not isinstance(entry, Mapping):
        raise ParameterError(
            f"{file}: {key} is {describe(entry)}, wanted a mapping such as {{mass: 0.5, center: [0, 0, 0.1]}}; if the "
            "payload is not known, diagnose that recording by itself."
        )
    _require_known(entry, file, key, PAYLOAD_KEYS)
    for name in PAYLOAD_KEYS:
        if name not in entry:
            raise ParameterError(f"{file}: {key}.{name} is missing, wanted mass [kg] and center [m].")
    mass = _not_negative(entry["mass"], file, f"{key}.mass")
    center = list_at(entry["center"], file, f"{key}.center")
    if len(center) != 3:
        raise ParameterError(f"{file}: {key}.center has {len(center)} numbers, wanted three [m] such as [0, 0, 0.1].")
    x, y, z = (number_at(value, file, f"{key}.center[{k}]", most=LARGEST) for k, value in enumerate(center))
    return KnownPayload(mass, (x, y, z))


def _controllers(entry: Any, file: str, key: str, joints: Sequence[str]) -> dict[str, Controller]:
    """Controller of each joint; gains that are stated without a joint apply to all joints."""
    if not isinstance(entry, Mapping) or not entry:
        raise ParameterError(
            f"{file}: {key} is {describe(entry)}, wanted gains such as {{kp: 40, kd: 1}}, or joints each with its "
            "gains; if they are not known, say changed: [controller]."
        )
    if set(entry) & set(CONTROLLER_KEYS) and not set(entry) & set(joints):
        return dict.fromkeys(joints, _controller(entry, file, key))
    _require_known(entry, file, key, tuple(joints), "joints")
    return {joint: _controller(gains, file, f"{key}.{joint}") for joint, gains in entry.items()}


def _controller(entry: Any, file: str, key: str) -> Controller:
    if not isinstance(entry, Mapping):
        raise ParameterError(f"{file}: {key} is {describe(entry)}, wanted gains such as {{kp: 40, kd: 1}}.")
    _require_known(entry, file, key, CONTROLLER_KEYS)
    if entry.get("kind", "pd") != "pd":
        raise ParameterError(f"{file}: {key}.kind is {describe(entry['kind'])}, wanted pd, the only one there is.")
    return Controller("pd", **{name: _not_negative(entry.get(name, 0.0), file, f"{key}.{name}") for name in _GAINS})


def _changed(entry: Any, file: str, key: str) -> tuple[Kind, ...]:
    if not isinstance(entry, list):
        raise ParameterError(f"{file}: {key} is {describe(entry)}, wanted a list such as [friction].")
    names = [text_at(name, file, f"{key}[{k}]") for k, name in enumerate(entry)]
    for name in names:
        if name not in KINDS:
            raise ParameterError(f"{file}: {key} has {shortened(name)}, {known_names(name, KINDS, 'kinds of change')}")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ParameterError(f"{file}: {key} has {twice[0]} twice: say it once.")
    return tuple(kind for kind in KINDS if kind in names)


def _stretches(entry: Any, file: str, key: str) -> tuple[tuple[float, float], ...]:
    out = []
    for k, pair in enumerate(list_at(entry, file, key)):
        times = [
            number_at(time, file, f"{key}[{k}][{i}]", most=LARGEST)
            for i, time in enumerate(list_at(pair, file, f"{key}[{k}]"))
        ]
        if len(times) != 2 or not times[0] < times[1]:
            raise ParameterError(f"{file}: {key}[{k}] is {describe(pair)}, wanted two times [s] such as [2.5, 4].")
        out.append((times[0], times[1]))
    return tuple(out)


def _not_negative(value: Any, file: str, key: str) -> float:
    number = number_at(value, file, key, most=LARGEST)
    if number < 0:
        raise ParameterError(f"{file}: {key} is {describe(value)}, wanted a number of 0 or more.")
    return number


def _require_known(entry: Mapping[Any, Any], file: str, key: str, wanted: tuple[str, ...], what: str = "keys") -> None:
    """Raise an error if an entry has a key that is not wanted; ``what`` is ``keys`` or ``joints``."""
    for name in entry:
        if name not in wanted:
            place = f" in {key}" if key else ""
            kind = "joint" if what == "joints" else "key"
            raise ParameterError(
                f"{file}: there is no {kind} {shortened(str(name))}{place}, {known_names(str(name), wanted, what)}"
            )


def read_changed(
    path: str | Path,
    robot: Robot,
    change: Change,
    *,
    columns: str | Path | None = None,
    topic: str | None = None,
    ref_topic: str | None = None,
    excluded: Sequence[tuple[float, float]] = (),
    anyway: bool = False,
) -> Recording:
    """Read a recording and check it against the robot with this recording's known changes, such as its load.

    If the recording's controllers are known, it needs no torque: the torque is computed from its references.

    Args:
        path: CSV, NPZ, Parquet, ROS 1 or ROS 2 bag, or MCAP.
        robot: The given model.
        change: Known changes of this recording.
        columns: Column map (YAML) or the name of one that is shipped, if the columns have other names or units.
        topic: Topic of joint states in a bag that has several.
        ref_topic: Topic of the references in a bag, if it differs from that of the joint states.
        excluded: Stretches of time [s] to leave out of every fit, besides those of ``change``.
        anyway: True to accept a recording that checks found to be certainly wrong.

    Raises:
        LogError: If the file, a column or a value cannot be used; one sentence says which and what to do.
    """
    changed = robot_in(robot, change)
    by_controllers = bool(change.controllers) and states_controllers(changed)
    found = read_recording(
        (path, *change.beside),
        changed,
        columns=columns,
        topic=topic,
        ref_topic=ref_topic,
        excluded=(*excluded, *change.exclude),
        torque_needed=not by_controllers,
        anyway=anyway,
    )
    return with_controller_torque(found, changed) if by_controllers else found
