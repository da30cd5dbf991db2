"""Bags with other joint states than sensor_msgs/JointState. Oracle: the numbers that were written, by rosbags."""

import sqlite3

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from identification.data.readers.bags.message_types import _KNOWN
from identification.data.readers.read_table import read_table
from phantom_dyn.errors import LogError

N = 60
START, STEP = 5 * 10**9, 10**7
FRANKA = """
std_msgs/Header header
sensor_msgs/JointState measured_joint_state
sensor_msgs/JointState desired_joint_state
"""
FRANKA_1 = "std_msgs/Header header\nfloat64[7] q\nfloat64[7] q_d\nfloat64[7] dq\nfloat64[7] tau_J\n"
OLDER = """
std_msgs/Header header
string[] joint_names
trajectory_msgs/JointTrajectoryPoint desired
trajectory_msgs/JointTrajectoryPoint actual
"""
FOXGLOVE = f"""
builtin_interfaces/Time timestamp
JointState[] joints
{"=" * 80}
MSG: foxglove_msgs/JointState
string name
float64[<=1] position
float64[<=1] velocity
float64[<=1] effort
"""
DEFINITIONS = {
    **_KNOWN,
    "franka_msgs/msg/FrankaRobotState": FRANKA,
    "franka_msgs/msg/FrankaState": FRANKA_1,
    "foxglove_msgs/msg/JointStates": FOXGLOVE,
}
LEGS = tuple(f"{leg}_{part}_joint" for leg in ("FL", "FR", "RL", "RR") for part in ("calf", "hip", "thigh"))


def q(k, joint=0):
    return 0.3 * np.sin(0.05 * k + joint)


def filled(store, name, /, **values):
    """A message whose fields are zero or empty but for some."""
    _, fields = store.fielddefs[name]
    out = {}
    for field, (kind, what) in fields:
        if field in values:
            out[field] = values[field]
        elif kind == 2:
            out[field] = filled(store, what)
        elif kind == 1:
            out[field] = "" if what[0] == "string" else 0
        elif kind == 3:
            (inner, of), count = what
            out[field] = [filled(store, of) for _ in range(count)] if inner == 2 else np.zeros(count, np.dtype(of[0]))
        else:
            (inner, of), _ = what
            out[field] = [] if inner == 2 or of[0] == "string" else np.zeros(0, np.dtype(of[0]))
    return store.types[name](**out)


def header(store, k):
    stamp = filled(
        store, "builtin_interfaces/msg/Time", sec=(START + STEP * k) // 10**9, nanosec=(START + STEP * k) % 10**9
    )
    return filled(store, "std_msgs/msg/Header", stamp=stamp)


def point(store, positions=(), velocities=(), effort=()):
    arrays = {"positions": positions, "velocities": velocities, "effort": effort}
    arrays = {name: np.array(values, dtype=float) for name, values in arrays.items()}
    return filled(store, "trajectory_msgs/msg/JointTrajectoryPoint", **arrays)


def joint_state(store, k, names, position):
    arrays = {"position": position, "velocity": [], "effort": []}
    arrays = {name: np.array(values, dtype=float) for name, values in arrays.items()}
    return filled(store, "sensor_msgs/msg/JointState", header=header(store, k), name=list(names), **arrays)


def controller_state(store, k, effort=(), output=()):
    return filled(
        store, "control_msgs/msg/JointTrajectoryControllerState", header=header(store, k), joint_names=["a", "b"],
        reference=point(store, [q(k) + 1, q(k, 1) + 1]), feedback=point(store, [q(k), q(k, 1)], [1, 2], effort),
        output=point(store, effort=output),
    )  # fmt: skip


def low_state(store, k, package="go", tick=None):
    name = f"unitree_{package}/msg/MotorState"
    heat = np.array([30, 40 + k % 3], np.int16) if package == "hg" else 40 + k % 3
    motors = [
        filled(store, name, q=q(k, j), dq=float(j), tau_est=0.1 * j + 0.01 * k, temperature=heat) if j < 12
        else filled(store, name) for j in range(20 if package == "go" else 35)
    ]  # fmt: skip
    tick = 100 + 10 * k if tick is None else tick
    return filled(store, f"unitree_{package}/msg/LowState", motor_state=motors, tick=tick)


