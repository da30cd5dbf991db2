"""Text between two markers of a page; oracles are written by hand."""

import pytest

from benchmarks.markers import between_markers

BEGIN, END = "<!-- begin -->", "<!-- end -->"


def test_everything_between_the_markers_is_replaced_and_nothing_else():
    page = f"before\n{BEGIN}\nold\nrows\n{END}\nafter\n"
    assert between_markers(page, BEGIN, END, "new") == f"before\n{BEGIN}\nnew\n{END}\nafter\n"


def test_other_markers_of_the_page_stay():
    page = f"{BEGIN}\nold\n{END}\n<!-- numbers -->\n1\n<!-- end of numbers -->\n"
    assert between_markers(page, BEGIN, END, "new") == page.replace("old", "new")


def test_a_backslash_in_the_text_is_no_reference_to_a_group():
    assert between_markers(f"{BEGIN}{END}", BEGIN, END, r"\1") == f"{BEGIN}\n\\1\n{END}"


@pytest.mark.parametrize(
    "page", ["", f"{BEGIN} only", f"{END} and then {BEGIN}", f"{BEGIN}{END}{BEGIN}{END}", f"{BEGIN}{BEGIN}{END}"]
)
def test_a_page_without_its_two_markers_is_refused(page):
    with pytest.raises(ValueError, match="each once: put them where the table goes"):
        between_markers(page, BEGIN, END, "new")
