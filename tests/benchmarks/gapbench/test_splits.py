"""Public and hidden cases. Oracle: the counts of the card, the sums in the list, and what a key must do."""

from __future__ import annotations

from collections import Counter
from importlib.metadata import version

import pytest

from benchmarks.gapbench import splits
from benchmarks.gapbench.makes import EXTRAS, NAMES, make_named, missing
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
    again = [one for one in public_cases(["mujoco"]) if (one.kind, one.seed) in (("null", 101001), ("null", 101004))]
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
