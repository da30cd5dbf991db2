"""``phantom-dyn diagnose --each``. Oracles: the contract (files, exit codes) and the command on one log alone."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest

from identification.cli.main import main
from identification.export.file_names import NAMES as MODELS
from identification.reporting.stored.diagnosis_files import INDEX, REPORT

pytestmark = pytest.mark.whole


@pytest.fixture(scope="module")
def logs(tmp_path_factory, pendulum, made_columns, written) -> Path:
    """Folder with one recording that is diagnosed and one that is refused."""
    folder = tmp_path_factory.mktemp("logs")
    written(folder / "good.csv", made_columns(pendulum, seconds=5.0))
    (folder / "short.csv").write_text("t,q.pin,tau.pin\n0,0,1\n")
    return folder


@pytest.fixture(scope="module")
def finished(tmp_path_factory, pendulum, logs):
    """Folder of the files of one run over both, and its exit code."""
    out = tmp_path_factory.mktemp("finished") / "out"
    return out, main(["diagnose", str(pendulum), str(logs), "--each", "--jobs", "1", "--out", str(out)])


def test_one_refused_recording_is_exit_code_2_and_the_others_are_written(finished):
    out, code = finished
    written = sorted(str(path.relative_to(out)) for path in out.rglob("*.*"))
    ours = ["diagnoses.csv", "diagnoses.json", "fleet.html", *(f"good/{name}" for name in (INDEX, REPORT, *MODELS))]
    assert (code, written) == (2, sorted(ours))


def test_the_table_has_one_row_a_recording(finished):
    rows = list(csv.DictReader((finished[0] / "diagnoses.csv").open()))
    assert [(Path(row["log"]).name, row["verdict"], row["findings"]) for row in rows] == [
        ("good.csv", "explained", "coulomb_friction pin"),
        ("short.csv", "refused", ""),
    ]


def test_the_folder_of_a_recording_holds_what_the_table_says(finished):
    table = json.loads((finished[0] / "diagnoses.json").read_text())
    alone = json.loads((finished[0] / "good" / "diagnosis.json").read_text())
    assert table["recordings"][0]["diagnosis"] == alone


def test_recordings_that_are_all_diagnosed_are_exit_code_0(pendulum, logs, capsys):
    assert main(["diagnose", "--each", str(pendulum), str(logs / "good.csv")]) == 0
    shown = capsys.readouterr()
    assert re.search(r"^good\.csv +explained +Coulomb friction on joint pin$", shown.out, re.MULTILINE)
    assert shown.err == ""


def test_without_out_and_json_nothing_is_written(pendulum, logs, monkeypatch):
    before = sorted(logs.iterdir())
    monkeypatch.chdir(logs)
    main(["diagnose", "--each", str(pendulum), "short.csv"])
    assert sorted(logs.iterdir()) == before


def test_a_refusal_is_counted_on_standard_error(pendulum, logs, capsys):
    assert main(["diagnose", "--each", str(pendulum), str(logs / "short.csv"), "--json", str(logs / "x.txt")]) == 2
    shown = capsys.readouterr()
    assert shown.err == "phantom-dyn: 1 of 1 recordings was refused; the table says why\n"
    assert re.search(r"^short\.csv +refused +short\.csv", shown.out, re.MULTILINE)
    assert json.loads((logs / "x.txt").read_text())["recordings"][0]["verdict"] == "refused"


def test_recordings_cannot_be_held_out(pendulum, logs, refusal):
    sentence = refusal(pendulum, logs / "good.csv", "--each", "--hold-out", logs / "short.csv")
    assert re.search(r"--hold-out was given with --each, which diagnoses every recording by itself", sentence)


def test_a_folder_without_recordings(pendulum, tmp_path, refusal):
    (tmp_path / "empty").mkdir()
    assert re.search(
        r"empty holds no recording: wanted files that end in", refusal(pendulum, tmp_path / "empty", "--each")
    )


def test_a_folder_without_each_is_no_log(pendulum, logs, refusal):
    assert re.search(r"is a folder without metadata\.yaml", refusal(pendulum, logs))


def test_a_log_in_a_folder_and_by_name_is_given_twice(pendulum, logs, refusal):
    assert re.search(r"good\.csv is given twice", refusal(pendulum, logs, logs / "good.csv", "--each"))
