"""Presets and columns of lists."""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from identification.data.readers.presets import PRESETS, fitting_presets
from identification.data.readers.read_table import read_table
from identification.data.reading import read_recording
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from places import CHECKOUT

N = 60

T = np.arange(N) * 0.01

JOINTS = ("shoulder", "elbow")


def series(shift):
    """One signal a quantity and joint."""
    return np.sin(3 * T + shift) + 2


def text_table(path, names, columns, separator=","):
    rows = [separator.join(names), *(separator.join(repr(float(x)) for x in row) for row in zip(*columns, strict=True))]
    path.write_text("\n".join(rows) + "\n")
    return path


# Preset, name of the time, its unit in s, and by quantity the columns of both joints.
LAYOUTS = [
    ("ur_rtde", "timestamp", 1.0, {"q": "actual_q_{}", "v": "actual_qd_{}", "i": "actual_current_{}",
                                   "q_ref": "target_q_{}", "temp": "joint_temperatures_{}"}),
    ("libfranka", "time", 1e-3, {"q": "state.q[{}]", "v": "state.dq[{}]", "tau": "state.tau_J[{}]",
                                 "q_ref": "state.q_d[{}]"}),
    ("plotjuggler", "__time", 1.0, {"q": "/arm/states/{joint}/position", "tau": "/arm/states/{joint}/effort",
                                    "v": "/arm/states/{joint}/velocity"}),
    ("lowstate", "time", 1.0, {"q": "motor_state[{}].q", "v": "motor_state[{}].dq", "tau": "motor_state[{}].tau_est",
                               "temp": "motor_state[{}].temperature", "q_ref": "motor_cmd[{}].q"}),
    ("lowstate", "__time", 1.0, {"q": "/lowstate/motor_state[{}]/q", "tau": "/lowstate/motor_state[{}]/tau_est"}),
    ("lowstate", "tick", 1e-3, {"q": "motor_state_{}_q", "temp": "motor_state_{}_temperature"}),
    ("mujoco", "time", 1.0, {"q": "qpos[{}]", "v": "qvel[{}]", "tau": "qfrc_actuator[{}]"}),
    ("isaac_lab", "time", 1.0, {"q": "joint_pos_{}", "v": "joint_vel_{}", "tau": "applied_torque_{}",
                                "q_ref": "joint_pos_target_{}"}),
]  # fmt: skip


@pytest.mark.parametrize(("preset", "time", "unit", "layout"), LAYOUTS, ids=[f"{p}-{t}" for p, t, _, _ in LAYOUTS])
def test_a_preset_reads_its_layout_for_any_names_of_joints(tmp_path, preset, time, unit, layout):
    names, columns, truth = [time], [T / unit], {"t": T}
    for k, (quantity, pattern) in enumerate(layout.items()):
        for j, joint in enumerate(JOINTS):
            names.append(pattern.format(j, joint=joint))
            columns.append(series(2 * k + j))
            truth[f"{quantity}.{joint}"] = columns[-1]
    found = read_table(text_table(tmp_path / "log.csv", names, columns), columns=preset, joints=JOINTS)
    assert set(found.columns) == set(truth)
    for name, values in truth.items():
        np.testing.assert_allclose(found.columns[name], values, rtol=1e-14)


def test_the_order_that_numbers_were_taken_in_is_reported(tmp_path):
    path = text_table(tmp_path / "log.csv", ["timestamp", "actual_q_0", "actual_q_1"], [T, series(0), series(1)])
    (sentence,) = read_table(path, columns="ur_rtde", joints=JOINTS).warnings
    assert "taken in the robot's order: actual_q_0 is shoulder, actual_q_1 is elbow" in sentence


def test_without_a_robot_numbers_are_the_names(tmp_path):
    path = text_table(tmp_path / "log.csv", ["timestamp", "actual_q_0", "actual_q_1"], [T, series(0), series(1)])
    assert set(read_table(path, columns="ur_rtde").columns) == {"t", "q.0", "q.1"}


