"""Checks of drives and of passive joints."""

import re
from dataclasses import replace

import numpy as np
import pytest

from identification.data.checks.drive_loops import check_computed, check_controllers, loop_sentences
from identification.data.checks.positions import check_passive
from identification.data.reading import recording
from identification.data.recording import Recording, Table
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Controller, Robot
from places import ROBOTS

T = np.arange(2000) / 100.0

Q_REF = 0.6 * np.sin(1.9 * T) + 0.3 * np.sin(4.1 * T)

Q = 0.9 * (0.6 * np.sin(1.9 * (T - 0.1)) + 0.3 * np.sin(4.1 * (T - 0.1)))


def late(delay: float) -> np.ndarray:
    return 0.6 * np.sin(1.9 * (T - delay)) + 0.3 * np.sin(4.1 * (T - delay))


@pytest.fixture(scope="module")
def robot() -> Robot:
    """A rod on a motor of 0.5 N m/V."""
    found = load_robot(ROBOTS / "pendulum.urdf")
    drive = replace(found.actuators[0], torque_constant=1.0, resistance=2.0, controller=Controller(kp=12.0))
    return replace(found, actuators=(drive,))


def read(robot: Robot, **columns: np.ndarray) -> Recording:
    return recording(Table("a.csv", {"t": T, "q.pin": Q, "q_ref.pin": Q_REF, **columns}), robot)


def test_a_voltage_that_was_computed_is_said_to_be(robot):
    found = read(robot, **{"u.pin": 24.0 * (Q_REF - Q)})
    assert "it was computed, not measured" not in check_controllers(found, robot)
    assert "u.pin was computed from reference and position" in check_computed(found)[0]
    assert "gain 24" in loop_sentences(found)[0]


def test_a_voltage_that_was_measured_has_its_delay(robot, rng):
    found = read(robot, **{"u.pin": 24.0 * (late(0.03) - Q) + 0.1 * rng.standard_normal(len(T))})
    assert check_computed(found) == ()
    stated = re.search(r"its reference ([\d.]+) ± ([\d.]+) ms late", loop_sentences(found)[0])
    assert stated is not None
    assert float(stated[1]) == pytest.approx(30.0, abs=3 * float(stated[2]))


def test_a_held_reference_is_late_by_a_time_within_a_frame(robot, rng):
    held = replace(robot, reference_hold="zoh")
    found = read(held, **{"u.pin": 24.0 * (late(0.03) - Q) + 0.01 * rng.standard_normal(len(T))})
    stated = re.search(r"its reference ([\d.]+) to ([\d.]+) ± [\d.]+ ms late", loop_sentences(found)[0])
    assert stated is not None
    assert [float(x) for x in stated.groups()] == pytest.approx([20.0, 30.0], abs=1.5)


def test_protection_is_said_with_its_error(robot):
    error = late(0.03) - Q
    found = read(robot, **{"u.pin": np.where(np.abs(error) > 0.15, 0.8 * np.sign(error), 24.0 * error)})
    assert re.search(r"no more than 0\.8 V beyond an error of 0\.15, for \d+ % of the time", loop_sentences(found)[0])


def test_a_torque_that_follows_a_law_makes_no_late_reference(robot):
    # Whoever commands a torque knows the reference at that instant.
    assert read(robot, **{"tau.pin": 12.0 * (Q_REF - Q)}).follows is None


def test_a_controller_that_gives_the_logged_torque_is_not_doubted(robot):
    assert check_controllers(read(robot, **{"tau.pin": 12.0 * (late(0.03) - Q)}), robot) == ()


@pytest.mark.parametrize("factor", [0.4, 2.5])
def test_gains_that_do_not_give_the_logged_torque_are_named(robot, factor):
    (sentence,) = check_controllers(read(robot, **{"tau.pin": factor * 12.0 * (Q_REF - Q)}), robot)
    assert f"{factor:.3g} times what it asks for explains 100 %" in sentence


def test_a_torque_that_no_controller_makes_is_named(robot, rng):
    (sentence,) = check_controllers(read(robot, **{"tau.pin": np.sin(9 * T) + rng.standard_normal(len(T))}), robot)
    assert "does not give its logged torque" in sentence


SECONDS = np.arange(100) * 0.01

CRANK = np.sin(SECONDS)


@pytest.fixture
def parallelogram(tmp_path) -> Robot:
    config = tmp_path / "chain.yaml"
    config.write_text("loops: [{kind: linear, active: [crank], passive: {coupler: -crank, rocker: crank}}]")
    return load_robot(ROBOTS / "parallelogram.urdf", config=config)


def logged(robot: Robot, **columns: np.ndarray) -> Recording:
    given = {"t": SECONDS, "q.crank": CRANK, "tau.crank": np.cos(SECONDS)}
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
    log = recording(Table("log.csv", {"t": SECONDS, "q.rocker": q, "tau.rocker": np.cos(SECONDS)}), robot)
    with pytest.raises(LogError, match=r"^log\.csv: The loop loops\[0\] .* cannot be closed at sample \d+: its frames"):
        check_passive(log, robot)
