"""Comparisons of answers: of two checkouts, and of digits."""

import copy
import importlib
import json

import numpy as np
import pytest

from benchmarks.digits import Answer, answer_of, differences, written
from benchmarks.same_answers import CHECKOUT, Comparison, Judge, compare, compared, line, main
from benchmarks.same_answers_cases import recordings

RIVAL = {"effects": [{"effect": "stribeck_friction", "joint": "j1"}], "probability": 0.2}

ANSWER = {
    "inputs": "0123",
    "verdict": "explained",
    "joints": [{"joint": "j1", "noise_floor": 0.04}],
    "findings": [
        {
            "effect": "coulomb_friction",
            "joint": "j1",
            "regime": None,
            "parameters": {"torque": {"value": 0.5, "std": 0.01}},
            "rivals": [RIVAL],
        }
    ],
    "bounds": [{"effect": "payload", "joint": None, "parameter": "mass", "below": 0.1}],
}


@pytest.fixture
def changed() -> dict:
    return copy.deepcopy(ANSWER)


def test_an_answer_is_the_same_as_itself(changed):
    assert compared(ANSWER, changed) == Comparison((), {})
    assert line(compared(ANSWER, changed)) == "same"


def test_a_changed_verdict_is_reported(changed):
    changed["verdict"] = "unknown"
    assert compared(ANSWER, changed).words == ("verdict explained -> unknown",)


def test_a_moved_size_is_reported_with_how_far_and_is_no_other_answer(changed, capsys):
    changed["findings"][0]["parameters"]["torque"]["value"] = 0.5 * (1 + 1e-6)
    found = compared(ANSWER, changed)
    assert found.words == ()
    assert found.sizes == {
        "findings: coulomb_friction j1: parameters: torque: value": pytest.approx(1e-6, rel=1e-3),
    }
    assert compared(ANSWER, changed, rtol=1e-5).sizes == {}
    assert compare({"a": ANSWER}, {"a": changed}, 1e-9) == 0
    assert "a: sizes differ by up to 1.0e-06: findings: coulomb_friction j1" in capsys.readouterr().out


def test_a_lost_rival_is_reported(changed):
    changed["findings"][0]["rivals"] = []
    (words,) = compared(ANSWER, changed).words
    assert words == "findings: coulomb_friction j1: rivals [stribeck_friction j1] -> []"


def test_a_size_that_became_nothing_is_another_answer(changed):
    changed["bounds"][0]["below"] = None
    assert compared(ANSWER, changed).words == ("bounds: payload mass: below 0.1 -> None",)


def test_findings_in_another_order_are_another_answer(changed):
    changed["findings"].append({**ANSWER["findings"][0], "joint": "j2"})
    turned = {**changed, "findings": changed["findings"][::-1]}
    (words,) = compared(changed, turned).words
    assert words == "findings [coulomb_friction j1, coulomb_friction j2] -> [coulomb_friction j2, coulomb_friction j1]"


def test_a_part_that_is_missing_is_another_answer(changed):
    del changed["bounds"]
    assert compared(ANSWER, changed).words


def test_the_exit_code_says_whether_all_answers_are_the_same(changed, tmp_path, capsys):
    changed["verdict"] = "unknown"
    one, other = tmp_path / "one.json", tmp_path / "other.json"
    one.write_text(json.dumps({"a": ANSWER, "b": ANSWER, "c": ANSWER}))
    other.write_text(json.dumps({"a": ANSWER, "b": changed}))
    assert main(["compare", str(one), str(one)]) == 0
    assert main(["compare", str(one), str(other)]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "1 same, 0 with other sizes only, 2 different"
    assert main(["compare", str(one), str(other), "--only", "a"]) == 0


def test_how_it_is_reported_is_not_compared(changed):
    # A file without a ledger, of an earlier schema, with another sentence.
    said = {"schema": "gap-diagnosis/3", "data_warnings": ["late"], "ledger": [{"effects": [], "outcome": "claimed"}]}
    changed["not_testable"] = [{"effect": "backlash", "joint": "j1", "why": "one reason"}]
    other = copy.deepcopy(changed) | said
    other["not_testable"][0]["why"] = "another"
    assert compared(changed, other) == Comparison((), {})


@pytest.mark.parametrize(
    ("rule", "module", "name"),
    [
        ("above_chance.LEAST_GAIN", "identification.gates.above_chance", "LEAST_GAIN"),
        ("contract_levels.LISTED", "identification.engine.contract_levels", "LISTED"),
        ("ORDINARY_SHARE", "identification.diagnosis.decision_rules", "ORDINARY_SHARE"),
    ],
)
def test_a_threshold_of_a_gate_is_given_another_value(rule, module, name):
    *_, code = Judge(CHECKOUT, (f"{rule}=0.125",)).command
    before = getattr(importlib.import_module(module), name)
    try:
        exec(code.split("from identification.cli.main")[0])
        assert getattr(importlib.import_module(module), name) == type(before)(0.125)
        assert before != 0.125
    finally:
        setattr(importlib.import_module(module), name, before)


def test_there_are_forty_recordings_each_with_its_own_name():
    assert len({recording.name for recording in recordings()}) == 40


FRICTION, SPRING = ("coulomb_friction", "j1"), ("parasitic_spring", "j1")


@pytest.mark.parametrize(("digits", "apart"), [(17, 0.0), (9, 5.1e-10), (7, 5.1e-8)])
@pytest.mark.parametrize("kind", ["npz", "csv"])
def test_a_log_has_the_digits_that_were_asked_for(tmp_path, rng, digits, apart, kind):
    q = rng.uniform(0.1, 1.0, 50)
    np.savez(tmp_path / "log.npz", **{"t": np.arange(50.0), "q.j1": q})
    written(tmp_path / "log.npz", 17, tmp_path / "log.csv")
    written(tmp_path / f"log.{kind}", digits, tmp_path / "copy.csv")
    assert (tmp_path / "copy.csv").read_text().startswith("t,q.j1\n")
    error = np.abs(np.loadtxt(tmp_path / "copy.csv", delimiter=",", skiprows=1)[:, 1] - q).max()
    assert apart / 5 <= error <= apart


def test_another_finding_is_a_difference_and_a_rival_is_named_as_one():
    whole = Answer("explained", frozenset([FRICTION]), frozenset([SPRING]), 0.9)
    other = Answer("explained", frozenset([SPRING]), frozenset([FRICTION]), 0.9)
    assert differences({17: whole, 9: whole, 7: whole}) == []
    (line,) = differences({17: whole, 9: other})
    assert line.startswith("9 digits: explained, parasitic_spring j1")
    assert line.endswith("(rivals of each other)")
    (line,) = differences({17: whole, 9: Answer("unknown")})
    assert not line.endswith("(rivals of each other)")


def test_a_refusal_is_no_answer():
    assert answer_of(None).verdict == "failed"