def test_numbers_that_are_always_zero_beyond_the_robots_joints_are_left_out(tmp_path):
    names = ["time", *(f"motor_state[{k}].q" for k in range(4))]
    path = text_table(tmp_path / "log.csv", names, [T, series(0), series(1), 0 * T, 0 * T])
    assert set(read_table(path, columns="lowstate", joints=JOINTS).columns) == {"t", "q.shoulder", "q.elbow"}


def test_a_number_that_no_position_has_is_refused(tmp_path):
    path = text_table(tmp_path / "log.csv", ["timestamp", "actual_q_0", "actual_current_7"], [T, series(0), series(1)])
    with pytest.raises(LogError, match="has actual_current_7, and no position has that number"):
        read_table(path, columns="ur_rtde", joints=("j",))


def test_an_unknown_preset_lists_them(tmp_path):
    path = text_table(tmp_path / "log.csv", ["t", "q.j"], [T, series(0)])
    with pytest.raises(
        LogError, match="ur_rtd is neither a file with a column map nor a preset: the presets are"
    ) as it:
        read_table(path, columns="ur_rtd")
    assert f"the presets are {', '.join(PRESETS)}" in str(it.value)
    assert "did you mean ur_rtde?" in str(it.value)


def test_a_preset_that_does_not_fit_says_what_it_wants(tmp_path):
    path = text_table(tmp_path / "log.csv", ["timestamp", "pos"], [T, series(0)])
    with pytest.raises(LogError, match=r"ur_rtde: log\.csv has no position as that preset names it \(actual_q"):
        read_table(path, columns="ur_rtde")


def test_two_topics_that_fit_are_refused(tmp_path):
    names = ["__time", "/a/j/position", "/b/j/position"]
    path = text_table(tmp_path / "log.csv", names, [T, series(0), series(1)])
    with pytest.raises(LogError, match=r"has several topics that fit it \(/a, /b\)"):
        read_table(path, columns="plotjuggler")


def test_bam_is_of_one_joint(tmp_path):
    names = ["timestamp", "position", "speed", "load", "goal_position", "temp"]
    path = text_table(tmp_path / "log.csv", names, [T, *(series(k) for k in range(5))])
    found = read_table(path, columns="bam", joints=("pin",)).columns
    np.testing.assert_allclose(found["q_ref.pin"], series(3), rtol=1e-14)
    assert set(found) == {"t", "q.pin", "v.pin", "q_ref.pin", "temp.pin"}
    with pytest.raises(LogError, match=r"is of one joint and the robot has 2 \(shoulder, elbow\)"):
        read_table(path, columns="bam", joints=JOINTS)


@pytest.mark.parametrize("number", ["_{}", "[{}]"])
def test_currents_of_a_known_layout_ask_for_the_constants_in_the_sentence_that_names_it(tmp_path, number):
    robot = load_robot(CHECKOUT / "tests" / "robots" / "planar2.urdf")
    names = [f"actual_{quantity}{number.format(j)}" for quantity in ("q", "current") for j in range(2)]
    path = text_table(tmp_path / "log.csv", ["timestamp", *names], [T, *(series(k) for k in range(4))])
    with pytest.raises(LogError, match=r"read as --columns ur_rtde: .* add torque_constant and gear_ratio of shoulder"):
        read_recording(path, robot)


def test_a_known_layout_is_read_without_being_named_and_said(tmp_path):
    robot = load_robot(CHECKOUT / "tests" / "robots" / "planar2.urdf")
    names = [f"state.{quantity}[{j}]" for quantity in ("q", "tau_J") for j in range(2)]
    columns = [0.1 * np.sin(3 * T + k) for k in range(4)]
    found = read_recording(text_table(tmp_path / "log.csv", ["time", *names], [1e3 * T, *columns]), robot)
    np.testing.assert_allclose(found.t, T, atol=1e-12)
    np.testing.assert_allclose(found.tau, np.column_stack(columns[2:]))
    assert any("its columns are those of --columns libfranka" in warning for warning in found.warnings)


