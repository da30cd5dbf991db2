"""Sealed cases: reproducible, without a hint, unreadable answers, and some through the command line."""

import json
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind.generate import KINDS, draw_many, draw_one
from benchmarks.blind.run import default_command, diagnose_all
from benchmarks.blind.score import load_pairs
from benchmarks.gapbench.generator.case import case_id, draw_case, resolved_kind
from benchmarks.gapbench.generator.effects import SINGLE_EFFECTS
from benchmarks.gapbench.seal import NAME, decrypted, encrypted, sealed
from identification.cli.main import main
from places import CHECKOUT

SEED = 12  # a pendulum: the quickest to move
# An effect and a null; by night pendulum, planar arm, three-joint arm and PHANToM, an offset, and each other kind. With
# them at least so many of these single effects of four noise floors or more that are named.
FEW = (("single", range(SEED, SEED + 1)), ("null", range(SEED, SEED + 1)))
SOME = (("single", range(1, 4)), *FEW, ("pair", range(1, 2)), ("outside", range(1)))
LARGE = 4.0


@pytest.fixture(scope="module")
def case():
    return draw_case(SEED, "single")


@pytest.fixture(scope="module")
def drawn_once(tmp_path_factory):
    """A folder with the folders of one case and its answer, which are only copied."""
    work = tmp_path_factory.mktemp("drawn")
    draw_one(SEED, work / "cases", work / "answers")
    return work


def test_the_generator_runs_where_the_diagnosis_and_its_engine_cannot_be_imported():
    code = """
        import sys

        class Refuse:
            def find_spec(self, name, path=None, target=None):
                if name.partition(".")[0] in ("phantom_dyn", "identification", "pinocchio"):
                    raise ImportError(f"{name} must not be imported here")

        sys.meta_path.insert(0, Refuse())
        from benchmarks.gapbench.generator.case import draw_case
        print(draw_case(0, "null").answer["kind"])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], cwd=CHECKOUT, capture_output=True, text=True, check=False
    )
    assert (done.stdout.strip(), done.returncode) == ("null", 0), done.stderr


def test_a_case_is_a_function_of_its_seed(case):
    again = draw_case(SEED, "single")
    assert (again.urdf, again.yaml, again.answer) == (case.urdf, case.yaml, case.answer)
    np.testing.assert_array_equal(again.log, case.log)


def test_other_seeds_give_other_ids():
    assert len({case_id(seed, kind) for seed in range(50) for kind in KINDS[1:]}) == 200


def test_a_mixed_case_is_the_same_case_as_the_kind_it_turns_out_to_be():
    seed = next(s for s in range(100) if resolved_kind(s, "mixed") == "single")
    assert case_id(seed, resolved_kind(seed, "mixed")) == case_id(seed, "single")


def test_about_half_of_mixed_cases_are_nulls():
    assert 80 < sum(resolved_kind(seed, "mixed") == "null" for seed in range(200)) < 120


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match="No kind 'double': there are null, single, pair, outside and mixed"):
        draw_case(SEED, "double")


def test_the_case_folder_holds_robot_configuration_and_log_only(drawn_once):
    (folder,), (answer,) = ((drawn_once / name).iterdir() for name in ("cases", "answers"))
    assert sorted(p.name for p in folder.iterdir()) == ["log.csv", "robot.urdf", "robot.yaml"]
    text = "".join(p.read_text() for p in folder.iterdir())
    said = {"rotor_inertia"}  # the owner states the modelled one of every joint
    assert not [word for word in ({*SINGLE_EFFECTS, "seed", "paired"} - said) if word in text]
    assert json.loads(answer.read_text())["kind"] == "single"


def test_the_effect_of_a_single_case_is_outside_the_tolerance(case):
    answer = case.answer
    assert answer["beyond_tolerance"] >= 0.9 * min(0.5 * answer["paired_gap"], 2.0)


def test_the_log_has_the_columns_of_the_contract(case):
    assert case.header == ("t", "q.j1", "tau.j1")
    assert np.isfinite(case.log).all()
    assert (np.diff(case.log[:, 0]) > 0).all()


@pytest.mark.parametrize(("seed", "kind"), [(0, "normal"), (6, "full"), (12, "effect_inside")])
def test_nulls_use_the_tolerance_in_three_ways(seed, kind):
    answer = draw_case(seed, "null").answer
    assert (answer["null_kind"], answer["truth"], answer["paired_gap"]) == (kind, [], 0.0)
    assert (answer["inside"] is not None) == (kind == "effect_inside")


def test_a_case_from_outside_names_its_cause_and_no_finding():
    answer = draw_case(0, "outside").answer
    assert (answer["truth"], answer["outside"]["name"]) == ([], "friction_warm_up")
    assert answer["gap_in_floors"] == [answer["paired_gap"]]


def test_a_wrong_key_does_not_open_the_answers():
    with pytest.raises(ValueError, match="do not open with this key"):
        decrypted(encrypted(b"viscous_friction", b"right" * 7), b"wrong" * 7)


def test_sealing_and_opening_changes_no_answer(tmp_path):
    (tmp_path / "a.json").write_text('{"effect": "payload"}')
    with sealed(tmp_path):
        assert [p.name for p in tmp_path.iterdir()] == [NAME]
        assert b"payload" not in (tmp_path / NAME).read_bytes()
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.json", '{"effect": "payload"}')]


def test_answers_are_opened_again_when_a_diagnosis_breaks(tmp_path):
    (tmp_path / "a.json").write_text("{}")
    with pytest.raises(RuntimeError), sealed(tmp_path):
        raise RuntimeError
    assert (tmp_path / "a.json").is_file()


# A diagnosis that looks for the answer: in every file of the work folder (given to it here, unknown to a real one), in
# its environment, its open files, and what the system tells of its parent. Root is stopped by nothing but the seal.
SPY = """
import json, os, pathlib, sys
found, word = [], sys.argv[2].encode()
places = [p for p in pathlib.Path(sys.argv[1]).rglob("*") if p.is_file()]
places += [pathlib.Path(f"/proc/{pid}/{name}") for pid in (os.getpid(), os.getppid()) for name in ("environ",)]
places += [pathlib.Path(f"/proc/{os.getppid()}/cmdline")]
places += [p for pid in (os.getpid(), os.getppid()) for p in pathlib.Path(f"/proc/{pid}/fd").glob("*") if p.is_file()]
for place in places:
    try:
        if word in place.read_bytes():
            found.append(str(place))
    except OSError:
        pass
