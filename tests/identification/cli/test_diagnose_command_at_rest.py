"""The option ``--motion-only`` of the command where no controller states a gain: rests are judged."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from identification.cli.main import main
from places import ROBOTS

PENDULUM = ROBOTS / "pendulum.urdf"
GAP = 0.02


@pytest.fixture
def log(tmp_path) -> Path:
    """At 10 Hz, a pendulum that rests half a play below either of two references."""
    (tmp_path / "robot.yaml").write_text("joints: {pin: {encoder_side: link, encoder_counts: 65536}}\n")
    side = np.repeat(np.tile([1.0, -1.0], 5), 10)
    q_ref = 0.8 * side
    rests = q_ref - 0.5 * GAP * side
    q = np.where(np.arange(100) % 10 < 2, np.concatenate([[0.0, 0.0], rests[:-2]]), rests)
    step = 2 * np.pi / 65536
    table = np.column_stack([np.arange(100) / 10.0, step * np.round(q / step), q_ref])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,q.pin,q_ref.pin", comments="")
    return tmp_path / "log.csv"


def diagnosed(log: Path, *more: str) -> int:
    config = log.with_name("robot.yaml")
    return main(["diagnose", str(PENDULUM), str(log), "--robot-config", str(config), "--motion-only", *more])


def test_a_play_is_named_with_its_twin_and_all_files_are_written(log, capsys):
    # Known truth.
    out = log.with_name("out")
    assert diagnosed(log, "--out", str(out)) == 0, capsys.readouterr().err
    document = json.loads((out / "diagnosis.json").read_text())
    (finding,) = document["findings"]
    assert (finding["effect"], finding["verdict"]) == ("backlash", "one_of")
    assert finding["parameters"]["gap"]["value"] == pytest.approx(GAP, abs=2e-4)
    assert document["joints"][0]["unit"] == "rad"
    assert "RMS position error of held-out rests" in capsys.readouterr().out
    assert "position less reference, at rest" in (out / "report.html").read_text()
    assert (out / "corrected.yaml").is_file()


def test_an_earlier_diagnosis_is_refused_at_rest(log, capsys):
    out = log.with_name("out")
    assert diagnosed(log, "--out", str(out)) == 0
    assert diagnosed(log, "--with", str(out / "corrected.yaml")) == 2
    words = (
        "log.csv: it is judged at rest, where every rest is held out in turn, so that held-out recordings and effects"
    )
    assert words in capsys.readouterr().err


def test_many_recordings_are_judged_at_rest_where_one_would_be_and_one_that_never_moves_says_so(log, capsys):
    # Known truth of the first; a pendulum that stands still shows nothing of friction or inertia.
    still = np.column_stack([np.arange(2000) / 100.0, np.full(2000, 0.3), np.full(2000, 1.45)])
    np.savetxt(log.with_name("still.csv"), still, delimiter=",", header="t,q.pin,tau.pin", comments="")
    json_file, config = log.with_name("each.txt"), log.with_name("robot.yaml")
    words = ["diagnose", str(PENDULUM), str(log), str(log.with_name("still.csv")), "--each", "--jobs", "1"]
    assert main([*words, "--robot-config", str(config), "--json", str(json_file)]) == 0
    first, second = json.loads(json_file.read_text())["recordings"]
    assert [finding["effect"] for finding in first["diagnosis"]["findings"]] == ["backlash"]
    assert second["verdict"] == "not_testable"
    shown = " ".join(capsys.readouterr().out.split())
    assert "still.csv not_testable This recording cannot show a gap at all: record a motion" in shown
