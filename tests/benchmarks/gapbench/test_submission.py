"""What a tool hands in. Oracle: the schema as the package jsonschema reads it."""

from __future__ import annotations

import copy
import json

import jsonschema
import pytest

from benchmarks.gapbench.scoring.submission import AnswerError, faults, read_answer, ready, schema

GOOD = {
    "verdict": "explained",
    "findings": [
        {
            "effect": "coulomb_friction",
            "joint": "j1",
            "probability": 0.8,
            "gap_closed": 0.9,
            "rivals": [{"effects": [{"effect": "payload", "joint": None}], "probability": 0.2}],
            "parameters": {"torque": {"value": 0.3, "std": 0.01, "unit": "N m"}},
        }
    ],
    "joints": [{"joint": "j1", "rms_before": 1.0, "rms_after": 0.1}],
    "seconds": 2.0,
    "version": "of the tool",
}
TRUTH = {"id": "c1", "joints": ["j1"], "noise_floor": [0.05]}


def changed(*path_and_value):
    *path, last, value = path_and_value
    out = copy.deepcopy(GOOD)
    place = out
    for key in path:
        place = place[key]
    if value is KeyError:
        del place[last]
    else:
        place[last] = value
    return out


BAD = {
    "the answer has no verdict: add it": changed("verdict", KeyError),
    'verdict is "fine": give one of no_gap, explained': changed("verdict", "fine"),
    "findings is {}: give a list": changed("findings", {}),
    "findings[0] has no joint: add it": changed("findings", 0, "joint", KeyError),
    "findings[0].joint is 1: give a text or null": changed("findings", 0, "joint", 1),
    "findings[0].probability is 1.2: give a finite number of 0 or more and of 1 or less": changed(
        "findings", 0, "probability", 1.2
    ),
    "findings[0].probability is true: give a number or null": changed("findings", 0, "probability", True),
    "findings[0].rivals[0].effects has no entry: give 1 or more": changed("findings", 0, "rivals", 0, "effects", []),
    "findings[0].parameters.torque has no std: add it": changed("findings", 0, "parameters", "torque", "std", KeyError),
    "findings[0].parameters.torque.std is -1: give a finite number of 0 or more": changed(
        "findings", 0, "parameters", "torque", "std", -1
    ),
    "joints[0].rms_after is null: give a number": changed("joints", 0, "rms_after", None),
}


def test_a_good_answer_has_no_fault():
    assert list(faults(GOOD)) == []
    jsonschema.validate(GOOD, schema())


@pytest.mark.parametrize("sentence", BAD)
def test_a_fault_is_one_sentence_where_the_schema_has_one(sentence):
    found = list(faults(BAD[sentence]))
    assert len(found) == len(list(jsonschema.Draft202012Validator(schema()).iter_errors(BAD[sentence]))) == 1
    assert found[0].startswith(sentence)
    assert found[0].endswith(".")


def test_every_keyword_of_the_schema_is_one_that_is_checked():
    words = "type enum required properties additionalProperties items minItems minimum maximum"
    notes = {"$schema", "title", "description"}

    def keywords(rules):
        yield from rules
        inside = [*rules.get("properties", {}).values(), rules.get("additionalProperties"), rules.get("items")]
        for more in filter(None, inside):
            yield from keywords(more)

    assert set(keywords(schema())) == notes | set(words.split())


def test_the_schema_is_a_schema():
    # Oracle: the schema of schemas.
    meta = jsonschema.Draft202012Validator(jsonschema.Draft202012Validator.META_SCHEMA)
    assert list(meta.iter_errors(schema())) == []


def test_not_a_number_is_no_number(tmp_path):
    path = tmp_path / "c1.json"
    path.write_text(json.dumps(changed("findings", 0, "probability", float("nan"))))
    with pytest.raises(AnswerError, match=r"c1\.json: findings\[0\]\.probability is NaN: give a finite number"):
        read_answer(path)


def test_a_file_that_is_no_json_is_told(tmp_path):
    path = tmp_path / "c1.json"
    path.write_text("{verdict: no_gap}")
    with pytest.raises(AnswerError, match=r"c1\.json is no JSON .*: write one object for each case\."):
        read_answer(path)


def test_findings_without_a_share_are_ranked_by_their_order():
    answer = changed("findings", 0, "gap_closed", KeyError)
    answer["findings"].append({"effect": "payload", "joint": None, "gap_closed": 0.7})
    first, second = ready(TRUTH, answer)["findings"]
    assert first["gap_closed"] > second["gap_closed"]


def test_what_is_left_is_judged_in_the_true_noise_floor():
    answer = changed("joints", 0, "noise_floor", 7.0)
    assert ready(TRUTH, answer)["joints"][0]["noise_floor"] == 0.05


def test_joints_of_another_robot_are_refused():
    with pytest.raises(AnswerError, match=r"c1\.json: joints are elbow: give j1 in this order, or none\."):
        ready(TRUTH, changed("joints", 0, "joint", "elbow"))