@pytest.mark.parametrize(("preset", "time", "unit", "layout"), LAYOUTS, ids=[f"{p}-{t}" for p, t, _, _ in LAYOUTS])
def test_every_layout_is_recognised_as_its_own(preset, time, unit, layout):
    names = [time, *(pattern.format(j, joint=joint) for pattern in layout.values() for j, joint in enumerate(JOINTS))]
    assert fitting_presets(names) == (preset,)


@pytest.fixture
def sage(data_folder, tmp_path):
    """The real recording of SAGE in the layout of its state_motor.csv, times in us, and its data."""
    with np.load(data_folder / "sage_so101" / "so101.npz") as data:
        motion = {name: data[f"multisine__{name}"][:500] for name in ("t", "q", "dq", "tau_est", "t_cmd", "q_cmd")}
    state = ["type,timestamp,positions,velocities,torques"]
    state += [
        f'STATE_MOTOR,{1e6 * float(t)},"{list(map(float, q))}","{list(map(float, v))}","{list(map(float, tau))}"'
        for t, q, v, tau in zip(*(motion[name] for name in ("t", "q", "dq", "tau_est")), strict=True)
    ]
    (tmp_path / "state_motor.csv").write_text("\n".join(state))
    control = [
        f'CONTROL,{1e6 * float(t)},"{list(map(float, q))}"'
        for t, q in zip(motion["t_cmd"], motion["q_cmd"], strict=True)
    ]
    (tmp_path / "control.csv").write_text("\n".join(["type,timestamp,positions", *control]))
    (tmp_path / "joint_list.txt").write_text("Rotation\nPitch\nElbow\nWrist_Pitch\nWrist_Roll\nJaw\n")
    return tmp_path / "state_motor.csv", motion


def test_a_motion_of_sage_is_read_with_its_names_and_references(sage):
    path, motion = sage
    found = read_table(path, columns="sage", joints=("a", "b")).columns
    np.testing.assert_allclose(found["q.Elbow"], motion["q"][:, 2], rtol=1e-6)
    np.testing.assert_allclose(found["tau.Jaw"], motion["tau_est"][:, 5], rtol=1e-6)
    np.testing.assert_allclose(found["t"], motion["t"], rtol=1e-9)
    held = motion["q_cmd"][np.searchsorted(motion["t_cmd"], motion["t"], side="right") - 1]
    np.testing.assert_allclose(found["q_ref.Pitch"], held[:, 1], rtol=1e-6)


def test_a_control_file_of_another_kind_is_refused(sage):
    path, _ = sage
    (path.parent / "control.csv").write_text("a,b\n1,2\n")
    with pytest.raises(LogError, match=r"so it is no control\.csv of SAGE"):
        read_table(path, columns="sage")


Q = np.sin(np.outer(T, [3.0, 5.0])) + 1

TAU = np.cos(np.outer(T, [3.0, 5.0])) + 2


def test_arrays_of_an_npz_take_the_names_that_stand_beside_them(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=TAU, joint_names=np.array(["elbow", "wrist"]))
    columns = read_table(tmp_path / "log.npz").columns
    np.testing.assert_array_equal(columns["q.wrist"], Q[:, 1])
    np.testing.assert_array_equal(columns["tau.elbow"], TAU[:, 0])


def test_names_of_joints_make_a_preset_need_no_order(tmp_path):
    np.savez(tmp_path / "log.npz", time=T, joint_pos=Q, applied_torque=TAU, joint_names=np.array(["wrist", "elbow"]))
    table = read_table(tmp_path / "log.npz", columns="isaac_lab", joints=("elbow", "wrist"))
    np.testing.assert_array_equal(table.columns["q.wrist"], Q[:, 0])
    assert table.warnings == ()


