"""A figure of the scores of several tools: every share with its 95 % interval."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from .board import figures
from .figures import Cases
from .proportions import Proportion

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GOOD = ("cause leading", "cause listed", "joint right", "both causes of a pair", "unknown outside")
FAULTS = ("nulls accused", "cause too many", "no cause named", "fits but wrong", "confident and wrong")


class ChartError(Exception):
    """The figure cannot be drawn; the message is one sentence."""


def chart_of(methods: Mapping[str, Cases]) -> Figure:
    """The shares of several tools, those of which more is better on the left.

    Args:
        methods: The judged cases of each tool by its name.

    Raises:
        ChartError: If Matplotlib is missing.
    """
    try:
        from matplotlib.figure import Figure
        from matplotlib.lines import Line2D
    except ImportError as error:
        raise ChartError("A figure needs Matplotlib: pip install 'gapbench[chart]', or leave --chart out.") from error
    each = [figures(cases) for cases in methods.values()]
    out = Figure(figsize=(11.0, 0.16 * len(GOOD) * (len(each) + 1) + 1.2), layout="constrained")
    for axes, names, title in zip(
        out.subplots(1, 2), (GOOD, FAULTS), ("more is better", "less is better"), strict=True
    ):
        for place, name in enumerate(names):
            for k, scores in enumerate(each):
                score = scores[name]
                if not isinstance(score, Proportion) or not score.total:
                    continue
                height = place + 0.8 * ((k + 0.5) / len(each) - 0.5)
                axes.plot([100 * end for end in score.interval], [height, height], color=f"C{k}", linewidth=1.2)
                axes.plot([100 * score.value], [height], "o", color=f"C{k}", markersize=4)
        axes.set(yticks=range(len(names)), yticklabels=names, title=title)
        axes.set(xlim=(-2, 102), xlabel="% of cases, with 95 % interval", ylim=(len(names) - 0.5, -0.5))
        axes.grid(axis="x", alpha=0.3)
    marks = [Line2D([], [], color=f"C{k}", marker="o", markersize=4) for k in range(len(each))]
    out.legend(marks, list(methods), loc="outside lower center", ncols=min(len(each), 7), frameon=False)
    return out


def write_chart(methods: Mapping[str, Cases], path: Path) -> None:
    """Write `chart_of` to a file whose ending says the format.

    Raises:
        ChartError: If Matplotlib is missing or does not know the format.
    """
    try:
        chart_of(methods).savefig(path, dpi=110)
    except ValueError as error:
        raise ChartError(f"'{path.name}' ends in no format of figures: take .png, .svg or .pdf.") from error
