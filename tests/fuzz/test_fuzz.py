"""A short share of `make fuzz`, with fixed seeds: hostile files of every kind, and what no case may do.

Oracle: the contract (bad input is one clear sentence with exit code 2; every number of an output is finite).
"""

import random
import time
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

import fuzz_oracle
from fuzz_cases import KINDS, drawn_case, tried
from fuzz_oracle import Outcome, failures, ran
from fuzz_seeds import Seeds, make_seeds
from identification.reporting.stored.diagnosis_files import json_text
from made_up_diagnosis import made_up_diagnosis

CASES = {"csv": 30, "npz": 30, "parquet": 20, "bag": 20, "robot": 40, "robot.yaml": 40, "columns": 30, "json": 30}
"""Cases of each kind; a whole diagnosis takes as long as all of these and is left to `make fuzz`."""
FINE = Outcome(0, "done\n", "", "", 0.1, 10**8, {})


@pytest.fixture(scope="module")
def seeds(tmp_path_factory) -> Seeds:
    made = make_seeds(tmp_path_factory.mktemp("seeds"))
    made.texts["diagnosis.json"] = json_text(made_up_diagnosis())
    return made


@pytest.mark.whole
@pytest.mark.parametrize("kind", CASES)
def test_hostile_files_are_refused_in_a_sentence_or_read(kind, seeds, tmp_path_factory):
    @seed(1)
    @settings(max_examples=CASES[kind], deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(st.randoms(use_true_random=True))
    def all_cases(rng: random.Random) -> None:
        folder: Path = tmp_path_factory.mktemp("case")
        case = drawn_case(rng, seeds, kind)
        _, found = tried(case, seeds, folder)
        assert found == [], f"{' '.join(case.words)} in {folder}"

    all_cases()


def test_every_kind_of_file_is_mutated():
    assert set(CASES) <= set(KINDS)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"code": None, "raised": "ValueError: no"}, "traceback"),
        ({"code": 1}, "exit code 1"),
        ({"seconds": 61.0}, "61 s"),
        ({"peak": 2 * 10**9}, "2000 MB"),
        ({"code": 2, "err": "phantom-dyn: wrong: give another.\n"}, "names no file"),
        ({"code": 2, "err": "phantom-dyn: log.csv is wrong.\n"}, "no advice"),
        ({"code": 2, "err": "log.csv is wrong: give another.\n"}, "no line of ours"),
        ({"out": "the gap is nan N m\n"}, "not finite on the terminal"),
        ({"out": "red \x1b[31m\n"}, "control character"),
        ({"written": {"diagnosis.json": '{"gap": NaN}'}}, "no JSON of finite numbers"),
        ({"written": {"a.csv": "q,v\n0,inf\n"}}, "a.csv is not finite"),
        ({"written": {"a.csv": "joint,q\n=1+2,0\n"}}, "formula"),
        ({"written": {".diagnosis.0a.json": "{}"}}, "litter"),
    ],
)
def test_the_oracle_sees_each_kind_of_failure(change, message):
    # Known truth: outcomes that are wrong in one way, made by hand.
    outcome = Outcome(**{**vars(FINE), **change})
    assert failures(FINE, ["log.csv"]) == []
    assert any(message in found for found in failures(outcome, ["log.csv"]))


def busy(_: object) -> None:
    while True:
        pass


def test_what_takes_too_long_is_ended_by_its_processor_time(monkeypatch):
    # Known truth: a command that works and one that waits.
    monkeypatch.setattr(fuzz_oracle, "SECONDS", -0.9)
    monkeypatch.setattr(fuzz_oracle, "main", busy)
    assert "OutOfTime: more than" in ran(["check"]).raised
    monkeypatch.setattr(fuzz_oracle, "SECONDS", 60.0)
    monkeypatch.setattr(fuzz_oracle, "WAITED_S", 0.1)
    monkeypatch.setattr(fuzz_oracle, "main", lambda _: time.sleep(20))
    assert "OutOfTime: more than 0 s" in ran(["check"]).raised


@pytest.mark.parametrize("code", [130, 143])
def test_a_signal_to_the_command_ends_the_run(code, monkeypatch):
    monkeypatch.setattr(fuzz_oracle, "main", lambda _: code)
    with pytest.raises(KeyboardInterrupt):
        ran(["check"])
