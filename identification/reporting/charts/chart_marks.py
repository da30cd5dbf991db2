"""Draws the elements of a chart as SVG: curves, intervals, clouds of points, axes and legends."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np

from phantom_dyn.array_types import Array, Bool, Float

INK = "currentColor"
FONT, SMALL, TICK, LEFT = 10.5, 9.5, 3.5, 64.0
"""Sizes of usual and of small text, length of a tick, and space to the left of the panels [pt]."""

_DOT = 5.0  # diameter of a mark [pt]
_SPACING_X, _SPACING_Y = 62.0, 26.0  # smallest distance between two ticks [pt]
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
Range = tuple[float, float]


@dataclass(frozen=True)
class Curve:
    """A line through points; values that are not finite interrupt it.

    Attributes:
        x: Abscissa, ``(n,)``.
        y: Ordinate, ``(n,)``.
        colour: Colour of the line.
        width: Width of the line [pt].
        label: Text in the legend; empty for none.
        opacity: Opacity of the line.
        dashes: Lengths of dashes and gaps [pt]; empty for a solid line.
        marked: True marks each point.
        half: Half width of an interval about each point, drawn as a bar, ``(n,)``; None for no bars.
        tips: Tooltip of each mark; empty for none.
    """

    x: Float[Array, " n"]
    y: Float[Array, " n"]
    colour: str
    width: float
    label: str = ""
    opacity: float = 1.0
    dashes: str = ""
    marked: bool = False
    half: Float[Array, " n"] | None = None
    tips: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cloud:
    """Points without a line, with abscissa, ordinate, colour and diameter [pt]."""

    x: Float[Array, " n"]
    y: Float[Array, " n"]
    colour: str
    diameter: float


@dataclass(frozen=True)
class Ribbon:
    """Area between two lines, with abscissa, lower and upper ordinate, and colour."""

    x: Float[Array, " n"]
    low: Float[Array, " n"]
    high: Float[Array, " n"]
    colour: str


@dataclass(frozen=True)
class Frame:
    """Position of a panel on the page, and the ranges of its axes.

    Attributes:
        x_range: Values at the left and the right end of the horizontal axis.
        y_range: Values at the lower and the upper end of the vertical axis.
        across: Left and right edge, from the left edge of the page [pt].
        upwards: Lower and upper edge, from the top edge of the page [pt].
    """

    x_range: Range
    y_range: Range
    across: Range
    upwards: Range

    def x(self, values: Float[Array, " n"]) -> Float[Array, " n"]:
        """Positions from the left edge of the page [pt]."""
        return _placed(values, self.x_range, self.across)

    def y(self, values: Float[Array, " n"]) -> Float[Array, " n"]:
        """Positions from the top edge of the page [pt]."""
        return _placed(values, self.y_range, self.upwards)


def _placed(values: Float[Array, " n"], axis: Range, edges: Range) -> Float[Array, " n"]:
    """Positions on the page [pt] of values on an axis that extends between two edges."""
    return edges[0] + (np.asarray(values, dtype=float) - axis[0]) * ((edges[1] - edges[0]) / (axis[1] - axis[0]))


def ribbon_svg(ribbon: Ribbon, frame: Frame) -> str:
    """Draws a ribbon in a pale colour."""
    x = np.concatenate([ribbon.x, ribbon.x[::-1]])
    y = np.concatenate([ribbon.low, ribbon.high[::-1]])
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(frame.x(x), frame.y(y), strict=True))
    return f'<polygon points="{points}" fill="{ribbon.colour}" opacity=".2"/>'


def ticks(low: float, high: float, most: int) -> Float[Array, " n"]:
    """At most about ``most`` round numbers within a range, in equal steps."""
    least_step = (high - low) / max(most, 1)
    power = 10.0 ** np.floor(np.log10(least_step))
    step = power * next(nice for nice in (1.0, 2.0, 2.5, 5.0, 10.0) if nice * power >= least_step * (1 - 1e-9))
    return step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)


def tick_words(values: Float[Array, " n"]) -> tuple[list[str], str]:
    """Labels of ticks, and their common factor such as ×10⁵; the factor is empty if it is 1."""
    largest = float(np.abs(values).max(initial=0.0))
    power = int(np.floor(np.log10(largest))) if largest > 0.0 else 0
    power = 0 if -4 < power < 5 else power
    scaled = values / 10.0**power
    step = float(np.diff(scaled).min()) if len(scaled) > 1 else 1.0
    # The fewest decimals with which the step is exact: 1 for 0.5, 2 for 0.25.
    decimals = next((n for n in range(12) if abs(round(step * 10**n) - step * 10**n) < 1e-6 * step * 10**n), 12)
    # Adding zero turns -0 into 0.
    words = [f"{value + 0.0:.{decimals}f}".replace("-", "\u2212") for value in np.round(scaled, decimals)]
    return words, f"×10{str(power).translate(_SUPERSCRIPT)}" if power else ""


def decade_ticks(low: float, high: float, most: int) -> tuple[Float[Array, " n"], list[str]]:
    """Ticks of a logarithmic axis and their labels: 1, 2 and 5 times powers of ten, or powers of ten alone.

    Args:
        low: Decimal logarithm of the lower end.
        high: Decimal logarithm of the upper end.
        most: Largest number of ticks.
    """
    powers = np.arange(np.ceil(low - 1e-9), np.floor(high + 1e-9) + 1)
    candidates = np.add.outer(np.arange(np.floor(low), np.ceil(high) + 1), np.log10([1.0, 2.0, 5.0])).ravel()
    candidates = candidates[(candidates >= low - 1e-9) & (candidates <= high + 1e-9)]
    chosen = candidates if len(candidates) <= most else powers[:: -(-len(powers) // max(most, 1))]
    return chosen, [f"{10.0**value:.3g}" for value in chosen]


def axes(frame: Frame, *, numbered: bool, names: tuple[str, ...] = (), logarithmic: bool = False) -> str:
    """Draws both axes of a panel, with ticks at round numbers.

    Args:
        frame: Position and ranges of the panel.
        numbered: False to leave out the labels of the horizontal axis.
        names: Labels of the horizontal axis at 0, 1, 2 and so on, instead of numbers.
        logarithmic: True if the ranges are decimal logarithms.
    """
    (left, right), (bottom, top) = frame.across, frame.upwards
    most_x, most_y = int((right - left) / _SPACING_X), max(2, int((bottom - top) / _SPACING_Y))
    if logarithmic:
        (x, x_words), (y, y_words) = decade_ticks(*frame.x_range, most_x), decade_ticks(*frame.y_range, most_y)
        x_power = y_power = ""
    else:
        x, y = ticks(*frame.x_range, most_x), ticks(*frame.y_range, most_y)
        (x_words, x_power), (y_words, y_power) = tick_words(x), tick_words(y)
    if names:
        x, x_words = _named_places(names, right - left)
        x_power = ""
    at_x, at_y = frame.x(x), frame.y(y)
    lines = [f"M{left:.1f} {top:.1f}V{bottom:.1f}H{right:.1f}"]
    lines += [f"M{place:.1f} {bottom:.1f}v{TICK}" for place in at_x] + [
        f"M{left:.1f} {place:.1f}h-{TICK}" for place in at_y
    ]
    out = [line("".join(lines), INK, 0.7)]
    out += [
        text(left - TICK - 3, place + 0.35 * SMALL, words, "end", SMALL)
        for place, words in zip(at_y, y_words, strict=True)
    ]
    if numbered:
        out += [
            text(place, bottom + TICK + 1.15 * SMALL, words, "middle", SMALL)
            for place, words in zip(at_x, x_words, strict=True)
        ]
        out.append(text(right, bottom + 32, x_power, "end", SMALL) if x_power else "")
    out.append(text(left - TICK - 3, top - 4, y_power, "end", SMALL) if y_power else "")
    return "".join(out)


def _named_places(names: tuple[str, ...], width: float) -> tuple[Float[Array, " n"], list[str]]:
    """Positions on the axis and names: every name if all fit on the axis, otherwise every n-th."""
    name_width = 0.55 * SMALL * max(map(len, names)) + 8.0
    step = max(1, int(np.ceil(len(names) * name_width / width)))
    return np.arange(0.0, len(names), step), list(names[::step])


def curve_svg(curve: Curve, frame: Frame) -> str:
    """Draws a curve as one path, followed by its intervals and marks."""
    x, y = frame.x(curve.x), frame.y(curve.y)
    finite = np.isfinite(x) & np.isfinite(y)
    begins = finite & ~np.concatenate([[False], finite[:-1]])
    parts = [
        f"{'M' if first else 'L'}{a:.1f} {b:.1f}"
        for a, b, first, there in zip(x.tolist(), y.tolist(), begins.tolist(), finite.tolist(), strict=True)
        if there
    ]
    more = f' stroke-dasharray="{curve.dashes}"' if curve.dashes else ""
    more += f' opacity="{curve.opacity:g}"' if curve.opacity < 1.0 else ""
    out = line("".join(parts), curve.colour, curve.width, more + ' stroke-linejoin="round"')
    if curve.half is not None:
        ends = [frame.y(curve.y + side * curve.half)[finite].tolist() for side in (1.0, -1.0)]
        bars = "".join(f"M{a:.1f} {b:.1f}V{c:.1f}" for a, b, c in zip(x[finite].tolist(), *ends, strict=True))
        out += line(bars, curve.colour, 1.2, f' opacity="{curve.opacity:g}"' if curve.opacity < 1.0 else "")
    if curve.marked:
        out += _dots(curve, x, y, finite)
    return out


def _dots(curve: Curve, x: Float[Array, " n"], y: Float[Array, " n"], finite: Bool[Array, " n"]) -> str:
    """Draws the marks of a curve: one path for all points, or one path per point if the points have tooltips."""
    places = [f"M{a:.1f} {b:.1f}h0" for a, b in zip(x[finite].tolist(), y[finite].tolist(), strict=True)]
    more = ' stroke-linecap="round"'
    if not curve.tips:
        return line("".join(places), curve.colour, _DOT, more)
    tips = [tip for tip, there in zip(curve.tips, finite.tolist(), strict=True) if there]
    return "".join(
        f"<g>{line(place, curve.colour, _DOT, more)}<title>{escape(tip)}</title></g>"
        for place, tip in zip(places, tips, strict=True)
    )


def cloud_svg(cloud: Cloud, frame: Frame) -> str:
    """Draws a cloud as one path. Positions are rounded to 0.5 pt; points at the same position are drawn once."""
    places = np.column_stack([frame.x(cloud.x), frame.y(cloud.y)])
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return ""
    unique = np.unique(np.round(2.0 * places).astype(int), axis=0)
    steps = np.diff(unique, axis=0, prepend=0)
    path = "".join(f"m{dx} {dy}h0" for dx, dy in steps.tolist()).replace(" -", "-")
    return line(path, cloud.colour, 2.0 * cloud.diameter, ' transform="scale(.5)" stroke-linecap="round"')


def legend_svg(curves: list[Curve]) -> str:
    """Draws the legend in one row above the panels: a short line or a mark for each curve, and its label."""
    out, left = [], LEFT
    for curve in curves:
        more = f' opacity="{curve.opacity:g}"' + (f' stroke-dasharray="{curve.dashes}"' if curve.dashes else "")
        out.append(line(f"M{left:.1f} 9h18", curve.colour, curve.width or _DOT, more))
        out.append(text(left + 23, 12.5, curve.label))
        left += 45 + 0.55 * FONT * len(curve.label)
    return "".join(out)


def line(path: str, colour: str, width: float, more: str = "") -> str:
    """Draws a path as a line; ``more`` contains further SVG attributes."""
    return f'<path d="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"{more}/>'


def text(x: float, y: float, words: str, anchor: str = "start", size: float = FONT) -> str:
    """Writes words at a position on the page [pt]."""
    more = "" if anchor == "start" else f' text-anchor="{anchor}"'
    more += "" if size == FONT else f' font-size="{size:g}"'
    return f'<text x="{x:.1f}" y="{y:.1f}"{more}>{escape(words)}</text>'