@pytest.fixture
def write(tmp_path):
    """Writes a bag of each kind; topics map a name to a type and a function from store and index to a message."""

    def run(topics, kind="mcap", definitions=DEFINITIONS):
        ros1 = kind == "ros1"
        store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        for name, text in definitions.items():
            store.register({k: v for k, v in get_types_from_msg(text, name).items() if k not in store.types})
        path = tmp_path / ("log.bag" if ros1 else "bag")
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        with Writer1(path) if ros1 else Writer2(path, version=8, storage_plugin=plugin) as writer:
            for topic, (msgtype, make) in topics.items():
                connection = writer.add_connection(topic, msgtype, typestore=store)
                for k in range(N):
                    raw = (store.serialize_ros1 if ros1 else store.serialize_cdr)(make(store, k), msgtype)
                    writer.write(connection, START + 10**9 + STEP * k, raw)
        if kind == "db3":
            # Humble and older wrote no definitions.
            with sqlite3.connect(next(path.glob("*.db3"))) as database:
                database.execute("DELETE FROM message_definitions")
            database.close()
        return path

    return run


CONTROLLER = "control_msgs/msg/JointTrajectoryControllerState"
K = np.arange(N)


@pytest.mark.parametrize("kind", ["mcap", "db3"])
def test_a_controller_state_has_references_and_measured_values(write, kind):
    # Bags in SQLite of that age hold no definitions: there the known layout is taken.
    path = write({"/state": (CONTROLLER, lambda s, k: controller_state(s, k, [k, -k]))}, kind)
    columns = read_table(path).columns
    np.testing.assert_array_equal(columns["q_ref.b"], q(K, 1) + 1)
    np.testing.assert_array_equal(columns["q.b"], q(K, 1))
    np.testing.assert_array_equal(columns["v.b"], 2.0)
    np.testing.assert_array_equal(columns["tau.b"], -K)
    np.testing.assert_allclose(columns["t"], 0.01 * K, atol=1e-12)


def test_where_no_effort_was_measured_the_output_of_the_controller_is_the_torque(write):
    path = write({"/state": (CONTROLLER, lambda s, k: controller_state(s, k, output=[3, k]))})
    np.testing.assert_array_equal(read_table(path).columns["tau.b"], K)


def test_an_older_controller_state_has_desired_and_actual(write):
    def older(store, k):
        return filled(
            store, CONTROLLER, header=header(store, k), joint_names=["a"], desired=point(store, [q(k) + 1]),
            actual=point(store, [q(k)]),
        )  # fmt: skip

    columns = read_table(write({"/state": (CONTROLLER, older)}, "ros1", {CONTROLLER: OLDER})).columns
    np.testing.assert_array_equal(columns["q_ref.a"] - columns["q.a"], (q(K) + 1) - q(K))


def test_dynamic_joint_states_are_read_by_the_names_of_their_interfaces(write):
    def dynamic(store, k):
        def one(**values):
            return filled(
                store, "control_msgs/msg/InterfaceValue", interface_names=list(values),
                values=np.array(list(values.values()), dtype=float),
            )  # fmt: skip

        values = [one(effort=k, position=q(k), temperature=40), one(position=q(k, 1), voltage=24)]
        return filled(
            store, "control_msgs/msg/DynamicJointState", header=header(store, k), joint_names=["a", "b"],
            interface_values=values,
        )  # fmt: skip

    columns = read_table(write({"/dynamic": ("control_msgs/msg/DynamicJointState", dynamic)})).columns
    assert set(columns) == {"t", "q.a", "q.b", "tau.a", "temp.a"}
    np.testing.assert_array_equal(columns["tau.a"], K)
    np.testing.assert_array_equal(columns["temp.a"], 40.0)


def test_a_franka_robot_state_has_measured_and_desired_joint_states(write):
    def franka(store, k):
        found, asked = joint_state(store, k, "ab", [q(k), 1]), joint_state(store, k, "ab", [q(k) + 1, 2])
        return filled(
            store, "franka_msgs/msg/FrankaRobotState", header=header(store, k), measured_joint_state=found,
            desired_joint_state=asked,
        )  # fmt: skip

    columns = read_table(write({"/franka": ("franka_msgs/msg/FrankaRobotState", franka)})).columns
    np.testing.assert_array_equal(columns["q_ref.a"], q(K) + 1)
    np.testing.assert_array_equal(columns["q.a"], q(K))


