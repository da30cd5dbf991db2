# pyright: reportAttributeAccessIssue=false
"""Reads ROS 1 bags, ROS 2 bags (folder or .db3 file) and MCAP: one topic of joint states, and one of references.

The content of messages is read by `identification.data.readers.bags.joint_messages`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from identification.data.readers.bags.joint_messages import (
    CONTROLLER_STATE,
    DOCUMENTED_ORDER,
    JOINT_STATE,
    REFERENCES,
    STATES,
    JointValues,
)
from identification.data.readers.bags.message_types import register_types
from identification.data.readers.bags.unitree import MOTOR_ORDERS, base_columns
from identification.data.readers.contract_columns import JOINT_QUANTITIES
from identification.data.readers.references import with_references
from identification.data.readers.unpacked_size import require_small_bag, require_small_mcap
from identification.data.recording import RawTable
from phantom_dyn.array_types import Array
from phantom_dyn.errors import LogError, known_names, listed, shortened
from phantom_dyn.libraries import is_installed, missing_library

Readers = Mapping[str, Callable[[Any], JointValues]]

# Fields of JointState, for messages about it.
_FIELD_NAMES = {
    "q": "position",
    "v": "velocity",
    "tau": "effort",
    "q_ref": "reference",
    "i": "current",
    "temp": "temperature",
}
_TICK_TOLERANCE = 0.02
"""Ticks are used as times if their range equals that of the times of receipt to within this share."""


@dataclass(frozen=True)
class _Message:
    """Values of the joints in one message, and the time at which it was received [ns]."""

    received: int
    joints: JointValues

    @property
    def names(self) -> tuple[str, ...]:
        return self.joints.names


@dataclass(frozen=True)
class _Topic:
    """Messages of one topic.

    Attributes:
        name: Name of the topic.
        kind: Type of its messages.
        messages: In the order in which they were received.
    """

    name: str
    kind: str
    messages: list[_Message]


def _choose_topic(file: str, connections: Sequence[Any], topic: str | None, readers: Readers, option: str) -> list[Any]:
    """Connections of the named topic, or of the only topic that suits."""
    kinds = {c.topic: c.msgtype for c in connections if c.msgtype in readers}
    topics = sorted(kinds)
    wanted_kinds = "joint states" if option == "--topic" else "references"
    if not topics:
        found = sorted({f"{c.topic} ({c.msgtype})" for c in connections})
        raise LogError(
            f"{file} has no topic of {wanted_kinds} (sensor_msgs/JointState or another of {listed(sorted(readers))}); "
            f"its topics are {listed(found)}; record one of these, or give a file that has one."
        )
    if topic is None:
        plain = [name for name in topics if kinds[name] == JOINT_STATE]
        topics = plain or topics
        if len(topics) > 1:
            raise LogError(
                f"{file} has several topics of {'sensor_msgs/JointState' if plain else wanted_kinds}, choose one by "
                f"{option}: {listed(topics)}."
            )
    wanted = topics[0] if topic is None else topic
    if wanted not in topics:
        known = known_names(wanted, topics, "topics")
        raise LogError(f"{file} has no topic {shortened(wanted)} of {wanted_kinds}: {known}")
    return [c for c in connections if c.topic == wanted and c.msgtype == kinds[wanted]]


def _topic(reader: Any, connections: list[Any], readers: Readers, decode: Callable[[bytes, str], Any]) -> _Topic:
    """Decode all messages of one topic."""
    read = readers[connections[0].msgtype]
    messages = [
        _Message(received, read(decode(raw, connection.msgtype)))
        for connection, received, raw in reader.messages(connections=connections)
    ]
    return _Topic(connections[0].topic, connections[0].msgtype, messages)


def _require_rosbags(file: str) -> None:
    """Raise an error if the library for bags is not installed; the message says how to install it."""
    if not is_installed("rosbags"):
        raise LogError(f"{file} is a bag. {missing_library('rosbags')}")


def _table_of_open_bag(
    file: str, reader: Any, store: Any, decode: Callable[[bytes, str], Any], topic: str | None, ref_topic: str | None
) -> RawTable:
    """The table of a bag that is open, with a warning on topics of references that are not read."""
    connections = list(reader.connections)
    states = _choose_topic(file, connections, topic, STATES, "--topic")
    references = [] if ref_topic is None else _choose_topic(file, connections, ref_topic, REFERENCES, "--ref-topic")
    register_types(file, store, (*states, *references))
    table = _table(
        file,
        _topic(reader, states, STATES, decode),
        _topic(reader, references, REFERENCES, decode) if references else None,
    )
    others = sorted({c.topic for c in connections if c.msgtype == CONTROLLER_STATE} - {states[0].topic})
    if not others or references:
        return table
    warning = (
        f"{file}: the references of the controllers are on {listed(others)} and are read with --ref-topic {others[0]}."
    )
    return replace(table, warnings=(*table.warnings, warning))


def _require_ros(path: Path) -> None:
    """Raise an error for an MCAP file whose header states another profile than ROS 2."""
    with path.open("rb") as file:
        head = file.read(64)
    # Magic, kind and length of the record, then the length of the profile and the profile.
    length = int.from_bytes(head[17:21], "little")
    profile = head[21 : 21 + length].decode("utf-8", errors="replace")
    if head[8:9] == b"\x01" and length <= 32 and profile != "ros2":
        raise LogError(
            f"{path.name} is an MCAP file of the profile {shortened(profile)!r}, wanted ros2: JSON and Protobuf are "
            "not read; record in ROS 2, or write CSV with the columns t, q.<joint> and tau.<joint>."
        )


def _require_distinct(file: str, topic: _Topic) -> None:
    """Raise an error for a message that names a joint twice."""
    for k, message in enumerate(topic.messages):
        if len(set(message.names)) != len(message.names):
            raise LogError(f"{file}: message {k + 1} of {topic.name} names a joint twice: {listed(message.names)}.")


def _main_joint_messages(file: str, topic: _Topic) -> tuple[list[_Message], tuple[str, ...]]:
    """Messages about one set of joints, the one with most values, and a warning on the others.

    For example, an arm and its gripper may share a topic.
    """
    _require_distinct(file, topic)
    counts = Counter(frozenset(message.names) for message in topic.messages)
    main = max(counts, key=lambda names: (counts[names] * len(names), sorted(names)))
    kept = [m for m in topic.messages if len(m.names) == len(main) and main.issuperset(m.names)]
    dropped = len(topic.messages) - len(kept)
    others = sorted(set().union(*counts) - main)
    sentence = f"{file}: {dropped} messages of {topic.name} about other joints ({listed(others)}) were left out."
    return kept, (sentence,) if dropped else ()


def _quantity_values(file: str, topic: _Topic, messages: list[_Message], quantity: str) -> Array | None:
    """Values of one quantity, ``(N, joints)``, in the order of joints of the first message; None without values."""
    values = [message.joints.values.get(quantity, ()) for message in messages]
    lengths = np.array([len(one) for one in values])
    if not lengths.any():
        return None
    names = messages[0].names
    wanted = len(names) if names else lengths[0]
    wrong = np.flatnonzero(lengths != wanted)
    if len(wrong):
        raise LogError(
            f"{file}: message {wrong[0] + 1} of {topic.name} has {lengths[wrong[0]]} values of "
            f"{_FIELD_NAMES[quantity]} for {wanted} joints: every message must have one a joint, or all must have none."
        )
    out = np.array(values, dtype=float)
    orders: dict[tuple[str, ...], list[int]] = {names: list(range(len(names)))}
    for k, message in enumerate(messages):
        if message.names != names:
            order = orders.setdefault(message.names, [message.names.index(name) for name in names])
            out[k] = out[k, order]
    return out


def _stamps(messages: list[_Message], same_as_before: Array) -> Array | None:
    """Time stamps of the messages [ns]; None if they do not increase, or if ticks are not milliseconds.

    Args:
        messages: The messages.
        same_as_before: True for each message with the same values as the message before it.
    """
    if any(message.joints.stamp is None for message in messages):
        return None
    stamps = np.array([message.joints.stamp for message in messages], dtype=np.int64)
    steps = np.diff(stamps)
    # A message that was sent twice may repeat its stamp.
    if not (np.all((steps > 0) | ((steps == 0) & same_as_before)) and np.any(steps > 0)):
        return None
    if messages[0].joints.is_tick:
        received = messages[-1].received - messages[0].received
        if abs(float(stamps[-1] - stamps[0]) - received) > _TICK_TOLERANCE * received:
            return None
    return stamps


def _received(messages: Iterable[_Message]) -> Array:
    """Times at which messages were received [ns]."""
    return np.array([message.received for message in messages], dtype=np.int64)


def _columns(names: tuple[str, ...], fields: Mapping[str, Array]) -> dict[str, Array]:
    """One column per quantity and joint; columns that are NaN throughout are left out."""
    out = {}
    for quantity, values in fields.items():
        for k in range(values.shape[1]):
            if not np.all(np.isnan(values[:, k])):
                out[f"{quantity}.{names[k]}" if names else f"{quantity}[{k}]"] = values[:, k]
    return out


def _table(file: str, states: _Topic, references: _Topic | None) -> RawTable:
    """The table of a topic of joint states, with the references of another topic if there is one."""
    topic = states.name
    if not states.messages:
        raise LogError(f"{file} has no messages on {topic}: record it while the robot moves.")
    messages, warnings = _main_joint_messages(file, states)
    names = messages[0].names
    fields = {
        quantity: values
        for quantity in JOINT_QUANTITIES
        if (values := _quantity_values(file, states, messages, quantity)) is not None
    }
    if not names and states.kind == JOINT_STATE:
        raise LogError(f"{file}: the messages of {topic} name no joints: the publisher must fill the field name.")
    if "q" not in fields:
        raise LogError(
            f"{file}: the messages of {topic} hold no positions: the publisher must fill the field position."
        )
    measured = np.hstack(list(fields.values()))
    stamps = _stamps(messages, np.all(measured[1:] == measured[:-1], axis=1))
    received = _received(messages)
    if stamps is None and messages[0].joints.stamp is not None:
        which = "ticks" if messages[0].joints.is_tick else "header stamps"
        warnings += (f"{file}: the {which} of {topic} do not increase: the times of receipt were taken.",)
    readings = [message.joints.base for message in messages if message.joints.base is not None]
    base, base_warnings = base_columns(file, readings) if len(readings) == len(messages) else ({}, ())
    warnings += base_warnings
    times = received if stamps is None else stamps
    table = RawTable(
        file,
        {"t": (times - times[0]) * 1e-9, **_columns(names, fields), **base},
        place=lambda row: f"message {row + 1}",
        warnings=warnings,
        numbered=not names,
        documented_joint_orders=MOTOR_ORDERS if states.kind in DOCUMENTED_ORDER else (),
    )
    if references is None:
        return table
    # Ticks and times of receipt are not on the clock of the stamps of references.
    start = None if stamps is None or messages[0].joints.is_tick else int(times[0])
    sent = _sent_references(file, references, names, start, received, table.columns["t"])
    return with_references(table, references.name, *sent)


def _sent_references(
    file: str, references: _Topic, names: tuple[str, ...], start: int | None, received: Array, t: Array
) -> tuple[Array, dict[str, Array]]:
    """Times [s] of the references of a topic on the clock of the states, and their columns.

    Args:
        file: Name of the bag, for messages.
        references: The topic of the references.
        names: Joints of the states; references without names are in this order.
        start: Stamp of the first state [ns]; None if states and references have stamps of different clocks.
        received: Time at which each state was received [ns].
        t: Time of each state [s].
    """
    messages = [m for m in references.messages if len(m.joints.values["q_ref"])]
    if not messages:
        raise LogError(
            f"{file}: the messages of {references.name} hold no references of positions: name another topic."
        )
    messages, _ = _main_joint_messages(file, replace(references, messages=messages))
    values = _quantity_values(file, references, messages, "q_ref")
    assert values is not None  # messages without them were left out
    stamps = None if start is None else _stamps(messages, np.all(values[1:] == values[:-1], axis=1))
    if stamps is not None and start is not None:
        times = (stamps - start) * 1e-9
    else:
        # Each state has a time on both clocks: the median difference is the offset between the clocks.
        times = (_received(messages) - received[0]) * 1e-9 - float(np.median((received - received[0]) * 1e-9 - t))
    names = messages[0].names or (names if len(names) == values.shape[1] else ())
    return times, _columns(names, {"q_ref": values})


def read_ros1_bag(path: Path, topic: str | None, ref_topic: str | None = None) -> RawTable:
    """Joint states of a ROS 1 bag.

    Args:
        path: The file.
        topic: Topic of joint states; None for the topic of sensor_msgs/JointState, or else the only topic.
        ref_topic: Topic of references to read as well; None to read none.

    Returns:
        Columns ``t`` (seconds since the first message), ``q.``, and of ``v.``, ``tau.``, ``q_ref.``, ``i.`` and
        ``temp.`` those that were sent; ``q[0]`` and so on if the messages have no names of joints.

    Raises:
        LogError: If there is no such topic, or several and none is named, or if messages contradict each other.
    """
    _require_rosbags(path.name)
    from rosbags.rosbag1 import Reader
    from rosbags.typesys import Stores, get_typestore

    require_small_bag(path)
    store = get_typestore(Stores.ROS1_NOETIC)
    with Reader(path) as reader:
        return _table_of_open_bag(path.name, reader, store, store.deserialize_ros1, topic, ref_topic)


def read_ros2_bag(path: Path, topic: str | None, ref_topic: str | None = None) -> RawTable:
    """Joint states of a ROS 2 bag (its folder, or a .db3 file alone) or MCAP file; see `read_ros1_bag`."""
    if path.is_file() and path.suffix not in (".db3", ".mcap"):
        raise LogError(f"{path.name} is a ROS 2 bag by its content: give it the ending .db3 (SQLite) or .mcap.")
    _require_rosbags(path.name)
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    for file in [path] if path.is_file() else path.glob("*.mcap"):
        if file.suffix == ".mcap":
            _require_ros(file)
            require_small_mcap(file)
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(path) as reader:
        return _table_of_open_bag(path.name, reader, store, store.deserialize_cdr, topic, ref_topic)
