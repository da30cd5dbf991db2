"""Entries of a ledger, and the loop that takes away what fails worst. Oracle: by hand."""

from __future__ import annotations

import pytest

from identification.engine.claims import (
    Claim,
    GateResult,
    easiest,
    fails_worst,
    until_failed,
    until_nothing_changes,
)


def result(value: float, needed: float = 1.0, gate: str = "gain") -> GateResult:
    return GateResult(gate, value, needed, "1", value > needed)


def test_gates_are_asked_up_to_the_first_that_fails():
    asked = []

    def results():
        for value in (2.0, 0.5, 3.0):
            asked.append(value)
            yield result(value)

    assert [one.passed for one in until_failed(results())] == [True, False]
    assert asked == [2.0, 0.5]


def test_a_claim_has_failed_the_one_gate_that_it_did_not_pass():
    passed, failed = result(2.0), result(0.5)
    assert Claim(("friction",), (passed, failed), "not_claimed").failed is failed
    assert Claim(("friction",), (passed,), "claimed").failed is None


def test_what_fails_worst_is_furthest_below_what_it_needs_in_parts_of_it():
    # By hand: 30 of 100 is less than 1 of 2, and 5 of 1 passes.
    assert fails_worst({"a": result(1.0, 2.0), "b": result(30.0, 100.0), "c": result(5.0)}) == "b"


def test_nothing_fails_worst_where_all_pass():
    assert fails_worst({"a": result(2.0)}) is None


def test_where_nothing_is_needed_the_figure_itself_is_compared():
    assert fails_worst({"a": result(-1.0, 0.0), "b": result(-3.0, 0.0)}) == "b"


def test_a_gate_of_several_ways_is_passed_by_any_of_them_and_asks_no_further():
    def ways():
        yield 1.0, 2.0, "one"
        yield 5.0, 2.0, "two"
        pytest.fail("a way that is not needed was asked for")

    found = easiest("gate", ways())
    assert (found.value, found.unit, found.passed) == (5.0, "two", True)


def test_of_ways_that_all_fail_the_nearest_is_stated():
    # By hand: three quarters are nearer than a half.
    found = easiest("gate", [(1.0, 2.0, "half"), (3.0, 4.0, "three quarters")])
    assert (found.unit, found.passed) == ("three quarters", False)


def test_after_each_change_the_first_step_is_taken_again_until_nothing_changes():
    taken = []

    def halved(x: tuple[int]) -> tuple[int]:
        taken.append("halved")
        return (x[0] // 2,) if x[0] % 2 == 0 else x

    def less(x: tuple[int]) -> tuple[int]:
        taken.append("less")
        return (x[0] - 1,) if x[0] > 1 else x

    # By hand: 6, 3, 2, 1.
    assert until_nothing_changes((6,), [halved, less]) == (1,)
    assert taken == ["halved", "halved", "less", "halved", "halved", "less"]