def test_a_franka_state_of_ros_1_numbers_the_joints_in_the_robots_order(write):
    def franka(store, k):
        values = {name: np.arange(7) + shift + q(k) for shift, name in enumerate(("q", "q_d", "dq", "tau_J"))}
        return filled(store, "franka_msgs/msg/FrankaState", header=header(store, k), **values)

    path = write({"/franka": ("franka_msgs/msg/FrankaState", franka)}, "ros1")
    table = read_table(path, joints=[f"panda_joint{k}" for k in range(1, 8)])
    np.testing.assert_array_equal(table.columns["tau.panda_joint7"], 6 + 3 + q(K))
    assert "taken in the robot's order: q[0] is panda_joint1" in table.warnings[0]


def test_foxglove_joint_states_leave_out_what_is_optional(write):
    def states(store, k):
        joints = [
            filled(store, "foxglove_msgs/msg/JointState", name=name, position=np.array([q(k)]),
                   effort=np.array([k], dtype=float) if name == "a" else np.zeros(0))
            for name in "ab"
        ]  # fmt: skip
        return filled(store, "foxglove_msgs/msg/JointStates", timestamp=header(store, k).stamp, joints=joints)

    columns = read_table(write({"/states": ("foxglove_msgs/msg/JointStates", states)})).columns
    assert set(columns) == {"t", "q.a", "q.b", "tau.a"}
    np.testing.assert_array_equal(columns["tau.a"], K)


@pytest.mark.parametrize("kind", ["mcap", "db3"])
@pytest.mark.parametrize("package", ["go", "hg"])
def test_a_low_state_has_motors_with_temperatures(write, kind, package):
    path = write({"/lowstate": (f"unitree_{package}/msg/LowState", lambda s, k: low_state(s, k, package))}, kind)
    columns = read_table(path, joints=[f"j{k}" for k in range(12)]).columns
    np.testing.assert_allclose(columns["q.j4"], q(K, 4), rtol=1e-6)
    np.testing.assert_allclose(columns["tau.j4"], 0.4 + 0.01 * K, rtol=1e-6)
    np.testing.assert_array_equal(columns["temp.j4"], 40 + K % 3)
    np.testing.assert_allclose(columns["t"], 0.01 * K, atol=1e-12)


def test_the_motors_of_a_quadruped_have_the_order_that_its_maker_documents(write):
    path = write({"/lowstate": ("unitree_go/msg/LowState", low_state)})
    table = read_table(path, joints=LEGS)
    # Motor 3 is the hip of the left front leg, and motor 2 the calf of the right one.
    np.testing.assert_allclose(table.columns["q.FL_hip_joint"], q(K, 3), rtol=1e-6)
    np.testing.assert_allclose(table.columns["q.FR_calf_joint"], q(K, 2), rtol=1e-6)
    assert "in the order of the maker's documentation: q[0] is FR_hip_joint" in table.warnings[0]


def test_a_low_state_has_the_sensor_of_the_base_beside_the_motors(write):
    def state(store, k):
        out = low_state(store, k)
        out.imu_state.gyroscope[:] = 0.1 * k, 1, 2
        out.imu_state.accelerometer[:] = 0, 1, 9.5
        out.foot_force[:] = 20 + 100 * (k % 20 > 9)
        return out

    columns = read_table(write({"/lowstate": ("unitree_go/msg/LowState", state)}), joints=LEGS).columns
    np.testing.assert_allclose(columns["w.imu.x"], 0.1 * K, rtol=1e-6)
    np.testing.assert_allclose(columns["sf.imu.z"], np.full(N, 9.5))
    np.testing.assert_array_equal(columns["contact.RL_foot"], K % 20 > 9)
    np.testing.assert_allclose(columns["q.FL_hip_joint"], q(K, 3), rtol=1e-6)


def test_more_motors_that_move_than_joints_are_refused_with_a_map(write):
    path = write({"/lowstate": ("unitree_go/msg/LowState", low_state)})
    with pytest.raises(LogError, match=r'numbers 20 joints .* and the robot has 2: say in .*\nq\.a: "q\[0\]"') as error:
        read_table(path, joints=("a", "b"))
    assert str(error.value).endswith('q.b: "q[1]"')


def test_ticks_of_another_unit_than_ms_give_way_to_the_times_of_receipt(write):
    path = write({"/lowstate": ("unitree_go/msg/LowState", lambda s, k: low_state(s, k, tick=5 * k + 1))})
    table = read_table(path)
    np.testing.assert_allclose(table.columns["t"], 0.01 * K, atol=1e-12)
    assert "the ticks of /lowstate" in table.warnings[0]


def states_and(kind, make):
    return {"/joint_states": ("sensor_msgs/msg/JointState", lambda s, k: joint_state(s, k, "ab", [q(k), 1])),
            "/asked": (kind, make)}  # fmt: skip


