"""Figures of matplotlib as SVG elements of a page, text and axes in its colour; curves and legends that they share."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from identification.reporting.charts.thinning import gap_starts, thinned
from phantom_dyn.array_types import Array

INK = "#010203"  # stands for the colour of the page's text until the SVG is written
STYLE = {
    "svg.fonttype": "none",
    "font.size": 10.5,
    "text.parse_math": False,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.formatter.useoffset": False,
    "legend.frameon": False,
    "path.simplify_threshold": 0.2,
}


def drawn_svg(draw: Callable[[Figure], None], key: str, size: tuple[float, float], title: str) -> str:
    """What ``draw`` puts on a figure, as an SVG element.

    Args:
        draw: Fills the figure.
        key: Marks the ids of this figure, so that no two figures share one.
        size: Width and height [inch].
        title: What the figure shows, for readers who cannot see it.
    """
    style: dict[Any, Any] = {**STYLE, "svg.hashsalt": key}  # matplotlib's own type lists every key there is
    with matplotlib.rc_context(style):
        figure = Figure(figsize=size, layout="constrained")
        canvas = FigureCanvasSVG(figure)
        draw(figure)
        buffer = io.StringIO()
        # Saving draws everything once more, for the layout alone: laid out first, it need not.
        engine = figure.get_layout_engine()
        if engine is not None:
            engine.execute(figure)
            figure.set_layout_engine("none")
        for patch in (figure.patch, *(axes.patch for axes in figure.axes)):
            patch.set(facecolor="none", edgecolor="none")
        canvas.print_svg(buffer, metadata=dict.fromkeys(("Creator", "Date", "Format", "Type")))
    return inline_svg(buffer.getvalue(), key, title)


def inline_svg(svg: str, key: str, title: str) -> str:
    """The SVG element alone, ready to stand in a page beside others.

    Args:
        svg: A whole file as matplotlib writes it.
        key: Marks the ids of this figure, so that no two figures share one.
        title: What the figure shows, for readers who cannot see it.

    Returns:
        The element with the page's font and colour, coordinates to a tenth of a point, and no unused id.
    """
    svg = re.sub(r"<!--.*?-->", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    used = set(re.findall(r'(?:href="|url\()#([^")]+)', svg))
    # Only tags are rewritten: a joint's name in a text element stays as it is.
    svg = re.sub(r"<[^>]*>", lambda tag: _tag(tag[0], key, used), svg)
    return re.sub(r"<svg ", f'<svg role="img" aria-label="{_attribute(title)}" ', svg, count=1)


def _tag(tag: str, key: str, used: set[str]) -> str:
    tag = re.sub(r' id="([^"]*)"', lambda m: f' id="{key}-{m[1]}"' if m[1] in used else "", tag)
    tag = re.sub(r'(href="|url\()#', rf"\1#{key}-", tag)
    tag = re.sub(r' (?:d|x|y)="[^"]*"', lambda m: re.sub(r"-?\d+\.\d+", _tenth, m[0]).replace(" \n", " "), tag)
    tag = re.sub(r"(font: [^;\"]*?[\d.]+px )[^;\"]*", r"\1system-ui, sans-serif", tag)
    return tag.replace(INK, "currentColor")


def _tenth(number: re.Match[str]) -> str:
    return f"{float(number[0]):.1f}".removesuffix(".0")


def _attribute(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")


def draw_curve(axes: Axes, t: Array, y: Array, colour: str, label: str, width: float, alpha: float = 1.0) -> None:
    """Draw a thinned curve over time; between recordings the line is interrupted."""
    chosen = thinned(y)
    x, y = t[chosen], np.array(y[chosen], dtype=float)
    starts = gap_starts(x)
    axes.plot(np.insert(x, starts, np.nan), np.insert(y, starts, np.nan), color=colour, linewidth=width, label=label,
              alpha=alpha)  # fmt: skip


def draw_legend(figure: Figure, axes: Axes) -> None:
    """Draw the legend of some axes above the figure."""
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=3, borderaxespad=0.1)
