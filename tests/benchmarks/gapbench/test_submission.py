"""Submissions: splits, a stranger's answers."""

import ast
import copy
import json
import subprocess
import sys
from collections import Counter
from importlib.metadata import version

import jsonschema
import pytest

from benchmarks.gapbench import splits
from benchmarks.gapbench.makes import EXTRAS, NAMES, make_named, missing
from benchmarks.gapbench.scoring.submission import AnswerError, faults, read_answer, ready, schema
from benchmarks.gapbench.splits import (
    FIRST_SEEDS,
    NEXT_SEED,
    SUMS_WITH,
    Listed,
    SplitError,
    draw_listed,
    hidden_cases,
    kinds_in_order,
    public_cases,
    read_key,
    seal_answers,
    sum_of,
    truths,
)
from places import CHECKOUT

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


def test_a_file_that_is_no_json_is_reported(tmp_path):
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


KEY = b"0123456789abcdef0123456789abcdef"


def test_there_are_three_hundred_public_cases_of_four_makes():
    every = public_cases(NAMES)
    assert Counter(one.make for one in every) == dict.fromkeys(("mujoco", "drake", "field", "slow"), 75)
    assert Counter(one.kind for one in every) == {"single": 120, "null": 80, "outside": 60, "pair": 40}


def test_no_public_case_is_listed_twice_and_a_spare_seed_is_none_of_the_list():
    seeds = {(one.make, one.kind, one.seed) for one in public_cases(NAMES)}
    assert len(seeds) == 300
    assert not seeds & {(make, kind, seed + NEXT_SEED) for make, kind, seed in seeds}


def test_the_list_holds_the_first_seeds_in_the_mixed_order():
    expected = [(kind, FIRST_SEEDS[kind] + i) for kind, i in kinds_in_order()]
    assert [[(one.kind, one.seed) for one in public_cases([make])] for make in NAMES] == [expected] * 4


def test_the_first_cases_of_a_make_hold_every_kind():
    assert Counter(one.kind for one in public_cases(["field"], 24)) == {
        "single": 10,
        "null": 6,
        "outside": 5,
        "pair": 3,
    }


def test_public_cases_that_are_drawn_again_have_the_sums_of_the_list(tmp_path):
    if any(version(name) != made for name, made in SUMS_WITH.items()):
        pytest.skip(f"the sums are of files made with {SUMS_WITH}; other versions round otherwise")
    # Cases of this make do not depend on the processor.
    again = [one for one in public_cases(["slow"]) if (one.kind, one.seed) in (("null", 101001), ("null", 101004))]
    names, said = draw_listed(again, tmp_path)
    assert said == []
    assert [sum_of(tmp_path / "cases" / name) for name in names] == [one.sha256 for one in again]
    assert all(one.sha256 for one in again)


class _Made:
    def __init__(self, seed, kind):
        self.answer = {"id": f"c{seed}{kind}", "seed": seed}


def _write(case, cases):
    (cases / case.answer["id"]).mkdir(parents=True)
    for name in ("robot.urdf", "log.csv"):
        (cases / case.answer["id"] / name).write_text(str(case.answer["seed"]))


@pytest.fixture
def quick_make(monkeypatch):
    """A make that writes its seed, and has no case for odd seeds."""
    from benchmarks.gapbench.makes import Make, NoCase

    def draw_case(seed, kind):
        if seed % 2:
            raise NoCase(f"Seed {seed} gives none.")
        return _Made(seed, kind)

    make = Make(lambda seed, kind: f"c{seed}{kind}", lambda _, kind: kind, draw_case, _write)
    monkeypatch.setattr(splits, "make_named", lambda _: make)
    return make


def test_where_a_seed_gives_no_case_the_spare_one_is_drawn(quick_make, tmp_path, monkeypatch):
    monkeypatch.setattr(splits, "NEXT_SEED", 501)
    assert draw_listed([Listed("mujoco", "null", 7)], tmp_path) == (["c508null"], [])


def test_a_seed_without_any_case_is_reported(quick_make, tmp_path):
    assert draw_listed([Listed("mujoco", "null", 7)], tmp_path) == ([], [f"Seed {7 + 4 * NEXT_SEED} gives none."])


def test_files_that_are_not_those_of_the_list_are_reported(quick_make, tmp_path):
    _, (sentence,) = draw_listed([Listed("mujoco", "null", 8, sha256="0" * 64)], tmp_path)
    assert sentence.startswith("The files of 1 cases are not those of the list, first c8null: say so beside a score")


def test_hidden_seeds_follow_from_the_key_and_cannot_be_guessed():
    mine, other = (hidden_cases(NAMES, key) for key in (KEY, KEY[::-1]))
    assert mine == hidden_cases(NAMES, KEY)
    assert not {one.seed for one in mine} & {one.seed for one in other}
    assert len({one.seed for one in mine}) == 300
    assert max(one.seed for one in mine) > 2**90


def test_a_make_takes_a_seed_of_a_hidden_case():
    listed = next(one for one in hidden_cases(["slow"], KEY) if one.kind == "null")
    assert make_named("slow").case_id(listed.seed, "null").startswith("s")


def test_sealed_answers_open_with_the_key_alone(quick_make, tmp_path):
    draw_listed([Listed("mujoco", "null", 8)], tmp_path)
    closed = seal_answers(tmp_path, KEY)
    assert not (tmp_path / "answers").exists()
    assert b"seed" not in closed.read_bytes()
    assert truths(tmp_path, KEY) == [{"id": "c8null", "seed": 8}]
    with pytest.raises(SplitError, match="are sealed: only who has the key can score"):
        truths(tmp_path)
    with pytest.raises(SplitError, match="do not open with this key"):
        truths(tmp_path, KEY[::-1])


