"""Logs without a time column, recordings in several files, duties and references of velocity."""

import numpy as np
import pytest

from identification.data.readers.read_table import read_table
from identification.data.reading import read_recording
from identification.scenarios.recordings_file import read_changed, read_changes
from phantom_dyn.errors import LogError, ParameterError
from phantom_dyn.model.loading import load_robot
from places import ROBOTS

RATE = 125.0


T = np.arange(1500) / RATE


JOINTS = ("shoulder", "elbow")


Q = 0.4 * np.sin(np.outer(T, [2.1, 3.7]))


TAU = 3.0 * np.cos(np.outer(T, [2.1, 3.7]) + 0.2)


def written(path, columns):
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="")
    return path


def mapped(folder, text):
    path = folder / "columns.yaml"
    path.write_text(text)
    return path


def both(quantity, values):
    return {f"{quantity}.{joint}": values[:, k] for k, joint in enumerate(JOINTS)}


def test_a_log_without_time_gets_that_of_the_rate_in_the_map(tmp_path):
    log = written(tmp_path / "log.csv", both("q", Q) | both("tau", TAU))
    table = read_table(log, columns=mapped(tmp_path, f"rate: {RATE}\n"))
    np.testing.assert_allclose(table.columns["t"], T)


def test_a_log_without_time_says_how_to_state_its_rate(tmp_path):
    with pytest.raises(LogError, match="write rate: 100"):
        read_table(written(tmp_path / "log.csv", both("q", Q)))


def test_a_rate_beside_a_time_is_refused(tmp_path):
    log = written(tmp_path / "log.csv", {"t": T} | both("q", Q))
    with pytest.raises(LogError, match="has a column t: leave rate out"):
        read_table(log, columns=mapped(tmp_path, "rate: 125\n"))
    with pytest.raises(LogError, match="both rate and t"):
        read_table(log, columns=mapped(tmp_path, "rate: 125\nt: t\n"))


@pytest.mark.parametrize("rate", ["0", "fast", "true", "-5"])
def test_a_rate_that_is_none_is_refused(tmp_path, rate):
    with pytest.raises(LogError, match="wanted the rows a second"):
        read_table(written(tmp_path / "log.csv", both("q", Q)), columns=mapped(tmp_path, f"rate: {rate}\n"))


def test_files_of_one_recording_stand_side_by_side(tmp_path):
    positions = written(tmp_path / "pos.csv", {"t": T} | both("q", Q))
    torques = written(tmp_path / "torque.csv", {"t": T} | both("tau", TAU))
    found = read_recording((positions, torques), load_robot(ROBOTS / "planar2.urdf"))
    np.testing.assert_allclose(found.q, Q)
    np.testing.assert_allclose(found.tau, TAU)


def test_names_that_both_files_have_get_that_of_their_file(tmp_path):
    names = dict(zip(("joint0", "joint1"), Q.T, strict=True)), dict(zip(("joint0", "joint1"), TAU.T, strict=True))
    files = [written(tmp_path / f"{name}.csv", own) for name, own in zip(("pos", "torque"), names, strict=True)]
    columns = mapped(tmp_path, 'rate: 125\nq: "pos/joint{number}"\ntau: "torque/joint{number}"\n')
    table = read_table(files, columns=columns, joints=JOINTS)
    np.testing.assert_allclose(table.columns["q.elbow"], Q[:, 1])
    np.testing.assert_allclose(table.columns["tau.shoulder"], TAU[:, 0])


def test_files_of_other_rows_or_times_are_refused(tmp_path):
    positions = written(tmp_path / "pos.csv", {"t": T} | both("q", Q))
    with pytest.raises(LogError, match="need the same rows"):
        read_table((positions, written(tmp_path / "short.csv", both("tau", TAU[:-1]))))
    with pytest.raises(LogError, match="different times"):
        read_table((positions, written(tmp_path / "late.csv", {"t": T + 0.1} | both("tau", TAU))))


def test_recordings_yaml_names_the_files_of_a_recording(tmp_path):
    positions = written(tmp_path / "pos.csv", {"t": T} | both("q", Q))
    written(tmp_path / "torque.csv", both("tau", TAU))
    path = tmp_path / "recordings.yaml"
    path.write_text("recordings: [{files: [pos.csv, torque.csv]}]\n")
    robot = load_robot(ROBOTS / "planar2.urdf")
    (change,) = read_changes(path, [positions], robot.joint_names)
    np.testing.assert_allclose(read_changed(positions, robot, change).tau, TAU)
    path.write_text("recordings: [{files: [pos.csv, gone.csv]}]\n")
    with pytest.raises(ParameterError, match=r"gone[.]csv, which does not exist"):
        read_changes(path, [positions], robot.joint_names)


def driven(folder):
    config = folder / "robot.yaml"
    drive = "{torque_constant: 0.05, gear_ratio: 50, resistance: 2.0}"
    config.write_text("joints:\n" + "".join(f"  {joint}: {drive}\n" for joint in JOINTS))
    return load_robot(ROBOTS / "planar2.urdf", config=config)


def test_a_duty_of_the_supply_is_a_voltage(tmp_path):
    duty, supply = 0.3 * np.sin(np.outer(T, [1.0, 1.7])), 24.0 - 0.1 * T
    speed = {"v.shoulder": 0.0 * T, "v.elbow": 0.0 * T}
    log = written(tmp_path / "log.csv", {"t": T, "supply": supply} | both("q", Q) | both("duty", duty) | speed)
    found = read_recording(log, driven(tmp_path), torque_needed=True)
    np.testing.assert_allclose(found.voltage, duty * supply[:, None])
    # Closed form at standstill: the voltage over the resistance, times the constant and the gear.
    np.testing.assert_allclose(found.tau, duty * supply[:, None] / 2.0 * 0.05 * 50)


def test_a_duty_in_percent_is_reported_and_mapped(tmp_path):
    duty = 30.0 * np.sin(np.outer(T, [1.0, 1.7]))
    log = written(tmp_path / "log.csv", {"t": T, "supply": 24.0 + 0.0 * T} | both("q", Q) | both("duty", duty))
    with pytest.raises(LogError, match="unit: percent"):
        read_recording(log, driven(tmp_path))
    columns = mapped(tmp_path, 'duty: {from: "duty.{joint}", unit: percent}\n')
    np.testing.assert_allclose(read_recording(log, driven(tmp_path), columns=columns).voltage, 0.24 * duty)


def test_a_duty_without_the_supply_is_said_not_to_be_used(tmp_path):
    log = written(tmp_path / "log.csv", {"t": T} | both("q", Q) | both("tau", TAU) | both("duty", 0.1 * Q))
    warnings = read_recording(log, load_robot(ROBOTS / "planar2.urdf")).warnings
    assert any("needs a column supply" in warning for warning in warnings)


def test_references_of_velocities_are_read(tmp_path):
    log = written(tmp_path / "log.csv", {"t": T} | both("q", Q) | both("tau", TAU) | both("v_ref", 2.0 * Q))
    found = read_recording(log, load_robot(ROBOTS / "planar2.urdf"))
    np.testing.assert_allclose(found.v_ref, 2.0 * Q)
    assert not any("not used" in warning for warning in found.warnings)
