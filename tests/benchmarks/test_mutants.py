"""The sample of deliberate mistakes. Oracles: Wilson's formula as published, and changes written out by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.mutant_sample import AREAS, CHECKOUT, left_out, worth_trying
from benchmarks.mutants import covering, wilson

SOURCE = """\
from x import property
def f(a: int | None, b=1 + 2) -> int | None:
    raise ValueError(f"{a + 1} is wrong")
class A:
    @property(1 + 2)
    def g(self):
        c: int | str = 3 - 4
        return c
"""


@pytest.mark.parametrize(
    ("killed", "tried", "low", "high"),
    # Brown, Cai and DasGupta (2001): (p + z^2/2n +- z sqrt(p q / n + z^2 / 4 n^2)) / (1 + z^2 / n), by hand.
    [(0, 10, 0.0, 0.27753), (10, 10, 0.72247, 1.0), (5, 10, 0.23659, 0.76341), (0, 0, 0.0, 1.0)],
)
def test_the_interval_is_that_of_wilson(killed, tried, low, high):
    assert wilson(killed, tried) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(
    ("line", "text", "out"),
    [
        (2, "| None, b", True),
        (2, "+ 2", False),
        (2, "| None:", True),
        (3, "+ 1", True),
        (5, "+ 2", True),
        (7, "| str", True),
        (7, "- 4", False),
    ],
    ids=["argument", "default", "result", "message", "decorator", "variable", "value"],
)
def test_annotations_texts_and_decorators_are_no_mutants(line, text, out):
    assert left_out(SOURCE)(line, SOURCE.splitlines()[line - 1].index(text)) is out


@pytest.mark.parametrize(
    ("operator", "tried"),
    [
        ("ReplaceBinaryOperator_Add_Sub", True),
        ("ReplaceBinaryOperator_Mul_RShift", False),
        ("ReplaceBinaryOperator_Add_BitAnd", False),
        ("ReplaceBinaryOperator_BitAnd_BitOr", True),
        ("ReplaceBinaryOperator_BitOr_Add", False),
        ("ReplaceComparisonOperator_Lt_LtE", True),
        ("ReplaceComparisonOperator_Lt_IsNot", False),
        ("ReplaceComparisonOperator_Is_IsNot", True),
        ("NumberReplacer", True),
        ("RemoveDecorator", False),
    ],
)
def test_a_change_that_fails_by_its_type_alone_is_no_mutant(operator, tried):
    assert worth_trying(operator) is tried


@pytest.mark.parametrize("area", AREAS, ids=lambda area: area.code)
def test_every_area_is_there_and_has_tests(area):
    assert (CHECKOUT / area.code).exists()
    assert covering(area, area.code, CHECKOUT)


def test_tests_named_after_the_changed_file_are_run_first():
    effects = AREAS[0]
    first = covering(effects, "phantom_dyn/effects/friction/joint_coupling.py", CHECKOUT)[0]
    assert first == "tests/phantom_dyn/effects/friction/test_joint_coupling.py"


def test_an_effect_is_covered_by_the_tests_of_its_folder_and_of_no_folder():
    effects = AREAS[0]
    found = covering(effects, "phantom_dyn/effects/friction/joint_coupling.py", CHECKOUT)
    assert {Path(file).parent.name for file in found} == {"friction", "effects"}
    everything = covering(effects, "phantom_dyn/effects/support/rows.py", CHECKOUT)
    assert {Path(file).parent.name for file in everything} > {"friction", "effects", "drive", "support"}
