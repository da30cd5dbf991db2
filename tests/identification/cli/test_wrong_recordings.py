"""Recordings that are certainly wrong are not judged, unless that is asked for. Oracle: the contract, known truth."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from identification.cli.main import main
from identification.data.checks.check_recording import checked
from identification.data.reading import read_recording
from identification.data.recording import Recording
from identification.identify.identify import identify
from identification.pipeline import diagnose
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from places import ROBOTS


@pytest.fixture
def massless(tmp_path):
    """The pendulum without the inertia of its link."""
    file = tmp_path / "robot.urdf"
    text = re.sub(r"<inertial>.*?</inertial>", "", (ROBOTS / "pendulum.urdf").read_text(), flags=re.DOTALL)
    file.write_text(text)
    return file


@pytest.fixture
def log(tmp_path, made_columns, written):
    return written(tmp_path / "log.csv", made_columns(ROBOTS / "arm3.urdf", seconds=8.0))


@pytest.mark.parametrize("command", [["diagnose"], ["identify", "--out", "fitted"]])
def test_a_model_without_mass_is_refused(command, massless, swing, written, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    log = written(tmp_path / "log.csv", swing)
    assert main([*command, str(massless), str(log)]) == 2
    said = r"^phantom-dyn: log\.csv: no moving link of robot\.urdf has mass .*give every link of robot\.urdf its mass"
    assert re.search(said, capsys.readouterr().err)
    assert not (tmp_path / "fitted").exists()


@pytest.mark.whole
def test_what_is_wrong_leads_the_verdict_of_what_is_judged_anyway(massless, made_columns, written, tmp_path, capsys):
    columns = made_columns(ROBOTS / "pendulum.urdf", seconds=5.0, rate=100.0)
    log, file = written(tmp_path / "log.csv", columns), tmp_path / "found.json"
    assert main(["diagnose", str(massless), str(log), "--anyway", "--json", str(file)]) == 0
    assert capsys.readouterr().out.startswith("Judged although log.csv: no moving link of robot.urdf has mass.")
    assert "no moving link of robot.urdf has mass" in json.loads(file.read_text())["data_warnings"][0]


@pytest.mark.parametrize("command", [["diagnose"], ["identify", "--out", "fitted"], ["diagnose", "--each"]])
def test_a_flipped_torque_is_refused_with_the_entry_that_mends_it(command, arm, log, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    flip, mend = tmp_path / "flip.yaml", "tau.tilt: {from: tau.tilt, sign: -1}"
    flip.write_text(mend + "\n")
    assert main([*command, str(arm), str(log), "--columns", str(flip)]) == 2
    said = capsys.readouterr()
    text = " ".join((said.out + said.err).split())
    assert "the torque of tilt has the wrong sign" in text
    assert f"write {mend} into the column map, on top of what its entries say already" in text
    assert "--anyway" in text


def test_an_entry_that_mends_takes_the_columns_of_the_file_where_a_map_renamed_them(
    tmp_path, made_columns, written, capsys
):
    # Known truth: the torques are in mNm, which the first map does not say; the second map is that of the refusal.
    columns = made_columns(ROBOTS / "planar2.urdf", seconds=8.0)
    names = {"q.shoulder": "angle 1", "q.elbow": "angle 2", "tau.shoulder": "load [1]", "tau.elbow": "load [2]"}
    factors = {"tau.shoulder": 1e3, "tau.elbow": 1e3}
    columns = {names.get(name, name): factors.get(name, 1.0) * x for name, x in columns.items()}
    log, mend = written(tmp_path / "log.csv", columns), tmp_path / "columns.yaml"
    given = [f"{name}: '{column}'" for name, column in names.items()]
    mend.write_text("\n".join(given))
    command = ["check", str(ROBOTS / "planar2.urdf"), str(log), "--columns", str(mend)]
    assert main(command) == 0
    (said,) = re.findall(r"write \{(.*)\} into the column map", " ".join(capsys.readouterr().out.split()))
    mend.write_text("\n".join([*given[:2], *re.split(r", (?=tau)", said)]))
    assert main(command) == 0
    assert "nothing is wrong" in capsys.readouterr().out


def test_the_python_door_refuses_it_too(arm, log, tmp_path):
    robot = load_robot(arm)
    found = read_recording(log, robot)
    flipped = replace(found, tau=-found.tau)
    wrong = replace(flipped, wrong=checked(flipped, robot).wrong)
    for door in (diagnose, identify):
        with pytest.raises(LogError, match=r"the torques of all joints have the wrong sign .*or judge it all the same"):
            door(robot, (wrong,))


def test_a_reading_at_which_loops_do_not_close_is_no_reading():
    # The linkage closes for its drive within 1.6 rad of zero: nowhere near where another zero would put it.
    robot = load_robot(ROBOTS / "fourbar.xml")
    t = np.arange(2000) / 200.0
    q = 1.2 * np.sin(2 * np.pi * 0.7 * t)[:, None]
    torque = 10.0 * np.random.default_rng(0).standard_normal((2000, 1))
    assert checked(Recording("a.csv", robot.joint_names, t, q, torque), robot).wrong == ()


def test_positions_and_torques_in_each_others_columns_are_refused_with_the_entry_that_mends_them(
    tmp_path, made_columns, written, capsys
):
    columns = made_columns(ROBOTS / "pendulum.urdf", seconds=8.0)
    columns |= {"q.pin": columns["tau.pin"], "tau.pin": columns["q.pin"]}
    log = written(tmp_path / "log.csv", columns)
    assert main(["diagnose", str(ROBOTS / "pendulum.urdf"), str(log)]) == 2
    assert "log.csv: positions and torques are in each other's columns" in capsys.readouterr().err
    mend = tmp_path / "columns.yaml"
    mend.write_text('{q: "tau.{joint}", tau: "q.{joint}"}\n')
    assert main(["check", str(ROBOTS / "pendulum.urdf"), str(log), "--columns", str(mend)]) == 0
    assert "nothing is wrong with it" in capsys.readouterr().out
