"""The page of what changed. Oracles: made-up diagnoses that differ as stated, places by hand."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from identification.cli.main import main
from identification.diagnosis.result import Value
from identification.reporting.comparison import compare
from identification.reporting.comparison_page import comparison_page
from identification.reporting.stored.diagnosis_files import json_text


def with_size(diagnosis, value, std):
    """The diagnosis with another size of its first finding."""
    first = replace(diagnosis.findings[0], parameters={"torque": Value(value, std, "N m")})
    return replace(diagnosis, findings=(first, *diagnosis.findings[1:]))


class Balanced(HTMLParser):
    """Notes elements that are not closed where they were opened."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.wrong: list[str] = []

    def handle_starttag(self, tag, attrs):
        if tag != "meta":
            self.open.append(tag)

    def handle_endtag(self, tag):
        if self.open.pop() != tag:
            self.wrong.append(tag)


@pytest.fixture
def grown(made_up):
    """Page of two diagnoses whose friction doubled."""
    pair = [with_size(made_up(findings=1), 1.0, 0.06), with_size(made_up(findings=1), 2.0, 0.06)]
    return comparison_page(compare(pair, ["<before>", "after"]))


def test_the_table_says_what_changed_with_intervals(grown):
    row = re.search(r"<tr><td>Coulomb friction on joint j1, torque</td>(.*?)</tr>", grown)
    assert row is not None
    # By hand: 1.96 * 0.06 = 0.118.
    cells = re.findall(r"<td>(.*?)</td>", row[1])
    assert cells == ["1.00 (0.88 to 1.12) N m", "2.00 (1.88 to 2.12) N m", "changed"]


def test_a_size_has_a_figure_with_its_unit_and_the_names_of_the_diagnoses(grown):
    assert "torque [N m]" in grown
    assert re.findall(r">(&lt;before&gt;|after)</text>", grown)[:2] == ["&lt;before&gt;", "after"]


def test_what_changed_is_orange_and_what_did_not_is_blue(made_up, grown):
    same = comparison_page(compare([made_up(findings=1)] * 2, ["a", "b"]))
    sizes = [re.search(r"<h2>Sizes</h2>(.*)<h2>", page, re.DOTALL) for page in (grown, same)]
    assert [("#d55e00" in part[0], "#0072b2" in part[0]) for part in sizes if part] == [(True, False), (False, True)]


def test_the_page_is_whole_and_runs_nothing(grown):
    parser = Balanced()
    parser.feed(grown)
    assert (parser.wrong, parser.open) == ([], [])
    assert not re.search(r"<script|https?://(?!www\.w3\.org)|<before>", grown)


def test_a_missing_finding_has_a_bar_up_to_what_would_have_been_seen(made_up):
    before = made_up(findings=1)
    bound = replace(
        before.bounds[0], effect="coulomb_friction", joint="j1", parameter="torque", unit="N m", below=0.123
    )
    page = comparison_page(compare([before, replace(made_up(findings=0), bounds=(bound,))], ["a", "b"]))
    assert "<p>b: not found (a torque of 0.123 N m would have shown)</p>" in page
    assert 'stroke="#808080"' in page


def test_a_list_of_sizes_has_a_curve_for_each_entry(made_up):
    orders = {"amplitude": Value([1.0, 2.0], [0.1, 0.1], "N m")}
    first = replace(made_up(findings=1).findings[0], effect="cogging", parameters=orders)
    page = comparison_page(compare([replace(made_up(findings=1), findings=(first,))] * 2, ["a", "b"]))
    sizes = re.search(r"<h2>Sizes</h2>(.*)<h2>", page, re.DOTALL)
    assert sizes is not None
    assert sizes[0].count("</title></g>") == 4


def test_the_command_writes_the_page(tmp_path, made_up, capsys):
    for name in ("a", "b"):
        (tmp_path / f"{name}.json").write_text(json_text(made_up()))
    out = tmp_path / "changes.html"
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "b.json"), "--out", str(out)]) == 0
    assert f"wrote {out}" in capsys.readouterr().out
    assert "<h1>What changed: a.json and b.json</h1>" in out.read_text()


def test_a_folder_is_no_place_for_the_page(tmp_path, made_up, capsys):
    (tmp_path / "a.json").write_text(json_text(made_up()))
    assert main(["compare", str(tmp_path / "a.json"), str(tmp_path / "a.json"), "--out", str(tmp_path)]) == 2
    assert "is a folder, wanted a file" in capsys.readouterr().err