result = {"verdict": "no_gap", "findings": [], "joints": [], "found": found, "looked_at": len(places)}
pathlib.Path(sys.argv[sys.argv.index("--json") + 1]).write_text(json.dumps(result))
"""


@pytest.fixture
def work(drawn_once, tmp_path):
    return Path(shutil.copytree(drawn_once, tmp_path / "work"))


def spied(work, answer_name):
    """What the spy finds of a word that stands only in the answer, run in place of the diagnosis."""
    (folder,), (answer,) = ((work / name).iterdir() for name in ("cases", "answers"))
    word = '"drawn_size"'
    assert word in answer.read_text()
    answer.rename(answer.with_name(answer_name or answer.name))
    spy = work.parent / "spy.py"
    spy.write_text(SPY)
    command = [sys.executable, str(spy), str(work), word]
    diagnose_all([folder.name], work / "cases", work / "answers", work / "results", command=command, jobs=1)
    return json.loads((work / "results" / f"{folder.name}.json").read_text())["diagnosis"]


def test_the_diagnosing_process_cannot_read_the_answer(work):
    seen = spied(work, None)
    assert seen["looked_at"] >= 4
    assert seen["found"] == []


def test_the_spy_would_have_found_an_answer_that_is_not_sealed(work):
    assert spied(work, "left_open.txt")["found"]


def test_a_case_with_a_result_is_not_diagnosed_again(tmp_path):
    results = tmp_path / "results"
    results.mkdir()
    (results / "c1.json").write_text("kept")
    (tmp_path / "answers").mkdir()
    diagnose_all(["c1"], tmp_path, tmp_path / "answers", results, command=["false"], jobs=1)
    assert (results / "c1.json").read_text() == "kept"


def diagnosed_here(names, cases, results):
    """Results as `diagnose_all` writes them, without a process for each: that takes two seconds before it begins."""
    results.mkdir()
    for name in names:
        out = cases / name / "diagnosis.json"
        code = main(["diagnose", str(cases / name / "robot.urdf"), str(cases / name / "log.csv"), "--json", str(out)])
        entry = {"id": name, "exit_code": code, "seconds": 1.0, "said": "", "diagnosis": None}
        if code == 0:
            entry["diagnosis"] = json.loads(out.read_text())
        (results / f"{name}.json").write_text(json.dumps(entry))


@pytest.mark.whole
@pytest.mark.parametrize(("drawn", "named"), [(FEW, 1), pytest.param(SOME, 3, marks=pytest.mark.nightly)])
def test_some_sealed_cases_through_the_command_line(tmp_path, drawn, named):
    """Known truth: no false claim, no crash, and most of the large single effects named."""
    cases, answers, results = (tmp_path / name for name in ("cases", "answers", "results"))
    names = [name for kind, seeds in drawn for name in draw_many(seeds, kind, cases, answers, 1)]
    diagnosed_here(names[:-1], cases, results)
    diagnose_all(names, cases, answers, results, command=default_command(), jobs=1)  # the last one
    assert len(list(results.iterdir())) == len(names)
    scored = load_pairs(answers, results, names)
    assert not [x.id for x in scored if x.verdict == "failed"]
    assert sum(x.false_claim for x in scored if x.kind == "null") == 0
    large = [x for x in scored if x.kind == "single" and x.gap >= LARGE]
    assert sum(x.top1 for x in large) >= named, [(x.effect, x.claims) for x in large if not x.top1]