def test_more_sealed_answers_join_those_that_are_there(quick_make, tmp_path):
    for seed in (8, 10):
        draw_listed([Listed("mujoco", "null", seed)], tmp_path)
        seal_answers(tmp_path, KEY)
    assert [one["seed"] for one in truths(tmp_path, KEY)] == [10, 8]


def test_a_key_that_is_short_or_not_there_is_refused(tmp_path):
    with pytest.raises(SplitError, match=r"There is no key in .*: make one with 'openssl rand -hex 32"):
        read_key(tmp_path / "key")
    (tmp_path / "key").write_text("secret\n")
    with pytest.raises(SplitError, match="has 6 characters: take 32 or more"):
        read_key(tmp_path / "key")


def test_a_folder_without_cases_is_reported(tmp_path):
    with pytest.raises(SplitError, match=r"There are no answers in .*: draw the cases with 'gapbench draw public"):
        truths(tmp_path)


def test_a_make_whose_packages_are_missing_is_left_out_in_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setitem(EXTRAS, "field", ("no_such_package",))
    sentence = "Cases of the make field are left out: pip install 'gapbench[field]' brings no_such_package."
    assert missing("field") == sentence
    assert draw_listed(public_cases(["field"]), tmp_path) == ([], [sentence])


TOOL = """
import json
import sys
from pathlib import Path

import numpy as np

cases, answers = map(Path, sys.argv[1:])
answers.mkdir()
for case in cases.iterdir():
    log = np.genfromtxt(case / "log.csv", delimiter=",", names=True, deletechars="")
    joint = [name[2:] for name in log.dtype.names if name.startswith("q.")][-1]
    v = np.gradient(log["q." + joint], log["t"])
    sign = np.sign(v)
    # Half of the difference of the torques of both directions.
    torque = (log["tau." + joint][sign > 0].mean() - log["tau." + joint][sign < 0].mean()) / 2
    size = {"value": abs(float(torque)), "std": 0.1 * abs(float(torque))}
    answer = {
        "verdict": "explained",
        "findings": [
            {
                "effect": "coulomb_friction",
                "joint": joint,
                "probability": 0.5,
                "rivals": [{"effects": [{"effect": "viscous_friction", "joint": joint}], "probability": 0.5}],
                "parameters": {"torque": size},
            }
        ],
    }
    (answers / (case.name + ".json")).write_text(json.dumps(answer))
"""

SCORED = """
import sys
from benchmarks.gapbench.__main__ import main
code = main(sys.argv[1:])
loaded = {name.partition(".")[0] for name in sys.modules}
print("loaded:", sorted(loaded & {"phantom_dyn", "identification", "pinocchio"}), file=sys.stderr)
sys.exit(code)
"""

LOG = """t,q.j1,tau.j1
0.0,0.0,0.3
0.1,0.1,0.3
0.2,0.2,0.3
0.3,0.2,-0.3
0.4,0.1,-0.3
0.5,0.0,-0.3
"""


@pytest.fixture(scope="module")
def scored(tmp_path_factory):
    """What the command says of the tool, in a process of its own: an invented recording of 0.3 N m of friction."""
    work = tmp_path_factory.mktemp("stranger")
    case = work / "drawn" / "cases" / "c1"
    case.mkdir(parents=True)
    (case / "log.csv").write_text(LOG)
    (case / "robot.urdf").write_text("<robot/>")
    effect = {"effect": "coulomb_friction", "joint": "j1", "parameters": {"torque": 0.3}, "gap_in_floors": 9.0}
    answer = {
        "id": "c1",
        "kind": "single",
        "robot": "planar2",
        "joints": ["j1"],
        "effects": [effect],
        "outside": None,
        "paired_gap": 9.0,
        "gap_in_floors": [9.0],
        "noise_floor": [0.01],
    }
    (work / "drawn" / "answers").mkdir()
    (work / "drawn" / "answers" / "c1.json").write_text(json.dumps(answer))
    tool = [sys.executable, "-c", TOOL, str(work / "drawn" / "cases"), str(work / "tool")]
    subprocess.run(tool, check=True, cwd=work)
    words = ["score", str(work / "drawn"), str(work / "tool"), "--json", str(work / "score.json")]
    done = subprocess.run(
        [sys.executable, "-c", SCORED, *words], cwd=CHECKOUT, capture_output=True, text=True, check=True
    )
    return done, json.loads((work / "score.json").read_text())


def test_the_tool_has_some_thirty_lines():
    assert len(TOOL.strip().splitlines()) <= 33


def test_scoring_loads_neither_the_library_nor_its_engine(scored):
    assert scored[0].stderr == "loaded: []\n"


def test_the_made_up_tool_is_scored(scored):
    of = {name: groups["gap >= 0"] for name, groups in scored[1]["figures"].items()}
    assert (of["cause leading"]["hits"], of["cause leading"]["total"]) == (1, 1)
    assert of["size within its 95 % interval"]["hits"] == 1
    assert of["causes listed per case"]["mean"] == 2.0


def test_no_file_of_the_distribution_imports_the_library():
    barred = ("phantom_dyn", "identification", "pinocchio", "benchmarks")
    for path in (CHECKOUT / "benchmarks" / "gapbench").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [x.name for x in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            assert not [name for name in names if name.partition(".")[0] in barred], path
