"""Bags of ROS and MCAP, and what they say of a base."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from identification.data.readers.bags import rosbag
from identification.data.readers.bags.unitree import FEET, base_columns, base_values, threshold
from identification.data.readers.read_table import read_table
from phantom_dyn.errors import LogError

N = 60

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)

JOINT_STATE = "sensor_msgs/msg/JointState"


def message(store, k, names, position, velocity, effort, stamp=None):
    ns = 10**9 * 5 + 10**7 * k if stamp is None else stamp
    types = store.types
    extra = {"seq": k} if store is ROS1 else {}
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9), frame_id="", **extra
    )
    arrays = [np.array(x, dtype=float) for x in (position, velocity, effort)]
    return types[JOINT_STATE](header=header, name=list(names), position=arrays[0], velocity=arrays[1], effort=arrays[2])


def truth(k):
    """Positions, velocities and efforts of joints a and b."""
    return [np.sin(0.03 * k), np.cos(0.03 * k)], [k, -k], [0.1 * k, 1.0]


def good(store, k):
    return message(store, k, ("a", "b"), *truth(k))


def write_bag(tmp_path, kind, topics) -> Path:
    """A bag of each kind; topics map a name to a function from store and index to a message."""
    store = ROS1 if kind == "ros1" else ROS2
    path = tmp_path / ("log.bag" if kind == "ros1" else "bag")
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    writer = Writer1(path) if kind == "ros1" else Writer2(path, version=9, storage_plugin=plugin)
    with writer:
        for topic, make in topics.items():
            connection = writer.add_connection(topic, JOINT_STATE, typestore=store)
            for k in range(N):
                if (made := make(store, k)) is not None:
                    raw = (store.serialize_ros1 if store is ROS1 else store.serialize_cdr)(made, JOINT_STATE)
                    writer.write(connection, 7 * 10**9 + 10**7 * k, raw)
    if kind in ("ros1", "folder"):
        return path
    return next(path.glob("*.mcap" if kind == "mcap" else "*.db3"))


def assert_true(table):
    k = np.arange(N)
    np.testing.assert_allclose(table.columns["t"], 0.01 * k, atol=1e-9)
    np.testing.assert_array_equal(table.columns["q.a"], np.sin(0.03 * k))
    np.testing.assert_array_equal(table.columns["v.b"], -k)
    np.testing.assert_array_equal(table.columns["tau.a"], 0.1 * k)


@pytest.mark.parametrize("kind", ["ros1", "folder", "db3", "mcap"])
def test_every_kind_of_bag_gives_the_numbers_that_were_written(tmp_path, kind):
    table = read_table(write_bag(tmp_path, kind, {"/joint_states": good}))
    assert_true(table)
    assert table.warnings == ()


def test_the_real_bag_equals_its_decoded_copy(data_folder):
    table = read_table(data_folder / "ur10_unisa" / "ur10_exciting_trajectory.db3")
    joints = [name[2:] for name in table.columns if name.startswith("q.")]
    with np.load(data_folder / "ur10_unisa" / "ur10_exc.npz") as decoded:
        np.testing.assert_allclose(table.columns["t"], decoded["t"], atol=1e-8)
        for prefix, key in (("q", "q"), ("v", "dq"), ("tau", "effort")):
            values = np.column_stack([table.columns[f"{prefix}.{joint}"] for joint in joints])
            np.testing.assert_array_equal(values.astype(np.float32), decoded[key])


def test_names_decide_when_their_order_changes(tmp_path):
    def shuffled(store, k):
        position, velocity, effort = truth(k)
        return good(store, k) if k % 2 else message(store, k, "ba", position[::-1], velocity[::-1], effort[::-1])

    table = read_table(write_bag(tmp_path, "mcap", {"/joint_states": shuffled}))
    assert_true(table)


def test_the_topic_can_be_chosen(tmp_path):
    path = write_bag(tmp_path, "mcap", {"/left": good, "/right": lambda s, k: message(s, k, "c", [k], [], [])})
    assert "q.c" in read_table(path, topic="/right").columns


def test_several_topics_are_listed(tmp_path):
    path = write_bag(tmp_path, "db3", {"/left": good, "/right": good})
    with pytest.raises(LogError, match=r"several topics .*, choose one by --topic: /left, /right"):
        read_table(path)


def test_an_unknown_topic_lists_the_known_ones(tmp_path):
    path = write_bag(tmp_path, "ros1", {"/joint_states": good})
    with pytest.raises(LogError, match=r"has no topic /joint_state .* did you mean /joint_states\?"):
        read_table(path, topic="/joint_state")


def test_a_bag_without_joint_states_lists_its_topics(tmp_path):
    with Writer1(tmp_path / "log.bag") as writer:
        writer.add_connection("/chatter", "std_msgs/msg/String", typestore=ROS1)
    with pytest.raises(LogError, match=r"has no topic of joint states \(.*; its topics are /chatter .*; record one"):
        read_table(tmp_path / "log.bag")


def test_empty_effort_and_velocity_are_no_columns(tmp_path):
    path = write_bag(tmp_path, "mcap", {"/joint_states": lambda s, k: message(s, k, "ab", truth(k)[0], [], [])})
    assert set(read_table(path).columns) == {"t", "q.a", "q.b"}


def test_effort_that_is_empty_now_and_then_is_reported(tmp_path):
    def gappy(store, k):
        return message(store, k, "ab", *truth(k)[:2], [] if k == 4 else truth(k)[2])

    path = write_bag(tmp_path, "mcap", {"/joint_states": gappy})
    with pytest.raises(LogError, match="message 5 of /joint_states has 0 values of effort for 2 joints"):
        read_table(path)


def test_stamps_that_do_not_increase_give_way_to_the_time_of_receipt(tmp_path):
    path = write_bag(tmp_path, "db3", {"/joint_states": lambda s, k: message(s, k, "ab", *truth(k), stamp=0)})
    table = read_table(path)
    assert_true(table)
    assert "header stamps of /joint_states do not increase: the times of receipt were taken" in table.warnings[0]


def test_a_message_sent_twice_is_dropped_with_a_warning(tmp_path):
    path = write_bag(tmp_path, "mcap", {"/joint_states": lambda s, k: good(s, k - (k == 30))})
    table = read_table(path)
    assert len(table.columns["t"]) == N - 1
    assert "1 row that repeats the one before was dropped" in table.warnings[0]


def test_a_gripper_on_the_same_topic_is_left_out_with_a_warning(tmp_path):
    def both(store, k):
        return message(store, k, ["finger"], [0.0], [], []) if k == 9 else good(store, k)

    table = read_table(write_bag(tmp_path, "mcap", {"/joint_states": both}))
    assert len(table.columns["t"]) == N - 1
    assert "1 messages of /joint_states about other joints (finger) were left out" in table.warnings[0]


def test_a_bag_without_messages_is_reported(tmp_path):
    path = write_bag(tmp_path, "mcap", {"/joint_states": lambda s, k: None})
    with pytest.raises(LogError, match="has no messages on /joint_states"):
        read_table(path)


def test_a_bag_with_a_strange_ending_is_reported(tmp_path):
    path = write_bag(tmp_path, "mcap", {"/joint_states": good})
    with pytest.raises(LogError, match=r"is a ROS 2 bag by its content: give it the ending \.db3"):
        read_table(path.rename(path.with_suffix(".csv")))


@pytest.mark.parametrize("kind", ["ros1", "folder", "db3", "mcap"])
def test_without_its_library_a_bag_is_refused_with_the_command_that_installs_it(tmp_path, monkeypatch, kind):
    path = write_bag(tmp_path, kind, {"/joint_states": good})
    monkeypatch.setattr(rosbag, "is_installed", lambda _: False)
    wanted = rf"{path.name} is a bag. Reading a ROS bag or MCAP needs rosbags.*pip install 'phantom-dyn\[ros\]'"
    with pytest.raises(LogError, match=wanted):
        read_table(path)


SAMPLES = 200

ON = (np.arange(SAMPLES) // 20) % 2 == 1


def low_state(k: int) -> SimpleNamespace:
    imu = SimpleNamespace(gyroscope=[0.1 * k, 1, 2], accelerometer=[3, 4, 9 + 0.01 * k])
    return SimpleNamespace(imu_state=imu, foot_force=[20 + 90 * ON[k] + k % 3 + j for j in range(4)])


def test_the_sensor_is_at_the_link_imu():
    columns, _ = base_columns("bag", [base_values(low_state(k)) for k in range(SAMPLES)])
    np.testing.assert_allclose(columns["w.imu.x"], 0.1 * np.arange(SAMPLES))
    np.testing.assert_allclose(columns["sf.imu.z"], 9 + 0.01 * np.arange(SAMPLES))


def test_a_foot_is_on_the_ground_beyond_halfway_between_two_levels_and_that_is_said():
    columns, said = base_columns("bag", [base_values(low_state(k)) for k in range(SAMPLES)])
    for foot in FEET:
        np.testing.assert_array_equal(columns[f"contact.{foot}"], ON)
    assert said[0].startswith("bag: a foot counts as on the ground from a force on of 66 of FR_foot, 67 of FL_foot")


@pytest.mark.parametrize(
    "force", [np.full(SAMPLES, 12.0), 20 + np.random.default_rng(0).normal(size=SAMPLES), np.full(SAMPLES, np.nan)]
)
def test_a_force_without_two_levels_says_nothing_of_contact(force):
    assert threshold(force) is None


def test_without_forces_of_feet_there_is_the_sensor_alone():
    message_of_humanoid = SimpleNamespace(imu_state=low_state(1).imu_state)
    columns, said = base_columns("bag", [base_values(message_of_humanoid)] * SAMPLES)
    assert sorted(columns) == ["sf.imu.x", "sf.imu.y", "sf.imu.z", "w.imu.x", "w.imu.y", "w.imu.z"]
    assert said == ()


def test_the_older_message_has_other_names():
    old = SimpleNamespace(imu=low_state(3).imu_state, footForce=[1, 2, 3, 4])
    np.testing.assert_allclose(base_values(old), [0.3, 1, 2, 3, 4, 9.03, 1, 2, 3, 4])


def test_a_sensor_that_reads_nothing_gives_no_column():
    silent = SimpleNamespace(gyroscope=[0, 0, 0], accelerometer=[0, 0, 0])
    one = SimpleNamespace(imu_state=silent, foot_force=[0, 0, 0, 0])
    assert base_columns("bag", [base_values(one)] * SAMPLES) == ({}, ())