def test_without_names_they_are_asked_for_with_a_map_that_reads_the_file(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, q=Q, tau=TAU)
    robot = load_robot(CHECKOUT / "tests" / "robots" / "planar2.urdf")
    with pytest.raises(LogError, match="A map to begin with") as refusal:
        read_recording(tmp_path / "log.npz", robot)
    (tmp_path / "columns.yaml").write_text(str(refusal.value).partition("columns.yaml:\n")[2])
    found = read_table(tmp_path / "log.npz", columns=tmp_path / "columns.yaml").columns
    np.testing.assert_array_equal(found[f"q.{robot.joint_names[1]}"], Q[:, 1])


def test_one_entry_of_a_map_takes_all_places_of_a_list(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, angles=np.rad2deg(Q))
    (tmp_path / "columns.yaml").write_text('q: {from: "angles[{number}]", unit: deg}\n')
    found = read_table(tmp_path / "log.npz", columns=tmp_path / "columns.yaml", joints=("a", "b")).columns
    np.testing.assert_allclose(found["q.b"], Q[:, 1], rtol=1e-14)


@pytest.mark.parametrize("kind", [pa.list_(pa.float32()), pa.list_(pa.float64(), 2), pa.large_list(pa.float64())])
def test_lists_in_parquet_become_columns(tmp_path, kind):
    pq.write_table(pa.table({"t": T, "angles": pa.array(Q.tolist(), kind)}), tmp_path / "log.parquet")
    (tmp_path / "columns.yaml").write_text('q: "angles[{number}]"\n')
    found = read_table(tmp_path / "log.parquet", columns=tmp_path / "columns.yaml", joints=("a", "b")).columns
    np.testing.assert_allclose(found["q.b"], Q[:, 1], rtol=1e-6)


@pytest.mark.parametrize("form", ["[{}, {}]", "[{} {}]", "[ {},{} ]"])
def test_lists_in_cells_become_columns(tmp_path, form):
    rows = [f'{t},"{form.format(*map(float, q))}"' for t, q in zip(T, Q, strict=True)]
    (tmp_path / "log.csv").write_text("\n".join(["t,angles", *rows]))
    (tmp_path / "columns.yaml").write_text('q: "angles[{number}]"\n')
    found = read_table(tmp_path / "log.csv", columns=tmp_path / "columns.yaml", joints=("a", "b")).columns
    np.testing.assert_allclose(found["q.b"], Q[:, 1], rtol=1e-14)


@pytest.mark.parametrize("cell", ["[1, 2, 3]", "[1, x]", "3", "[]"])
def test_a_cell_with_another_list_is_reported_with_its_line(tmp_path, cell):
    rows = [f'{t},"{cell if k == 7 else [0.5, 1.5]}"' for k, t in enumerate(T)]
    (tmp_path / "log.csv").write_text("\n".join(["t,angles", *rows]))
    (tmp_path / "columns.yaml").write_text("q.a: angles\n")
    with pytest.raises(LogError, match=r"log\.csv, line 9, column angles holds .*, wanted a list of 2 numbers"):
        read_table(tmp_path / "log.csv", columns=tmp_path / "columns.yaml")


def test_an_image_is_no_list_of_joints(tmp_path):
    np.savez(tmp_path / "log.npz", t=T, image=np.zeros((N, 640)))
    (tmp_path / "columns.yaml").write_text("q.a: image\n")
    with pytest.raises(LogError, match=r"array image has the shape \(60, 640\)"):
        read_table(tmp_path / "log.npz", columns=tmp_path / "columns.yaml")


def test_lists_that_differ_in_length_are_reported(tmp_path):
    lists = [[1.0, 2.0]] * (N - 1) + [[1.0]]
    pq.write_table(pa.table({"t": T, "angles": lists}), tmp_path / "log.parquet")
    (tmp_path / "columns.yaml").write_text("q.a: angles\n")
    with pytest.raises(LogError, match="holds lists of 2 numbers in row 1 and 1 in row 60"):
        read_table(tmp_path / "log.parquet", columns=tmp_path / "columns.yaml")
