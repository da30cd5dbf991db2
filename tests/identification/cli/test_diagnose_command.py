"""The command diagnose on good recordings.

Oracles: the contract (files, schema, exit codes) and known truth (a robot with 0.4 more Coulomb friction than its
model on every joint).
"""

import json
from pathlib import Path

import numpy as np
import pytest

from identification.cli.main import main
from identification.export.file_names import NAMES as MODELS
from identification.reporting.stored.diagnosis_files import INDEX, REPORT

pytestmark = pytest.mark.whole

OURS = sorted([INDEX, REPORT, *MODELS])


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def diagnosed(tmp_path, capsys):
    """Runs diagnose with ``--json`` and returns the content of that file without its time and its run."""

    def run(*words: object) -> dict:
        file = tmp_path / "diagnosed.json"
        assert main(["diagnose", *map(str, words), "--json", str(file)]) == 0
        assert capsys.readouterr().err == ""
        content = json.loads(file.read_text())
        del content["seconds"], content["run"], content["files"]
        return content

    return run


@pytest.fixture
def causes(diagnosed):
    """Runs diagnose and returns effect and joint of every finding."""
    return lambda *words: [(found["effect"], found["joint"]) for found in diagnosed(*words)["findings"]]


@pytest.fixture(scope="module")
def finished(tmp_path_factory, pendulum, swing, written):
    """Folder with the recording and what one run with ``--out`` and ``--json`` has written."""
    folder = tmp_path_factory.mktemp("finished")
    log = written(folder / "log.csv", swing)
    out, file = folder / "deep" / "out", folder / "one.json"
    assert main(["diagnose", str(pendulum), str(log), "--out", str(out), "--json", str(file)]) == 0
    return folder


@pytest.fixture
def plain(finished) -> dict:
    """What diagnose says of the recording without any option, without its time, its run and its files."""
    content = json.loads((finished / "one.json").read_text())
    del content["seconds"], content["run"], content["files"]
    return content


def test_the_folder_holds_all_files(finished):
    assert names_in(finished / "deep" / "out") == OURS


def test_nothing_else_is_left_behind(finished):
    assert names_in(finished) == ["deep", "log.csv", "one.json"]


def test_the_json_keeps_the_contract(finished, document):
    assert document((finished / "one.json").read_bytes()).verdict == "explained"


def test_the_missing_friction_is_found(finished, document):
    first = document((finished / "one.json").read_bytes()).findings[0]
    assert (first.effect, first.joint) == ("coulomb_friction", "pin")
    assert abs(first.parameters["torque"].value - 0.4) < 2 * first.parameters["torque"].std


def test_the_summary_is_short_and_plain_and_nothing_is_written(log, pendulum, capsys, monkeypatch):
    monkeypatch.chdir(log.parent)
    assert main(["diagnose", str(pendulum), "log.csv"]) == 0
    assert names_in(log.parent) == ["log.csv"]
    text = capsys.readouterr().out
    assert text.startswith("The gap between robot and model is explained by Coulomb friction on joint pin.\n")
    assert len(text.splitlines()) < 60
    assert "\x1b" not in text


def test_a_quick_run_writes_its_answer_alone(finished, tmp_path, log, pendulum, plain):
    # The same answer as that of a whole run; a report of an earlier run would pass for this one's.
    out = tmp_path / "out"
    out.mkdir()
    (out / "report.html").write_text("a page of phantom-dyn, of an earlier run")
    assert main(["diagnose", str(pendulum), str(log), "--quick", "--out", str(out)]) == 0
    assert names_in(out) == ["diagnosis.json"]
    content = json.loads((out / "diagnosis.json").read_text())
    assert content["next_experiment"] is None
    assert {name: content[name] for name in plain if name != "next_experiment"} == {
        name: value for name, value in plain.items() if name != "next_experiment"
    }


@pytest.mark.parametrize(("option", "said"), [("--quick", "leave out one"), ("--profile", "profile one of them")])
def test_a_quick_run_or_a_profile_of_each_recording_is_refused(log, pendulum, capsys, option, said):
    assert main(["diagnose", str(pendulum), str(log), "--each", option]) == 2
    assert said in capsys.readouterr().err


def test_a_profile_names_the_stages_and_leaves_the_answer_alone(log, pendulum, capsys):
    assert main(["diagnose", str(pendulum), str(log), "--profile"]) == 0
    said = capsys.readouterr()
    assert said.out.startswith("The gap between robot and model is explained by Coulomb friction on joint pin.\n")
    names = [line.split("  ")[0] for line in said.err.splitlines()]
    assert {"reading", "computing regressors", "estimating the noise", "writing", "all"} <= set(names)


def test_a_column_map_is_obeyed(tmp_path, pendulum, swing, diagnosed, plain, written):
    own = {"ms": swing["t"] * 1e3, "angle_pin": np.rad2deg(swing["q.pin"]), "load_pin": -swing["tau.pin"]}
    (tmp_path / "map.yaml").write_text(
        "t: {from: ms, unit: ms}\nq: {from: 'angle_{joint}', unit: deg}\ntau: {from: 'load_{joint}', sign: -1}\n"
    )
    found = diagnosed(pendulum, written(tmp_path / "own.csv", own), "--columns", tmp_path / "map.yaml")
    torque = [content["findings"][0]["parameters"]["torque"]["value"] for content in (found, plain)]
    assert abs(torque[0] / torque[1] - 1) < 1e-6


def test_several_recordings_are_judged_together(tmp_path, pendulum, log, made_columns, diagnosed, plain, written):
    second = written(tmp_path / "second.csv", made_columns(pendulum, seed=1))
    both = diagnosed(pendulum, log, second)
    assert both["joints"][0]["hold_out_samples"] > 1.5 * plain["joints"][0]["hold_out_samples"]


def test_what_makes_the_hold_out_worse_is_not_claimed(tmp_path, pendulum, log, made_columns, diagnosed, written):
    # In the held-out recording the robot has lost its friction, which the first one shows.
    columns = made_columns(pendulum, seed=1, friction=0.0)
    other = written(tmp_path / "other.csv", columns)
    found = diagnosed(pendulum, log, "--hold-out", other)
    assert found["findings"] == []
    assert found["joints"][0]["rms_after"] == found["joints"][0]["rms_before"]


def test_an_excluded_stretch_is_left_out(pendulum, log, swing, causes, written):
    wrong = swing["tau.pin"] + 5.0 * ((swing["t"] > 4) & (swing["t"] < 5))
    bumped = written(log.with_name("bumped.csv"), swing | {"tau.pin": wrong})
    assert causes(pendulum, bumped, "--exclude", "3.9:5.1") == [("coulomb_friction", "pin")]
    assert names_in(log.parent) == ["bumped.csv", "diagnosed.json", "log.csv"]
