"""Good files to start from: a robot, its recording in every format, and every YAML and JSON file that commands read."""

import io
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from known_effects import EFFECTS_OF_THE_PENDULUM
from places import ROBOTS
from sines import rubbing_columns

RATE, SECONDS = 100.0, 8.0
_JOINT_STATE = "sensor_msgs/msg/JointState"
ROBOT_YAML = """\
gravity: [0, 0, -9.81]
torque_hold: zoh
torque_source: command
tolerance: {inertia: 0.05, friction: 0.05, rotor_inertia: 0.10}
joints:
  pin: {rotor_inertia: 2.0e-3, gear_ratio: 10, torque_constant: 0.06, torque_limit: 50.0, encoder_counts: 65536,
        encoder_side: motor, actuated: true, resistance: 4.0, voltage_limit: 7.4,
        controller: {kind: pd, kp: 40, kd: 1.0, delay: 0.001}}
lock: []
"""
LOOP_YAML = """\
tolerance: {inertia: 0.05}
joints:
  elbow: {rotor_inertia: 1.0e-3, actuated: false}
loops:
  - {kind: linear, active: [shoulder], passive: {elbow: "0.5 * shoulder + 0.1"}}
"""
COLUMNS_YAML = """\
t: {from: time, unit: ms}
q.pin: {from: angle, unit: deg, sign: 1}
tau.pin: {from: load, unit: Nmm, gear: 1, low_pass: 20, compensated: gravity}
ignore: [spare]
"""
RECORDINGS_YAML = """\
recordings:
  - {file: log.csv, payload: {mass: 0.5, center: [0, 0, 0.1]}, changed: [friction], exclude: [[2.5, 3]]}
  - {file: other.csv, controller: {kp: 40, kd: 1, delay: 0.0}, changed: [controller]}
"""


@dataclass(frozen=True)
class Seeds:
    """Good files, by name, and the columns of the recordings."""

    texts: dict[str, str]
    bytes: dict[str, bytes]
    columns: dict[str, np.ndarray]


def made_columns(robot_file: Path, seed: int = 0) -> dict[str, np.ndarray]:
    """A recording of a robot that has more Coulomb friction than its model."""
    return rubbing_columns(robot_file, seconds=SECONDS, rate=RATE, seed=seed)


def csv_text(columns: dict[str, np.ndarray]) -> str:
    """Columns as CSV."""
    sink = io.StringIO()
    np.savetxt(sink, np.column_stack(list(columns.values())), "%.9g", ",", header=",".join(columns), comments="")
    return sink.getvalue()


def make_seeds(folder: Path) -> Seeds:
    """Good files, made with the libraries of their formats.

    Args:
        folder: An empty one, for bags, which are written to disk.
    """
    columns = made_columns(ROBOTS / "pendulum.urdf")
    mapped = {"time": columns["t"] * 1e3, "angle": np.rad2deg(columns["q.pin"]), "load": columns["tau.pin"] * 1e3}
    texts = {name: (ROBOTS / name).read_text() for name in ("pendulum.urdf", "planar2.urdf", "arm3.xml", "fourbar.xml")}
    texts |= {
        "robot.yaml": ROBOT_YAML,
        "loop.yaml": LOOP_YAML,
        "columns.yaml": COLUMNS_YAML,
        "recordings.yaml": RECORDINGS_YAML,
        "corrected.yaml": EFFECTS_OF_THE_PENDULUM,
        "log.csv": csv_text(columns),
        "other.csv": csv_text(made_columns(ROBOTS / "pendulum.urdf", 1)),
        "mapped.csv": csv_text(mapped | {"spare": columns["t"]}),
        "planar2.csv": csv_text(made_columns(ROBOTS / "planar2.urdf")),
        "arm3.csv": csv_text(made_columns(ROBOTS / "arm3.xml")),
        "fourbar.csv": csv_text(made_columns(ROBOTS / "fourbar.xml")),
    }
    sink = io.BytesIO()
    pq.write_table(pa.table(columns), sink)
    data = {"log.parquet": sink.getvalue()} | {f"log.{kind}": _bag(folder, kind, columns) for kind in _BAGS}
    return Seeds(texts, data, columns)


_BAGS = ("bag", "db3", "mcap")


def _bag(folder: Path, kind: str, columns: dict[str, np.ndarray]) -> bytes:
    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    types, path = store.types, folder / ("log.bag" if kind == "bag" else kind)
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer1(path) if kind == "bag" else Writer2(path, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/joint_states", _JOINT_STATE, typestore=store)
        for k, t in enumerate(np.rint(columns["t"] * 1e9).astype(int).tolist()):
            stamp = types["builtin_interfaces/msg/Time"](sec=t // 10**9, nanosec=t % 10**9)
            seq = {"seq": k} if kind == "bag" else {}
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **seq)
            q, tau = np.array([columns["q.pin"][k]]), np.array([columns["tau.pin"][k]])
            state = types[_JOINT_STATE](header=header, name=["pin"], position=q, velocity=np.zeros(0), effort=tau)
            raw = (store.serialize_ros1 if kind == "bag" else store.serialize_cdr)(state, _JOINT_STATE)
            writer.write(connection, t + 1, raw)
    file = path if kind == "bag" else next(path.glob(f"*.{kind}"))
    out = file.read_bytes()
    file.unlink() if kind == "bag" else shutil.rmtree(path)
    return out
