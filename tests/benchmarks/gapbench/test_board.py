"""The score of a tool. Oracle: answers written by hand, counted by hand."""

from __future__ import annotations

import json

import pytest

from benchmarks.gapbench.__main__ import main
from benchmarks.gapbench.scoring.board import figures, json_of, judge_all, side_by_side, text_of

PARAMETERS = {"torque": 0.2}


def truth(name, kind, effect=None, joint="j1", outside=None):
    effects = [{"effect": effect, "joint": joint, "parameters": PARAMETERS, "gap_in_floors": 5.0}] if effect else []
    return {
        "id": name,
        "kind": kind,
        "robot": "planar2",
        "joints": ["j1", "j2"],
        "effects": effects,
        "outside": {"name": outside} if outside else None,
        "paired_gap": 0.0 if kind == "null" else 5.0,
        "gap_in_floors": [] if kind == "null" else [5.0],
        "noise_floor": [0.1, 0.1],
    }


TRUTHS = [
    truth("n1", "null"),
    truth("n2", "null"),
    truth("s1", "single", "coulomb_friction"),
    truth("s2", "single", "coulomb_friction", "j2"),
    truth("o1", "outside", outside="shaker"),
    truth("o2", "outside", outside="shaker"),
]


def finding(effect, joint, probability=0.95, value=0.2, std=0.01, rivals=()):
    return {
        "effect": effect,
        "joint": joint,
        "probability": probability,
        "parameters": {"torque": {"value": value, "std": std}},
        "rivals": [{"effects": [{"effect": e, "joint": j}], "probability": p} for e, j, p in rivals],
    }


ANSWERS = {
    "n1": {"verdict": "no_gap", "findings": []},
    "n2": {"verdict": "explained", "findings": [finding("payload", None)]},
    "s1": {"verdict": "explained", "findings": [finding("coulomb_friction", "j1", value=0.3)]},
    "s2": {
        "verdict": "explained",
        "findings": [finding("viscous_friction", "j2", 0.6, rivals=[("coulomb_friction", "j2", 0.4)])],
        "joints": [
            {"joint": "j1", "rms_before": 0.5, "rms_after": 0.1},
            {"joint": "j2", "rms_before": 0.5, "rms_after": 0.1},
        ],
    },
    "o1": {"verdict": "unknown", "findings": []},
    "o2": {"verdict": "explained", "findings": [finding("cogging", "j1", 0.3)]},
}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "drawn" / "answers").mkdir(parents=True)
    (tmp_path / "tool").mkdir()
    for one in TRUTHS:
        (tmp_path / "drawn" / "answers" / f"{one['id']}.json").write_text(json.dumps(one))
    for name, one in ANSWERS.items():
        (tmp_path / "tool" / f"{name}.json").write_text(json.dumps(one))
    return tmp_path


@pytest.mark.parametrize(
    ("name", "hits", "total"),
    [
        ("nulls accused", 1, 2),
        ("cause leading", 1, 2),
        ("cause listed", 2, 2),
        ("joint right", 2, 2),
        ("cause too many", 0, 2),
        ("no cause named", 0, 2),
        ("unknown outside", 1, 2),
        ("fits but wrong", 1, 3),  # of the two outside and of the single that states what is left
        ("confident and wrong", 1, 4),  # the payload of the null; two cases state no probability
        ("size within its 95 % interval", 0, 1),
    ],
)
def test_a_figure_counts_what_its_name_says(folder, name, hits, total):
    cases, said = judge_all(TRUTHS, folder / "tool")
    score = figures(cases)[name]
    assert said == []
    assert (score.hits, score.total) == (hits, total)


def test_a_size_that_is_within_its_interval_counts(folder):
    answer = {"verdict": "explained", "findings": [finding("coulomb_friction", "j1", value=0.215)]}
    (folder / "tool" / "s1.json").write_text(json.dumps(answer))
    cases, _ = judge_all(TRUTHS, folder / "tool")
    assert figures(cases)["size within its 95 % interval"].hits == 1


def test_a_case_without_an_answer_is_wrong_and_reported(folder):
    (folder / "tool" / "s1.json").unlink()
    cases, (sentence,) = judge_all(TRUTHS, folder / "tool")
    assert sentence == "s1.json is not there: the case counts as wrong; write an answer for every case."
    assert (figures(cases)["cause leading"].hits, figures(cases)["cause leading"].total) == (0, 2)


def test_a_name_that_no_cause_has_is_reported_with_the_nearest(folder):
    answer = {"verdict": "explained", "findings": [finding("coulomb_frictoin", "j1")]}
    (folder / "tool" / "s1.json").write_text(json.dumps(answer))
    _, (sentence,) = judge_all(TRUTHS, folder / "tool")
    assert sentence == "The answers name coulomb_frictoin, which no case has: did you mean coulomb_friction?"


def test_bins_of_the_calibration_hold_what_was_stated(folder):
    cases, _ = judge_all(TRUTHS, folder / "tool")
    bins = {(b["low"], b["hits"], b["total"]) for b in json_of(cases)["calibration"]}
    assert bins == {(0.3, 1, 2), (0.5, 0, 1), (0.9, 1, 2)}


def test_the_table_and_the_json_say_the_same(folder):
    cases, _ = judge_all(TRUTHS, folder / "tool")
    of = json_of(cases)["figures"]["nulls accused"]["gap >= 0"]
    assert (of["hits"], of["total"]) == (1, 2)
    assert "| nulls accused " in text_of(cases)
    assert "Cases: 6. Without a valid answer: 0." in text_of(cases)


def test_two_tools_stand_beside_each_other(folder):
    cases, _ = judge_all(TRUTHS, folder / "tool")
    header, _, *rows = side_by_side({"one": cases, "two": cases}).splitlines()
    assert [cell.strip() for cell in header.split("|")[1:-1]] == ["figure", "one", "two"]
    assert len(rows) == len(figures(cases))


def test_the_command_scores_and_writes_json(folder, capsys):
    assert main(["score", str(folder / "drawn"), str(folder / "tool"), "--json", str(folder / "score.json")]) == 0
    assert json.loads((folder / "score.json").read_text())["schema"] == "gapbench-score/1"
    assert "nulls accused" in capsys.readouterr().out


def test_the_command_tells_faults_without_the_truth(folder, capsys):
    (folder / "tool" / "n1.json").write_text(json.dumps({"verdict": "fine", "findings": []}))
    assert main(["check", str(folder / "tool")]) == 1
    out = capsys.readouterr().out
    assert 'n1.json: verdict is "fine": give one of' in out
    assert "6 answers in" in out
    assert ", 1 with faults." in out


def test_a_key_belongs_to_the_hidden_split_alone(folder, capsys):
    assert main(["draw", "hidden", str(folder / "hidden")]) == 2
    assert main(["draw", "public", str(folder / "public"), "--key-file", str(folder / "key")]) == 2
    wanted = "Hidden cases are made from a key and public ones are not: give --key-file with 'hidden' alone.\n"
    assert capsys.readouterr().err == 2 * wanted
