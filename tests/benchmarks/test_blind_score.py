"""What the scorer reads and writes."""

from __future__ import annotations

import json
import re

import pytest
from scored_by_hand import FAILED, answer, entry, finding, some_cases

from benchmarks.blind.score import as_json, load_baselines, load_pairs, main, report, write_score


def test_baselines_are_scored_in_the_true_noise_floors(tmp_path):
    """A baseline knows no noise floor: with the true one, 4 after a gap of 5 floors is no fit."""
    said = entry(finding("coulomb_friction"), before=5.0, after=4.0)["diagnosis"]
    said["joints"][0]["noise_floor"] = 4.0
    (tmp_path / "c1.json").write_text(json.dumps({**FAILED, "diagnosis": {"always_coulomb": {**said, "seconds": 0.5}}}))
    answers = tmp_path / "answers"
    answers.mkdir()
    (answers / "c1.json").write_text(json.dumps(answer("viscous_friction") | {"noise_floor": [1.0]}))
    case = load_baselines(answers, tmp_path, ["c1"])["always_coulomb"][0]
    assert (case.gap_closed, case.seconds) == (pytest.approx((25.0 - 16.0) / 24.0), 0.5)


def test_a_baseline_that_was_left_out_has_no_cases(tmp_path):
    said = {"mujoco_sysid": {"left_out": "not installed", "verdict": "failed", "findings": [], "joints": []}}
    (tmp_path / "c1.json").write_text(json.dumps({**FAILED, "diagnosis": said}))
    answers = tmp_path / "answers"
    answers.mkdir()
    (answers / "c1.json").write_text(json.dumps(answer("viscous_friction")))
    assert load_baselines(answers, tmp_path, ["c1"])["mujoco_sysid"] == []


def test_the_score_is_written_as_text_numbers_and_picture(tmp_path):
    text = write_score(some_cases(), tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["confusion.png", "confusion.txt", "score.json", "score.md"]
    assert "50 % (9 to 91)" in text


def test_the_report_of_no_case_has_no_numbers():
    assert re.search(r"\| false claims on nulls +\| at most 2 % +\| -", report([]))
    assert as_json([])["figures"]["false claims on nulls"]["gap >= 2"]["total"] == 0


def test_a_missing_result_is_told(tmp_path):
    with pytest.raises(SystemExit, match="1 cases lack a result or an answer, first c9"):
        load_pairs(tmp_path, tmp_path, ["c9"])


def test_folders_are_scored_together(tmp_path, capsys):
    folders = {"answers": [], "results": []}
    said = entry(finding("coulomb_friction"), before=5.0, after=1.0)
    for name in ("one", "two"):
        for kind, content in (("answers", answer("coulomb_friction")), ("results", said)):
            folder = tmp_path / name / kind
            folder.mkdir(parents=True)
            (folder / f"{name}.json").write_text(json.dumps(content))
            folders[kind].append(str(folder))
    main(["--answers", *folders["answers"], "--results", *folders["results"], "--out", str(tmp_path / "out")])
    assert "Cases: 2." in capsys.readouterr().out


def test_folders_that_do_not_pair_are_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        main(["--answers", "one", "two", "--results", "one", "--out", str(tmp_path)])
    assert "one folder of results for each folder of answers" in capsys.readouterr().err
