"""The figure of several tools. Oracle: shares of two tools, counted by hand."""

import sys

import pytest

from benchmarks.gapbench.scoring import chart
from benchmarks.gapbench.scoring.chart import FAULTS, GOOD, ChartError, chart_of, write_chart
from benchmarks.gapbench.scoring.proportions import Proportion, wilson


@pytest.fixture
def tools(monkeypatch):
    """One tool is right in one of four of everything, the other in three of four, and has no pairs."""
    scores = {
        tool: {name: Proportion(hits, 4) for name in (*GOOD, *FAULTS)} for tool, hits in (("one", 1), ("other", 3))
    }
    scores["other"]["both causes of a pair"] = Proportion(0, 0)
    monkeypatch.setattr(chart, "figures", lambda tool: scores[tool])
    return {"one": "one", "other": "other"}


def test_each_share_stands_at_its_place_with_its_interval(tools):
    good, faults = chart_of(tools).axes
    marks = [line.get_xdata() for line in good.lines if line.get_marker() == "o"]
    assert [float(x[0]) for x in marks] == [25.0, 75.0, 25.0, 75.0, 25.0, 75.0, 25.0, 25.0, 75.0]
    bars = [line.get_xdata() for line in faults.lines if line.get_marker() != "o"]
    assert bars[0] == pytest.approx([100 * end for end in wilson(1, 4)])
    assert [label.get_text() for label in faults.get_yticklabels()] == list(FAULTS)


def test_a_format_that_is_none_is_refused_in_a_sentence(tools, tmp_path):
    with pytest.raises(ChartError, match=r"'board\.doc' ends in no format of figures: take \.png, \.svg or \.pdf\."):
        write_chart(tools, tmp_path / "board.doc")


def test_a_figure_without_matplotlib_says_what_to_install(tools, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ChartError, match=r"gapbench\[chart\]"):
        chart_of(tools)
