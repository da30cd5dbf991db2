"""Logs of closed chains. Oracle: positions that were put in, and expressions of the parallelogram."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.checks.positions import check_passive
from identification.data.reading import recording
from identification.data.recording import Recording, Table
from phantom_dyn import load_robot
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot
from places import ROBOTS

T = np.arange(100) * 0.01
CRANK = np.sin(T)


@pytest.fixture
def parallelogram(tmp_path) -> Robot:
    config = tmp_path / "chain.yaml"
    config.write_text("loops: [{kind: linear, active: [crank], passive: {coupler: -crank, rocker: crank}}]")
    return load_robot(ROBOTS / "parallelogram.urdf", config=config)


def logged(robot: Robot, **columns: np.ndarray) -> Recording:
    given = {"t": T, "q.crank": CRANK, "tau.crank": np.cos(T)}
    return recording(Table("log.csv", given | {name.replace("__", "."): c for name, c in columns.items()}), robot)


def test_a_log_holds_the_active_joints(parallelogram):
    found = logged(parallelogram)
    assert (found.joint_names, found.q.shape, dict(found.passive_q)) == (("crank",), (100, 1), {})


def test_positions_of_passive_joints_are_kept(parallelogram):
    np.testing.assert_array_equal(logged(parallelogram, q__coupler=-CRANK).passive_q["coupler"], -CRANK)


def test_passive_joints_where_the_loops_put_them_are_no_warning(parallelogram):
    found = logged(parallelogram, q__coupler=-CRANK, q__rocker=CRANK + 2 * np.pi)
    assert check_passive(found, parallelogram) == ()


def test_a_passive_joint_elsewhere_is_told_with_its_distance(parallelogram):
    (sentence,) = check_passive(logged(parallelogram, q__rocker=CRANK + 0.1), parallelogram)
    assert sentence.startswith("log.csv: the measured position of rocker is 0.1 rad (rms) from where the loops of")


def test_torque_of_a_passive_joint_is_told_and_not_used(parallelogram):
    found = logged(parallelogram, tau__rocker=np.ones(100))
    assert "log.csv: the torque of rocker is not used, as the joint is passive: it has no drive." in found.warnings


def test_zero_torque_of_a_passive_joint_is_no_warning(parallelogram):
    assert logged(parallelogram, tau__rocker=np.zeros(100)).warnings == ()


def test_a_column_of_an_unknown_joint_lists_the_passive_ones_too(parallelogram):
    with pytest.raises(LogError, match=r"q\.rock is of the joint rock, .*: the joints are crank, coupler, rocker; did"):
        logged(parallelogram, q__rock=CRANK)


def test_a_log_beyond_the_reach_of_the_loops_is_refused(tmp_path):
    config = tmp_path / "chain.yaml"
    loop = "kind: point, frame_a: coupler_pin, frame_b: rocker_pin, active: [rocker], start: {crank: 0.1}"
    config.write_text(f"loops: [{{{loop}}}]")
    robot = load_robot(ROBOTS / "fourbar.urdf", config=config)
    q = np.linspace(-0.2, 1.5, 100)
    log = recording(Table("log.csv", {"t": T, "q.rocker": q, "tau.rocker": np.cos(T)}), robot)
    with pytest.raises(LogError, match=r"^log\.csv: The loop loops\[0\] .* cannot be closed at sample \d+: its frames"):
        check_passive(log, robot)
