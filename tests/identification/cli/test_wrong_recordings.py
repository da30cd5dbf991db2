"""Recordings that are certainly wrong are not judged, unless that is asked for. Oracle: the contract, known truth."""

from __future__ import annotations

import json
import re

import pytest

from identification.cli.main import main
from places import ROBOTS


@pytest.fixture
def massless(tmp_path):
    """The arm without the inertia of any link."""
    file = tmp_path / "robot.urdf"
    text = re.sub(r"<inertial>.*?</inertial>", "", (ROBOTS / "arm3.urdf").read_text(), flags=re.DOTALL)
    file.write_text(text)
    return file


@pytest.fixture
def log(tmp_path, made_columns, written):
    return written(tmp_path / "log.csv", made_columns(ROBOTS / "arm3.urdf", seconds=8.0))


@pytest.mark.parametrize("command", [["diagnose"], ["identify", "--out", "fitted"]])
def test_a_model_without_mass_is_refused(command, massless, log, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([*command, str(massless), str(log)]) == 2
    told = r"^phantom-dyn: log\.csv: no moving link of robot\.urdf has mass .*give every link of robot\.urdf its mass"
    assert re.search(told, capsys.readouterr().err)
    assert not (tmp_path / "fitted").exists()


@pytest.mark.whole
def test_what_is_wrong_leads_the_verdict_of_what_is_judged_anyway(massless, log, tmp_path, capsys):
    file = tmp_path / "found.json"
    assert main(["diagnose", str(massless), str(log), "--anyway", "--json", str(file)]) == 0
    assert capsys.readouterr().out.startswith("Judged although log.csv: no moving link of robot.urdf has mass.")
    assert "no moving link of robot.urdf has mass" in json.loads(file.read_text())["data_warnings"][0]
