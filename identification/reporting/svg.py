"""Figures of matplotlib as SVG elements of a page, text and axes in its colour; curves and legends that they share."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from identification.reporting.thinning import gap_starts, thinned

Array = np.ndarray

BEFORE, AFTER = "#d55e00", "#0072b2"  # orange and blue of Okabe and Ito: apart for every kind of colour vision
STRETCH_S = 10.0  # length of the stretch of a recording that is drawn over time [s]
INK = "#010203"  # stands for the colour of the page's text until the SVG is written
_AT_EDGE = 0.17  # from the edge of a figure to the middle of a label [inch]
_DPI = 90  # of clouds of samples, which are pictures
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


@dataclass(frozen=True)
class Margins:
    """Room around the axes of a figure [inch], where it is known: to measure every label takes long.

    Attributes:
        left: For labels and numbers of the vertical axes.
        top: For a title or a legend.
        between: The same between two axes, one above the other.
    """

    left: float = 0.95
    right: float = 0.12
    bottom: float = 0.55
    top: float = 0.3
    between: float = 0.45

    def apply(self, figure: Figure) -> None:
        """Place the axes of a figure, in one column, and the labels of the vertical ones at its edge."""
        width, height = figure.get_size_inches()
        for axes in figure.axes:
            axes.yaxis.set_label_coords(-(self.left - _AT_EDGE) / (width - self.left - self.right), 0.5)
        rows = max(len(figure.axes), 1)
        each = (height - self.bottom - self.top - (rows - 1) * self.between) / rows
        figure.subplots_adjust(
            left=self.left / width,
            right=1.0 - self.right / width,
            bottom=self.bottom / height,
            top=1.0 - self.top / height,
            hspace=self.between / each,
        )


def drawn_svg(
    draw: Callable[[Figure], None],
    key: str,
    size: tuple[float, float],
    title: str,
    margins: Margins | None = None,
) -> str:
    """What ``draw`` puts on a figure, as an SVG element.

    Args:
        draw: Fills the figure.
        key: Marks the ids of this figure, so that no two figures share one.
        size: Width and height [inch].
        title: What the figure shows, for readers who cannot see it.
        margins: Of axes in one column; None: as wide as the labels need, which are measured.
    """
    style: dict[Any, Any] = {**STYLE, "svg.hashsalt": key}  # matplotlib's own type lists every key there is
    with matplotlib.rc_context(style):
        figure = Figure(figsize=size, layout="constrained" if margins is None else None, dpi=_DPI)
        canvas = FigureCanvasSVG(figure)
        draw(figure)
        if margins is not None:
            margins.apply(figure)
        buffer = io.StringIO()
        # Saving draws everything once more, for the layout alone: laid out first, it need not.
        engine = figure.get_layout_engine()
        if engine is not None:
            engine.execute(figure)
            figure.set_layout_engine("none")
            figure.set_dpi(_DPI)  # measuring text has set another
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


def short_name(name: str, length: int = 18) -> str:
    """A name for an axis: long ones lose their middle."""
    if len(name) <= length:
        return name
    kept = length - 1
    return f"{name[: kept - kept // 2]}…{name[-(kept // 2) :]}"
