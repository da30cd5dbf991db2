# pyright: reportAttributeAccessIssue=false
"""ROS 1 and ROS 2 bags (folder or bare .db3 file) and MCAP: one topic of sensor_msgs/JointState."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from identification.data.readers.unpacked_size import require_small_bag, require_small_mcap
from identification.data.recording import RawTable
from phantom_dyn.errors import LogError, known_names, listed
from phantom_dyn.libraries import is_installed, missing_library

Array = np.ndarray
_JOINT_STATE = "sensor_msgs/msg/JointState"
# JointState's fields and the prefix that each has in the contract.
_FIELDS = (("position", "q"), ("velocity", "v"), ("effort", "tau"))


@dataclass(frozen=True)
class _Message:
    """One JointState: receive time and header stamp [ns], joint names, values of the three fields."""

    received: int
    stamp: int
    names: tuple[str, ...]
    values: tuple[Array, Array, Array]


def _choose_topic(file: str, connections: list[Any], topic: str | None) -> list[Any]:
    """Connections of the JointState topic to read."""
    topics = sorted({c.topic for c in connections if c.msgtype == _JOINT_STATE})
    if not topics:
        kinds = sorted({f"{c.topic} ({c.msgtype})" for c in connections})
        raise LogError(f"{file} has no topic of sensor_msgs/JointState; its topics are {listed(kinds)}.")
    if topic is None and len(topics) > 1:
        raise LogError(f"{file} has several topics of sensor_msgs/JointState, choose one by --topic: {listed(topics)}.")
    wanted: str = topics[0] if topic is None else topic
    if wanted not in topics:
        raise LogError(
            f"{file} has no topic {wanted} of sensor_msgs/JointState: {known_names(wanted, topics, 'such topics')}"
        )
    return [c for c in connections if c.topic == wanted and c.msgtype == _JOINT_STATE]


def _messages(reader: Any, connections: list[Any], decode: Callable[[bytes, str], Any]) -> list[_Message]:
    out = []
    for connection, received, raw in reader.messages(connections=connections):
        message = decode(raw, connection.msgtype)
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        values = (message.position, message.velocity, message.effort)
        out.append(_Message(received, stamp, tuple(message.name), values))
    return out


def _require_rosbags(file: str) -> None:
    """Refuse a bag where the library that reads it is not installed, in a sentence that says how to get it."""
    if not is_installed("rosbags"):
        raise LogError(f"{file} is a bag. {missing_library('rosbags')}")


def _open_ros1(path: Path, topic: str | None) -> tuple[str, list[_Message]]:
    _require_rosbags(path.name)
    from rosbags.rosbag1 import Reader
    from rosbags.typesys import Stores, get_typestore

    require_small_bag(path)
    decode = get_typestore(Stores.ROS1_NOETIC).deserialize_ros1
    with Reader(path) as reader:
        connections = _choose_topic(path.name, list(reader.connections), topic)
        return connections[0].topic, _messages(reader, connections, decode)


def _open_ros2(path: Path, topic: str | None) -> tuple[str, list[_Message]]:
    _require_rosbags(path.name)
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    for file in [path] if path.is_file() else path.glob("*.mcap"):
        if file.suffix == ".mcap":
            require_small_mcap(file)
    decode = get_typestore(Stores.ROS2_HUMBLE).deserialize_cdr
    with Reader(path) as reader:
        connections = _choose_topic(path.name, list(reader.connections), topic)
        return connections[0].topic, _messages(reader, connections, decode)


def _of_main_joints(file: str, topic: str, messages: list[_Message]) -> tuple[list[_Message], tuple[str, ...]]:
    """Messages about the set of joints that most values belong to (an arm and its gripper may share a topic)."""
    for k, message in enumerate(messages):
        if len(set(message.names)) != len(message.names):
            raise LogError(f"{file}: message {k + 1} of {topic} names a joint twice: {listed(message.names)}.")
    counts = Counter(frozenset(message.names) for message in messages)
    main = max(counts, key=lambda names: (counts[names] * len(names), sorted(names)))
    kept = [message for message in messages if len(message.names) == len(main) and main.issuperset(message.names)]
    dropped = len(messages) - len(kept)
    others = sorted(set().union(*counts) - main)
    sentence = f"{file}: {dropped} messages of {topic} about other joints ({listed(others)}) were left out."
    return kept, (sentence,) if dropped else ()


def _field(file: str, topic: str, messages: list[_Message], index: int, names: tuple[str, ...]) -> Array | None:
    """Values of one field, shape ``(N, len(names))``, columns in the order of ``names``; None if it is always empty."""
    lengths = np.array([len(message.values[index]) for message in messages])
    if not lengths.any():
        return None
    wrong = np.flatnonzero(lengths != len(names))
    if len(wrong):
        raise LogError(
            f"{file}: message {wrong[0] + 1} of {topic} has {lengths[wrong[0]]} values of {_FIELDS[index][0]} for "
            f"{len(names)} joints: every message must have one a joint, or all must have none."
        )
    out = np.array([message.values[index] for message in messages], dtype=float)
    orders: dict[tuple[str, ...], list[int]] = {names: list(range(len(names)))}
    for k, message in enumerate(messages):
        if message.names != names:
            order = orders.setdefault(message.names, [message.names.index(name) for name in names])
            out[k] = out[k, order]
    return out


def _time(messages: list[_Message], same_as_before: Array) -> tuple[Array, bool]:
    """Seconds since the first message, and whether they are header stamps."""
    stamps = np.array([message.stamp for message in messages], dtype=np.int64)
    steps = np.diff(stamps)
    # A message that was sent twice keeps its stamp; that is no reason to distrust the stamps.
    by_header = bool(np.all((steps > 0) | ((steps == 0) & same_as_before)) and np.any(steps > 0))
    chosen = stamps if by_header else np.array([message.received for message in messages], dtype=np.int64)
    return (chosen - chosen[0]) * 1e-9, by_header


def _table(file: str, topic: str, messages: list[_Message]) -> RawTable:
    if not messages:
        raise LogError(f"{file} has no messages on {topic}: record it while the robot moves.")
    messages, warnings = _of_main_joints(file, topic, messages)
    names = messages[0].names
    if not names:
        raise LogError(f"{file}: the messages of {topic} name no joints: the publisher must fill the field name.")
    fields = [_field(file, topic, messages, index, names) for index in range(len(_FIELDS))]
    if fields[0] is None:
        raise LogError(
            f"{file}: the messages of {topic} hold no positions: the publisher must fill the field position."
        )
    measured = np.hstack([values for values in fields if values is not None])
    t, by_header = _time(messages, np.all(measured[1:] == measured[:-1], axis=1))
    if not by_header:
        warnings += (f"{file}: the header stamps of {topic} do not increase: the times of receipt were taken.",)
    columns = {"t": t}
    for (_, prefix), values in zip(_FIELDS, fields, strict=True):
        if values is not None:
            columns |= {f"{prefix}.{name}": values[:, k] for k, name in enumerate(names)}
    return RawTable(file, columns, place=lambda row: f"message {row + 1}", warnings=warnings)


def read_ros1_bag(path: Path, topic: str | None) -> RawTable:
    """Joint states of a ROS 1 bag.

    Args:
        path: The file.
        topic: Which topic of sensor_msgs/JointState, or None if there is only one.

    Returns:
        Columns ``t`` (seconds since the first message), ``q.``, and ``v.`` and ``tau.`` where they were sent.

    Raises:
        LogError: No such topic, several and none chosen, or messages that do not fit together.
    """
    return _table(path.name, *_open_ros1(path, topic))


def read_ros2_bag(path: Path, topic: str | None) -> RawTable:
    """Joint states of a ROS 2 bag (its folder, or a .db3 file alone) or MCAP file; see `read_ros1_bag`."""
    if path.is_file() and path.suffix not in (".db3", ".mcap"):
        raise LogError(f"{path.name} is a ROS 2 bag by its content: give it the ending .db3 (SQLite) or .mcap.")
    return _table(path.name, *_open_ros2(path, topic))