def test_references_of_a_second_topic_hold_until_the_next_one(write):
    # Every third reference is sent, by the same clock.
    topics = states_and("sensor_msgs/msg/JointState", lambda s, k: joint_state(s, k - k % 3, "ba", [0, k - k % 3]))
    columns = read_table(write(topics), topic="/joint_states", ref_topic="/asked").columns
    np.testing.assert_array_equal(columns["q_ref.a"], K - K % 3)


def test_references_without_a_clock_are_aligned_by_the_times_of_receipt(write):
    def numbers(store, k):
        return filled(store, "std_msgs/msg/Float64MultiArray", data=np.array([k, -k], dtype=float))

    path = write(states_and("std_msgs/msg/Float64MultiArray", numbers))
    columns = read_table(path, ref_topic="/asked", columns=None).columns
    np.testing.assert_array_equal(columns["q_ref.a"], K)
    np.testing.assert_array_equal(columns["q_ref.b"], -K)


def test_low_commands_are_references_of_low_states(write):
    def command(store, k):
        motors = [filled(store, "unitree_go/msg/MotorCmd", q=float(k + j)) for j in range(20)]
        return filled(store, "unitree_go/msg/LowCmd", motor_cmd=motors)

    topics = {"/lowstate": ("unitree_go/msg/LowState", low_state), "/lowcmd": ("unitree_go/msg/LowCmd", command)}
    columns = read_table(write(topics), ref_topic="/lowcmd", joints=LEGS).columns
    np.testing.assert_array_equal(columns["q_ref.FL_hip_joint"], K + 3)


def test_states_before_the_first_reference_are_left_out_and_counted(write):
    topics = states_and("sensor_msgs/msg/JointState", lambda s, k: joint_state(s, k + 5, "ab", [k, 0]))
    table = read_table(write(topics), topic="/joint_states", ref_topic="/asked")
    assert len(table.columns["t"]) == N - 5
    assert "5 states before the first reference of /asked were left out" in table.warnings[0]


def test_a_topic_of_a_controller_beside_the_joint_states_is_reported(write):
    topics = states_and(CONTROLLER, controller_state)
    assert "are read with --ref-topic /asked" in read_table(write(topics)).warnings[0]


def test_a_reference_topic_that_is_not_there_is_refused(write):
    path = write(states_and(CONTROLLER, controller_state))
    with pytest.raises(LogError, match=r"has no topic /askd of references: .*did you mean /asked\?"):
        read_table(path, ref_topic="/askd")


@pytest.mark.parametrize("option", ["--topic", "--ref-topic"])
def test_a_topic_of_a_table_is_refused(option, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q.a\n0,1\n")
    with pytest.raises(LogError, match=rf"log\.csv is no bag, so it has no topic /asked: leave {option} out"):
        read_table(path, **{option[2:].replace("-", "_"): "/asked"})


def test_a_topic_of_a_dataset_is_refused(tmp_path):
    # A LeRobot dataset is known by this file alone.
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text("{}")
    with pytest.raises(LogError, match=r"is no bag, so it has no topic /asked: leave --topic out"):
        read_table(tmp_path, topic="/asked")


def test_a_definition_that_makes_millions_of_values_is_refused(write):
    text = "std_msgs/Header header\nfloat64[7] q\nfloat64[7] q_d\nfloat64[7] dq\nfloat64[7] tau_J\nuint8[5000] more\n"
    name = "franka_msgs/msg/FrankaState"
    path = write({"/franka": (name, lambda s, k: filled(s, name, header=header(s, k)))}, definitions={name: text})
    with pytest.raises(LogError, match="definition of franka_msgs/msg/FrankaState has no fields, or an array of more"):
        read_table(path)


def test_a_bag_without_the_definition_of_its_messages_says_how_to_get_it(write):
    name = "franka_msgs/msg/FrankaState"
    path = write({"/franka": (name, lambda s, k: filled(s, name, header=header(s, k)))}, "db3")
    with pytest.raises(LogError, match="does not hold the definition of franka_msgs/msg/FrankaState on /franka"):
        read_table(path)


def test_an_mcap_file_of_other_messages_than_those_of_ros_is_reported(write):
    path = next(write(states_and(CONTROLLER, controller_state)).glob("*.mcap"))
    path.write_bytes(path.read_bytes().replace(b"\x04\0\0\0ros2", b"\x04\0\0\0json", 1))
    with pytest.raises(LogError, match="is an MCAP file of the profile 'json', wanted ros2: JSON and Protobuf are not"):
        read_table(path)
