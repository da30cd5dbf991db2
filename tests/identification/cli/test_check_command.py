"""The command check. Oracle: the contract (what it prints, exit code 2 with one sentence for bad input)."""

import re

import numpy as np
import pytest

from identification.cli.main import main
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS

ARM = ROBOTS / "arm3.urdf"


@pytest.fixture
def log(tmp_path):
    """A clean recording of the arm, 10 s at 200 Hz."""
    robot = load_robot(ARM)
    t = np.arange(2000) / 200
    w = 2 * np.pi * np.array([0.7, 0.9, 1.1])
    q, v, a = 0.3 * np.sin(np.outer(t, w)), 0.3 * w * np.cos(np.outer(t, w)), -0.3 * w**2 * np.sin(np.outer(t, w))
    tau = inverse_dynamics(robot, Motion(t, q, v, a))
    columns = {f"q.{n}": q[:, k] for k, n in enumerate(robot.joint_names)}
    columns |= {f"tau.{n}": tau[:, k] for k, n in enumerate(robot.joint_names)}
    path = tmp_path / "log.csv"
    rows = np.column_stack([t, *columns.values()])
    np.savetxt(path, rows, delimiter=",", header=",".join(["t", *columns]), comments="", fmt="%.9g")
    return path


def test_a_clean_log_is_said_to_be_so(log, capsys):
    assert main(["check", str(log), "--robot", str(ARM)]) == 0
    assert capsys.readouterr().out == (
        "log.csv: 2000 samples, 9.995 s, 200 Hz\njoints: turn, tilt, slide\nnothing is wrong with it\n"
    )


def test_without_a_robot_it_says_that_less_is_checked(log, capsys):
    assert main(["check", str(log)]) == 0
    assert "nothing is wrong with it, as far as can be seen without a robot" in capsys.readouterr().out


def test_warnings_are_printed_and_the_job_is_done(log, capsys):
    log.write_text(log.read_text().replace("tau.tilt", "load"))
    assert main(["check", str(log)]) == 0
    assert "warning: log.csv: column load not used" in capsys.readouterr().out


def test_a_joint_that_the_map_misspells_is_reported_before_what_the_log_lacks(log, tmp_path, capsys):
    (tmp_path / "map.yaml").write_text("q.tild: q.tilt\n")
    log.write_text(log.read_text().replace("t,", "time,", 1))
    assert main(["check", str(ARM), str(log), "--columns", str(tmp_path / "map.yaml")]) == 2
    assert re.search(
        r"map\.yaml: q\.tild is of the joint tild, which the robot does not have: .*; did you mean tilt\?",
        capsys.readouterr().err,
    )


def test_what_a_log_lacks_is_reported_beside_its_own_columns_and_not_those_of_the_map(log, tmp_path, capsys):
    (tmp_path / "map.yaml").write_text("tau.tilt: load\n")
    log.write_text(log.read_text().replace("tau.tilt", "load").replace("t,", "time,", 1))
    assert main(["check", str(ARM), str(log), "--columns", str(tmp_path / "map.yaml")]) == 2
    said = capsys.readouterr().err
    assert "log.csv has no column t" in said
    assert "load" in said
    assert "tau.tilt" not in said


def test_columns_are_mapped(log, tmp_path, capsys):
    log.write_text(log.read_text().replace("tau.tilt", "load"))
    (tmp_path / "map.yaml").write_text("tau.tilt: load\n")
    assert main(["check", str(log), "--robot", str(ARM), "--columns", str(tmp_path / "map.yaml")]) == 0
    assert "nothing is wrong" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["{log}", "--robot-config", "robot.yaml"], "--robot-config was given without a robot"),
        (["{log}", "--robot", "nosuch.urdf"], "There is no robot file 'nosuch.urdf'"),
        ([str(ARM)], "a robot without a recording: name a recording after it"),
        (["{folder}/lag.csv"], "lag.csv does not exist; did you mean log.csv?\n"),
    ],
)
def test_what_is_missing_is_reported_in_one_sentence(log, capsys, words, said):
    assert main(["check", *(word.format(log=log, folder=log.parent) for word in words)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("phantom-dyn: ")
    assert error.count("\n") == 1
    assert said in error


def test_warnings_about_the_robot_are_printed(log, tmp_path, capsys):
    (tmp_path / "robot.urdf").write_text(ARM.read_text().replace('izz="0.04"', 'izz="0.4"'))
    assert main(["check", str(log), "--robot", str(tmp_path / "robot.urdf")]) == 0
    assert "no rigid body has the inertia of link column" in capsys.readouterr().out


def test_nothing_is_written(log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    main(["check", "log.csv", "--robot", str(ARM)])
    assert [path.name for path in tmp_path.iterdir()] == ["log.csv"]


def test_the_robot_stands_in_front_of_the_recordings(log, tmp_path, capsys):
    second = tmp_path / "second.csv"
    second.write_bytes(log.read_bytes())
    assert main(["check", str(ARM), str(log), str(second)]) == 0
    said = capsys.readouterr().out
    assert said.count("nothing is wrong with it\n") == 2
    assert "second.csv: 2000 samples" in said


def test_what_is_certainly_wrong_is_reported_and_the_job_is_done(log, tmp_path, capsys):
    (tmp_path / "map.yaml").write_text("tau.tilt: {from: tau.tilt, sign: -1}\n")
    assert main(["check", str(ARM), str(log), "--columns", str(tmp_path / "map.yaml")]) == 0
    said = capsys.readouterr().out
    assert "wrong: log.csv: the torque of tilt has the wrong sign" in said
    assert "write tau.tilt: {from: tau.tilt, sign: -1} into the column map, on top of" in said


def test_a_log_of_positions_and_references_is_checked_without_torque(pendulum, tmp_path, capsys):
    t = np.arange(1000) / 100.0
    table = np.column_stack([t, np.sin(t), np.sin(t + 0.02)])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,q.pin,q_ref.pin", comments="")
    assert main(["check", str(pendulum), str(tmp_path / "log.csv")]) == 0
    assert capsys.readouterr().out.startswith("log.csv: 1000 samples, 9.99 s, 100 Hz")


def test_it_shows_how_far_it_is_on_standard_error_alone(log, capsys, monkeypatch):
    # Without a terminal a line is written every ten seconds; here at every announcement.
    monkeypatch.setattr("identification.cli.terminal.progress.EVERY_S", 0.0)
    assert main(["check", str(log), "--robot", str(ARM)]) == 0
    said = capsys.readouterr()
    assert re.search(r"^0 s: +\d+ % checking log\.csv$", said.err, re.MULTILINE)
    assert "%" not in said.out
