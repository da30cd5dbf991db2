"""Which numbers and gates may change an answer, and what is counted where they do; oracles are made up by hand."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.ablation import FOLDERS, deciding, groups_of, one_make_after_the_other, with_table
from benchmarks.ablation_numbers import Followed, Named, Trace, followed, named_numbers, scaled
from benchmarks.ablation_runs import Case, Outcome, of_given
from benchmarks.ablation_table import (
    MET,
    Effect,
    gates_to_leave_out,
    may_change,
    met_as,
    met_in,
    numbers_table,
    of_gates,
    of_numbers,
)
from benchmarks.given_cases import Answered

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "ablation.md").read_text()

MODULE = """
# share: of the gap.
SHARE = 0.01
_SOME, _MORE = 2, 3.0
TIMES: tuple[float, ...] = (0.1, 0.2)
NOT_A_NUMBER = "0.1"
FLAG = True
DERIVED = 2.0 * SHARE
lower_case = 4.0
"""


@pytest.fixture
def module(tmp_path: Path) -> dict[str, Named]:
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "rules.py").write_text(MODULE)
    return {n.name: n for n in named_numbers(["package"], tmp_path)}


def test_named_numbers_are_the_constants_of_a_module_that_are_numbers(module: dict[str, Named]) -> None:
    assert {name: n.value for name, n in module.items()} == {
        "SHARE": 0.01,
        "_SOME": 2,
        "_MORE": 3.0,
        "TIMES": (0.1, 0.2),
    }


def test_a_named_number_has_the_unit_of_the_comment_above_it(module: dict[str, Named]) -> None:
    assert module["SHARE"].unit == "share"


@pytest.mark.parametrize(
    ("value", "factor", "expected"),
    [
        (0.3, 2.0, 0.6),
        (0.96, 2.0, 0.98),
        (0.96, 0.5, 0.92),
        (5, 0.5, 2),
        (1, 0.5, 1),
        (0, 2.0, 0),
        ((1.0, 4.0), 0.5, (0.5, 2.0)),
    ],
)
def test_a_number_is_halved_or_doubled_and_a_count_stays_one(value: object, factor: float, expected: object) -> None:
    assert scaled(value, factor) == pytest.approx(expected)  # type: ignore[arg-type]


def number(value: float) -> tuple[Followed, Trace]:
    trace = Trace()
    one = followed(Named("m", "N", value, ""), trace)
    assert isinstance(one, Followed)
    return one, trace


# With 1.0 the first is false; 0.5 turns the first, 2.0 the second, neither the third.
@pytest.mark.parametrize(
    ("compared", "flips"), [(0.7, [1, 0]), (1.5, [0, 1]), (5.0, [0, 0]), (0.1, [0, 0]), (np.float64(0.7), [1, 0])]
)
def test_a_comparison_counts_where_half_or_twice_the_number_turns_it(compared: float, flips: list[int]) -> None:
    one, trace = number(1.0)
    assert (compared > one) == (compared > 1.0)  # type: ignore[operator]
    assert trace.flips == {"m:N": flips}


def test_a_number_is_followed_through_arithmetic() -> None:
    one, trace = number(2.0)
    # 3 N + 1 is 7; with half the number 4, with twice 13: only the half brings it below 5.
    assert max(3.0 * one + 1.0, 0.0) > 5.0  # type: ignore[operator]
    assert trace.flips == {"m:N": [1, 0]}


def test_an_array_that_is_compared_counts_if_any_of_it_turns() -> None:
    one, trace = number(1.0)
    np.testing.assert_array_equal(np.array([0.1, 3.0]) > one, [False, True])  # type: ignore[operator]
    np.testing.assert_array_equal(np.array([0.1, 1.5]) > one, [False, True])  # type: ignore[operator]
    assert trace.flips == {"m:N": [0, 1]}


@pytest.mark.parametrize(
    "use", [lambda n: np.arange(2.0) * n, np.asarray, float, lambda n: [1, 2, 3][: n.__index__()], np.atleast_1d]
)
def test_a_number_is_lost_where_it_goes_into_an_array_or_becomes_plain(use: object) -> None:
    trace = Trace()
    use(Followed(2, {"m:N": (1, 4)}, trace))  # type: ignore[operator]
    assert trace.lost == {"m:N": 1}


FOLLOWED = {
    "skip": ["m:COUNT"],
    "trace": {
        "asked": {"m:FAR": 3, "m:NEAR": 2},
        "flips": {"m:FAR": [0, 0], "m:NEAR": [0, 1]},
        "lost": {"m:LOST": 1},
        "gates": {
            "alone": {"in enough blocks": 1},
            "refused": {"in enough blocks": 9, "fair part of the gap": 4, "visible": 1},
        },
    },
}


def test_numbers_may_change_a_case_that_turn_a_comparison_or_cannot_be_followed() -> None:
    names = ["m:FAR", "m:NEAR", "m:LOST", "m:COUNT", "m:NEVER"]
    assert may_change(FOLLOWED, names, 0) == ["m:LOST", "m:COUNT"]
    assert may_change(FOLLOWED, names, 1) == ["m:NEAR", "m:LOST", "m:COUNT"]


def test_a_gate_of_the_search_is_left_out_where_it_alone_refused_and_one_of_the_judge_where_it_refused() -> None:
    gates = ["fair part of the gap", "in enough blocks", "visible", "large enough"]
    assert gates_to_leave_out(FOLLOWED, gates) == ["in enough blocks", "visible"]


def test_of_a_stored_ledger_a_gate_is_left_out_where_it_refused_but_never_that_of_chance() -> None:
    stored = {"refused": ["more than chance", "visible"]}
    assert gates_to_leave_out(stored, ["more than chance", "visible", "large enough"]) == ["visible"]


def test_halving_groups_finds_the_numbers_that_decide() -> None:
    names, right = [f"m:N{k}" for k in range(11)], {"m:N2", "m:N3", "m:N9"}
    tried: list[int] = []

    def differs(some: object) -> bool:
        tried.append(len(list(some)))  # type: ignore[call-overload]
        return not right.isdisjoint(some)  # type: ignore[arg-type]

    assert set(deciding(names, differs)) == right
    assert not deciding(names[4:9], differs)
    assert tried[-1] == 5  # one run says that none of five decides


def said(verdict: str, findings: tuple[str, ...], *, right: bool, wrong: bool) -> dict:
    return {"verdict": verdict, "findings": list(findings), "right": right, "wrong": wrong}


NOTHING = said("no_gap", (), right=True, wrong=False)
FALSE_CLAIM = said("explained", ("backlash j1",), right=False, wrong=True)
MISSED = said("no_gap", (), right=False, wrong=False)
FOUND = said("explained", ("backlash j1 or cogging j1",), right=True, wrong=False)
# Without the gate two nulls of one make get a false claim, and an effect that is missed is found in each make.
LEDGER = {
    "one/a": {"follow": NOTHING, "without visible": FALSE_CLAIM},
    "one/b": {"follow": NOTHING, "without visible": FALSE_CLAIM},
    "one/c": {"follow": MISSED, "without visible": FOUND, "0.5 m:N m:M": FOUND, "0.5 m:N": FOUND, "0.5 m:M": MISSED},
    "two/d": {"follow": MISSED, "without visible": FOUND},
}


def test_a_gate_left_out_counts_wrong_answers_that_it_prevents_and_right_ones_that_it_costs() -> None:
    one = of_gates(LEDGER, ["visible"])["visible"]
    assert (one.prevented, one.lost, one.kept) == ({"one": 2, "two": 0}, {"one": 1, "two": 1}, {"one": 2, "two": 0})


def test_a_gate_stays_if_it_prevents_two_wrong_answers_and_costs_no_more_on_any_make() -> None:
    both = of_gates(LEDGER, ["visible"])["visible"]
    alone = of_gates({key: runs for key, runs in LEDGER.items() if key.startswith("one")}, ["visible"])["visible"]
    assert alone.earns_its_place
    assert not both.earns_its_place  # it costs one on the make on which it prevents none
    assert not Effect().earns_its_place


def test_a_number_counts_by_the_runs_that_change_it_alone() -> None:
    effects = of_numbers(LEDGER, 0.5)
    assert {name: sum(one.changed.values()) for name, one in effects.items()} == {"m:N": 1, "m:M": 0}


@pytest.mark.parametrize(
    ("name", "words"),
    [("m:NEVER", MET[0]), ("m:FAR", MET[1]), ("m:NEAR", MET[2]), ("m:LOST", MET[3]), ("m:COUNT", MET[4])],
)
def test_a_number_that_decides_nothing_is_reported_by_how_near_it_came_and_what_was_run(name: str, words: str) -> None:
    runs = {"follow": {**NOTHING, **FOLLOWED}, "2.0 m:NEAR m:LOST": NOTHING}
    assert met_as({"one/a": runs}, name) == words


def test_a_group_that_changes_no_answer_counts_for_each_number_and_one_that_does_for_none() -> None:
    runs = {"follow": NOTHING, "0.5 m:A m:B": NOTHING, "0.5 m:C m:D": FALSE_CLAIM, "0.5 m:C": FALSE_CLAIM}
    assert met_in({"one/a": runs}, 0.5) == {"m:A": (1, 0), "m:B": (1, 0), "m:C": (1, 1)}


def test_a_number_with_which_a_diagnosis_fails_is_left_out_of_groups_and_changes_no_answer() -> None:
    runs = {"follow": NOTHING, "0.5 m:A": said("failed", (), right=False, wrong=False)}
    assert met_in({"one/a": runs}, 0.5) == {"m:A": (1, 1)}
    effect = of_numbers({"one/a": runs}, 0.5)["m:A"]
    assert (effect.failed, effect.changed, effect.kept) == ({"one": 1}, {}, {})


def test_groups_grow_with_cases_without_another_answer_and_leave_out_what_decides_elsewhere() -> None:
    names = [f"m:N{k}" for k in range(30)]
    elsewhere = {"m:N0": (3, 1), **{name: (1, 0) for name in names[20:]}}
    assert [len(group) for group in groups_of(names, elsewhere)] == [16, 8, 5]
    assert list(groups_of(names, elsewhere, again=True)) == [["m:N0"]]


def test_the_first_cases_are_the_quickest_of_every_make() -> None:
    def outcome(_: Path) -> Outcome:
        raise AssertionError

    seconds = {"one/a": 3.0, "one/b": 1.0, "one/c": 9.0, "two/d": 5.0}
    kinds = {"one/c": "single"}
    cases = [Case(key[:3], key[4:], kinds.get(key, "null"), (), outcome) for key in seconds]
    assert [case.key for case in one_make_after_the_other(cases, seconds)] == ["one/b", "two/d", "one/c", "one/a"]


def test_a_finding_is_wrong_if_neither_it_nor_a_rival_is_there() -> None:
    truth = (("backlash", "j1"),)

    def outcome(effect: str, *rivals: str) -> Outcome:
        listed = [{"effects": [{"effect": rival, "joint": "j1"}]} for rival in rivals]
        finding = {"effect": effect, "joint": "j1", "rivals": listed}
        return of_given(Answered("a", 5.0, truth, (frozenset(truth),), {"verdict": "explained", "findings": [finding]}))

    assert outcome("backlash") == Outcome(right=True, wrong=False)
    assert outcome("cogging", "backlash") == Outcome(right=False, wrong=False)
    assert outcome("cogging") == Outcome(right=False, wrong=True)


def test_a_gate_left_out_lets_pass_what_it_refuses_wherever_it_was_imported() -> None:
    code = (
        "import identification.diagnosis.search.claims as user\n"
        "from benchmarks.ablation_runs import leave_out\n"
        "assert not user.fair_part_of_the_gap(1.0, 2.0).passed\n"
        "leave_out(['fair part of the gap'])\n"
        "assert user.fair_part_of_the_gap(1.0, 2.0).passed\n"
        "assert not user.more_than_chance(1.0, 2.0).passed\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).resolve().parents[2])


def test_every_number_that_the_page_names_is_in_the_code() -> None:
    # Oracle: the constants of the modules, read from their source.
    known = {f"{number.module.split('.')[-1]}.{number.name}" for number in named_numbers(FOLDERS)}
    named = set(re.findall(r"`(\w+\.[A-Z_][A-Z0-9_]*)`", PAGE))
    assert len(named) > 100
    assert named - known == set()


def test_the_page_counts_the_numbers_that_it_lists() -> None:
    lists = re.findall(r"^\w[^`\n]* \((\d+)\): (`.*)\.$", PAGE, flags=re.MULTILINE)
    assert lists
    assert [int(count) for count, _ in lists] == [names.count(", ") + 1 for _, names in lists]


def test_the_page_gets_each_table_between_its_markers() -> None:
    page = "before\n<!-- gates -->\nold\n<!-- end of gates -->\nafter\n<!-- numbers -->\n<!-- end of numbers -->\n"
    with_gates = page.replace("old", "\nnew\n")
    assert with_table(page, "gates", "new") == with_gates


def test_the_table_of_numbers_says_which_decide_how_the_others_were_met_and_in_how_many_cases() -> None:
    runs = {
        "follow": {**NOTHING, **FOLLOWED, "kind": "null"},
        "2.0 m:NEAR m:LOST": NOTHING,
        "2.0 m:COUNT": FALSE_CLAIM,
        "0.5 m:BAD": said("failed", (), right=False, wrong=False),
    }
    numbers = [Named("m", name, 3, "counts") for name in ("COUNT", "NEAR", "FAR", "BAD")]
    text = numbers_table({"one/a": runs, "one/b": {"stored": {**NOTHING, "kind": "null"}}}, numbers)
    assert "Followed: 1 cases: one 1 null. Changed in 1 of these: 1 cases: one 1 null." in text
    assert "Of 4 named numbers 1 were found to decide" in text
    assert "| `m.COUNT` | 3 counts | 2 | 1 | 1 one | 1 one | 1 one | - | - |" in text
    assert f"{MET[2].capitalize()} (1): `m.NEAR`." in text
    assert f"{MET[1].capitalize()} (1): `m.FAR`." in text
    assert f"{MET[-1].capitalize()} (1): `m.BAD`." in text
