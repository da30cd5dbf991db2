"""Cells that a spreadsheet would compute. Oracle: Python's csv module reads back what was meant."""

from __future__ import annotations

import csv

import pytest

from identification.csv_cells import header_line, text_cell


@pytest.mark.parametrize("text", ["=1+2", "+1", "-cmd|' /C calc'!A0", "@SUM(A1)", "\t=1", "\r=1"])
def test_a_text_that_begins_as_a_formula_is_marked_as_text(text):
    assert text_cell(text) == f"'{text}"


@pytest.mark.parametrize("text", ["turn", "1 + 2", "", "a=b", None])
def test_any_other_text_stays_as_it_is(text):
    assert text_cell(text) == text


def test_names_with_commas_are_one_column_each():
    names = ["t", "q.a,b", 'q."c"', "tau.d"]
    assert next(csv.reader([header_line(names)])) == names
