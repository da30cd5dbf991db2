"""Draws the charts of reports directly as SVG: panels above each other with one horizontal axis.

A report has dozens of charts, for which matplotlib would take too long. Text and axes have the text colour of the page.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from html import escape
from itertools import accumulate

import numpy as np

from identification.reporting.charts.chart_marks import (
    FONT,
    INK,
    LEFT,
    SMALL,
    TICK,
    Cloud,
    Curve,
    Frame,
    Range,
    Ribbon,
    axes,
    cloud_svg,
    curve_svg,
    legend_svg,
    line,
    ribbon_svg,
    text,
)
from identification.reporting.charts.thinning import gap_starts, thinned
from phantom_dyn.array_types import Array

BEFORE, AFTER = "#d55e00", "#0072b2"  # orange and blue of Okabe and Ito, distinct for every kind of colour vision
SECTION_S = 10.0  # length of the section of a recording that is drawn over time [s]

_POINTS = 72.0  # points per inch
_RIGHT, _BOTTOM, _TOP = 9.0, 38.0, 21.0  # space around the panels [pt]
_LEGEND, _BETWEEN = 19.0, 32.0  # space for a legend and between panels [pt]
_PADDING = 0.05  # space beyond the data, as a share of their range


@dataclass(frozen=True)
class Panel:
    """Axes with their contents.

    Attributes:
        label: Label of the vertical axis, with its unit.
        curves: Curves, drawn over everything else.
        cloud: Points, drawn behind the curves.
        title: Title above the panel.
        band: Half the height of a grey band about zero, in values of the vertical axis; no band if zero or not finite.
        rule: Value of the vertical axis at which a dashed horizontal line is drawn; None for no line.
        zero: True draws a thin line at zero.
        least: Values that the vertical range must include.
        height: Height relative to the other panels.
        ribbons: Areas, drawn behind everything but the band.
    """

    label: str
    curves: tuple[Curve, ...]
    cloud: Cloud | None = None
    title: str = ""
    band: float = 0.0
    rule: float | None = None
    zero: bool = False
    least: tuple[float, ...] = ()
    height: float = 1.0
    ribbons: tuple[Ribbon, ...] = ()


def chart(
    panels: tuple[Panel, ...],
    x_label: str,
    size: tuple[float, float],
    title: str,
    *,
    same_scale: bool = False,
    x_names: tuple[str, ...] = (),
    logarithmic: bool = False,
) -> str:
    """Draws panels above each other with one horizontal axis, as an SVG element.

    Args:
        panels: Panels, from the top.
        x_label: Label of the horizontal axis, with its unit.
        size: Width and height [inch].
        title: What the chart shows, for readers who cannot see it.
        same_scale: True gives all panels the same vertical range.
        x_names: Names in place of numbers, at 0, 1, 2 and so on of the horizontal axis.
        logarithmic: True makes both axes logarithmic; panels must then contain only curves.
    """
    if logarithmic:
        panels = tuple(_with_logarithms(panel) for panel in panels)
    width, height = (_POINTS * side for side in size)
    legend = [curve for curve in panels[0].curves if curve.label]
    top = _TOP if any(panel.title for panel in panels) else _LEGEND if legend else TICK + SMALL
    between = _BETWEEN if any(panel.title for panel in panels[1:]) else TICK + SMALL
    free_height = height - _BOTTOM - top - between * (len(panels) - 1)
    heights = [free_height * panel.height / sum(other.height for other in panels) for panel in panels]
    starts = accumulate((panel_height + between for panel_height in heights), initial=top)
    x_range = _padded(_range([x for panel in panels for x, _ in _drawn(panel)]))
    if x_names:
        x_range = (-0.5, len(x_names) - 0.5)
    y_ranges = [_padded(_range([y for _, y in _drawn(panel)], _required_values(panel))) for panel in panels]
    if same_scale:
        y_ranges = [(min(low for low, _ in y_ranges), max(high for _, high in y_ranges))] * len(panels)
    out = [legend_svg(legend)]
    for k, (panel, start, panel_height, y_range) in enumerate(zip(panels, starts, heights, y_ranges, strict=False)):
        frame = Frame(x_range, y_range, (LEFT, width - _RIGHT), (start + panel_height, start))
        last = k == len(panels) - 1
        out.append(_panel(panel, frame, x_label if last else "", x_names, logarithmic))
    return (
        f'<svg role="img" aria-label="{escape(title)}" xmlns="http://www.w3.org/2000/svg" width="{width:.4g}pt" '
        f'height="{height:.4g}pt" viewBox="0 0 {width:.4g} {height:.4g}" fill="{INK}" '
        f'font-family="system-ui, sans-serif" font-size="{FONT}">{"".join(out)}</svg>'
    )


def short_name(name: str, length: int = 18) -> str:
    """A name of at most ``length`` letters; the middle of a longer name is left out."""
    if len(name) <= length:
        return name
    kept = length - 1
    return f"{name[: kept - kept // 2]}…{name[-(kept // 2) :]}"


def _drawn(panel: Panel) -> list[tuple[Array, Array]]:
    """Abscissas and ordinates of everything in a panel: points of curves with their bars, ribbons and the cloud."""
    points = [(curve.x, curve.y) for curve in panel.curves]
    bars = [(curve, curve.half) for curve in panel.curves if curve.half is not None]
    points += [(curve.x, curve.y + side * half) for curve, half in bars for side in (1.0, -1.0)]
    points += [(ribbon.x, edge) for ribbon in panel.ribbons for edge in (ribbon.low, ribbon.high)]
    return points if panel.cloud is None else [*points, (panel.cloud.x, panel.cloud.y)]


def _required_values(panel: Panel) -> tuple[float, ...]:
    """Values that the vertical range must include."""
    level = () if panel.rule is None else (panel.rule,)
    band = (-panel.band, panel.band) if panel.band > 0.0 else ()
    return (*panel.least, *level, *band)


def _range(parts: list[Array], least: tuple[float, ...] = ()) -> Range:
    """Smallest and largest finite value of arrays and of ``least``."""
    finite = [part[np.isfinite(part)] for part in (*parts, np.array(least))]
    values = np.concatenate(finite)
    return (float(values.min()), float(values.max())) if len(values) else (0.0, 0.0)


def _padded(limits: Range) -> Range:
    """A range with some space at both ends; an empty range is widened."""
    low, high = limits
    width = high - low
    if width <= 1e-12 * max(abs(low), abs(high)) or width == 0.0:
        width = max(abs(low), abs(high)) or 1.0
    return low - _PADDING * width, high + _PADDING * width


def _with_logarithms(panel: Panel) -> Panel:
    """The panel with decimal logarithms of its curves."""
    curves = tuple(replace(curve, x=np.log10(curve.x), y=np.log10(curve.y)) for curve in panel.curves)
    return replace(panel, curves=curves)


def curve_over_time(t: Array, y: Array, colour: str, width: float, label: str = "", opacity: float = 1.0) -> Curve:
    """A thinned curve over time, interrupted between recordings, at gaps within recordings and at missing values."""
    # Gaps must be found before thinning, which makes time steps uneven.
    begins = np.zeros(len(t), dtype=bool)
    begins[gap_starts(t)] = True
    # Values that are not finite interrupt a curve too.
    begins[1:] |= np.isfinite(y[1:]) & ~np.isfinite(y[:-1])
    y = np.asarray(y, dtype=float)
    kept = np.flatnonzero(np.isfinite(y))
    chosen = kept[thinned(y[kept])]
    piece = np.cumsum(begins)[chosen]
    x, y = t[chosen], y[chosen]
    starts = np.flatnonzero(np.diff(piece)) + 1
    return Curve(np.insert(x, starts, np.nan), np.insert(y, starts, np.nan), colour, width, label, opacity)


def _panel(panel: Panel, frame: Frame, x_label: str, x_names: tuple[str, ...], logarithmic: bool) -> str:
    """One panel as SVG, from the background to the foreground."""
    (left, right), (bottom, top) = frame.across, frame.upwards
    out = []
    if np.isfinite(panel.band) and panel.band > 0.0:
        high, low = np.clip(frame.y(np.array([panel.band, -panel.band])), top, bottom)
        out.append(f'<path d="M{left:.1f} {high:.1f}H{right:.1f}V{low:.1f}H{left:.1f}z" fill="#808080" opacity=".22"/>')
    out += [ribbon_svg(ribbon, frame) for ribbon in panel.ribbons]
    if panel.cloud is not None:
        out.append(cloud_svg(panel.cloud, frame))
    if panel.zero and frame.y_range[0] < 0.0 < frame.y_range[1]:
        out.append(line(f"M{left:.1f} {float(frame.y(np.zeros(1))[0]):.1f}H{right:.1f}", INK, 0.5, ' opacity=".6"'))
    if panel.rule is not None:
        level = float(frame.y(np.array([panel.rule]))[0])
        out.append(line(f"M{left:.1f} {level:.1f}H{right:.1f}", INK, 0.8, ' stroke-dasharray="4 2"'))
    out += [curve_svg(curve, frame) for curve in panel.curves]
    out.append(axes(frame, numbered=bool(x_label), names=x_names, logarithmic=logarithmic))
    middle = 0.5 * (top + bottom)
    out.append(
        f'<text transform="translate(12 {middle:.1f}) rotate(-90)" text-anchor="middle">{escape(panel.label)}</text>'
    )
    if panel.title:
        out.append(text(left, top - 7, panel.title))
    if x_label:
        out.append(text(0.5 * (left + right), bottom + 32, x_label, "middle"))
    return "".join(out)
