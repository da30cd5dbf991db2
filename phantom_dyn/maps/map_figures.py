"""Draws maps as figures: curves, sections with lines of equal value, and sections in space; NaN stays white.

Scalars and vectors are shown with all components, and symmetric matrices with their diagonal. Of a matrix whose columns
are joints, the norms of the rows are shown, which are the effect of all joints together along x, y and z.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, LogNorm, Normalize
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator
from mpl_toolkits.mplot3d import Axes3D

from phantom_dyn.array_types import Array
from phantom_dyn.maps.operational_map import OperationalMap, axis_unit
from phantom_dyn.maps.quantities import QUANTITIES

# Largest number of lines of equal value.
_LEVELS = 12
# Largest number of points along one axis of a surface in space.
_MOST_POINTS = 45
_COLORS = "viridis"
_DPI = 200
# A panel is left out if its largest value, over that of the figure, is below this: it shows only rounding errors.
_ROUNDING = 1e-9
# Levels are logarithmic if the ratio of largest to smallest value is above the first number; the second number is the
# ratio of largest to smallest level.
_DECADE, _DECADES = 10.0, 1e4
# Largest share of the points with the same colour; if there are more, the range of this colour is divided.
_ONE_COLOUR = 1 / 3
# Width of the rim, as a share of a section. No extreme value is marked in the rim, which is near the ends of the
# section and near points out of reach.
_RIM = 0.02
# Relative difference up to which two values count as equal.
_SAME = 1e-9
# Largest number of equal extreme values that are marked.
_MARKS = 6
# Smallest distance of two numbers on lines, and smallest extent of a line with a number, over the size of the axes.
_LABEL_ROOM = 0.12
# Smallest distances of a number from other lines and from the ends of the axes, over the size of the axes.
_CLEAR, _INSIDE = 0.025, 0.04
_NO_BREAK = "\u00a0"
# Number of letters of a caption per inch of the figure.
_LETTERS = 17


@dataclass(frozen=True)
class _Panel:
    """One diagram of a figure."""

    title: str
    values: Array  # over the axes that vary


def figure(result: OperationalMap, name: str) -> Figure:
    """One quantity of a map as a figure.

    Args:
        result: The map.
        name: Name of a quantity in it.

    Returns:
        For one axis a curve; for two axes a section with lines of equal value; for three axes the three middle sections
        in space and the section in the middle of the first axis; for more axes the middle section of the last two.
    """
    axes, panels = _panels(result, name)
    space = 2 if len(axes) == 3 else 1
    size = (1.2 + 4.2 * len(panels), 0.9 + 3.6 * space)
    out = Figure(figsize=size, dpi=_DPI, layout="constrained")
    logarithmic = _logarithmic(name, panels)
    for column, panel in enumerate(panels):
        for row in range(space):
            place = (space, len(panels), row * len(panels) + column + 1)
            if space == 2 and row == 0:
                _draw_space(out, out.add_subplot(*place, projection="3d"), panel, axes, result, logarithmic)
            else:
                _draw(out, out.add_subplot(*place), panel, axes, result, logarithmic)
    lines = _caption(result, name, axes)
    # No line break between a name and its number.
    unbroken = (line.replace(" = ", f"{_NO_BREAK}={_NO_BREAK}") for line in lines)
    wrapped = (_even_lines(line, int(_LETTERS * size[0])).replace(_NO_BREAK, " ") for line in unbroken)
    out.suptitle("\n".join(wrapped), fontsize=8)
    return out


def _even_lines(text: str, most: int) -> str:
    """A text in as few lines of at most ``most`` letters as possible, with similar lengths."""
    lines = len(textwrap.wrap(text, most))
    width = next(width for width in range(1, most + 1) if len(textwrap.wrap(text, width)) <= lines)
    return textwrap.fill(text, width)


def _panels(result: OperationalMap, name: str) -> tuple[list[int], list[_Panel]]:
    """Axes that vary, at most three, and panels with values over them; other axes are cut in the middle."""
    grid, quantity = result.grid, QUANTITIES[name]
    varying = [k for k, count in enumerate(grid.shape) if count > 1]
    kept = varying if len(varying) <= 3 else varying[-2:]
    cut = tuple(slice(None) if k in kept else count // 2 for k, count in enumerate(grid.shape))
    values = np.asarray(result.values[name][cut])
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    if quantity.kind == "scalar":
        return kept, [_Panel(f"{quantity.title}{unit}", values)]
    if quantity.kind == "vector":
        panels = [_Panel(f"{quantity.title}, {axis}{unit}", values[..., k]) for k, axis in enumerate("xyz")]
        return kept, _beyond_rounding(panels)
    if quantity.columns == "joints":
        along = np.linalg.norm(values, axis=-1)
        panels = [_Panel(f"{quantity.title}, along {axis}{unit}", along[..., k]) for k, axis in enumerate("xyz")]
    else:
        panels = [_Panel(f"{quantity.title}, {axis * 2}{unit}", values[..., k, k]) for k, axis in enumerate("xyz")]
    return kept, _beyond_rounding(panels)


def _beyond_rounding(panels: list[_Panel]) -> list[_Panel]:
    """Panels without those that show only rounding errors; the first panel if all do."""
    sizes = [float(np.nanmax(np.abs(panel.values))) if np.isfinite(panel.values).any() else 0.0 for panel in panels]
    kept = [panel for panel, size in zip(panels, sizes, strict=True) if size > _ROUNDING * max(sizes)]
    return kept or panels[:1]


def _label(result: OperationalMap, axis: int) -> str:
    name = result.grid.names[axis]
    return f"{name} [{axis_unit(name, result.grid, result.model)}]"


def _logarithmic(name: str, panels: list[_Panel]) -> bool:
    """True if levels are logarithmic: no value is negative, and those of one panel span more than a decade."""
    if QUANTITIES[name].share:
        return False
    finite = [panel.values[np.isfinite(panel.values)] for panel in panels]
    finite = [values for values in finite if values.any()]
    wide = [values.max() > _DECADE * values.min() for values in finite]
    return bool(finite) and all(values.min() >= 0.0 for values in finite) and any(wide)


def _scale(values: Array, logarithmic: bool) -> Normalize:
    """Range of the colours."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return Normalize(0, 1)
    if logarithmic:
        return LogNorm(max(finite.min(), finite.max() / _DECADES), finite.max())
    # Near a singularity masses grow without bound; without limits these values would take nearly all colours. The
    # limits are those of outliers in a box plot: three interquartile ranges beyond the quartiles.
    quarter, three = np.percentile(finite, [25, 75])
    beyond = 3 * (three - quarter)
    low, high = max(finite.min(), quarter - beyond), min(finite.max(), three + beyond)
    if high - low <= 1e-9 * max(abs(low), abs(high), 1e-9):
        width = max(abs(low), 1e-3)
        return Normalize(low - width / 2, low + width / 2)
    return Normalize(low, high)


def _draw(out: Figure, ax: Axes, panel: _Panel, axes: list[int], result: OperationalMap, logarithmic: bool) -> None:
    """Draw a panel as a number, a curve or a section."""
    grid = result.grid
    ax.set_title(panel.title, fontsize=9)
    if not axes:
        ax.axis("off")
        ax.text(0.5, 0.5, f"{float(panel.values):.6g}", ha="center", va="center", fontsize=14)
        return
    if len(axes) == 1:
        ax.plot(grid.values[axes[0]], panel.values)
        ax.set_xlabel(_label(result, axes[0]))
        ax.grid(alpha=0.3)
        return
    # The first axis is vertical if it is y, because y is the height of the built-in robots.
    first, second = axes[-2:]
    values = panel.values if panel.values.ndim == 2 else panel.values[panel.values.shape[0] // 2]
    across, up = (second, first) if grid.names[first] == "y" else (first, second)
    values = values if up == first else values.T
    empty = ""
    if min(values.shape) < 2 or not np.isfinite(values).any():
        empty = "no point can be reached" if result.unreachable else "singular at every point"
    if empty or not np.nan_to_num(values).any():
        ax.text(0.5, 0.5, empty or "zero wherever a point can be reached", ha="center", transform=ax.transAxes)
        ax.set_xticks([])
        ax.set_yticks([])
        return
    levels = _levels(_scale(values, logarithmic), values)
    extend = _extend(bool(np.nanmin(values) < levels[0]), bool(np.nanmax(values) > levels[-1]))
    shown = ax.contourf(
        grid.values[across],
        grid.values[up],
        values,
        levels,
        cmap=_COLORS,
        # Each area between two lines has its own colour, even if its values are close to those of the next area.
        norm=BoundaryNorm(levels, 256, extend=extend),
        extend=extend,
    )
    if ((levels > np.nanmin(values)) & (levels < np.nanmax(values))).any():
        lines = ax.contour(grid.values[across], grid.values[up], values, levels, colors="k", linewidths=0.4)
        _number(ax, lines)
    out.colorbar(shown, ax=ax, shrink=0.9, format="%g", ticks=levels, spacing="uniform")
    _mark(ax, grid.values[across], grid.values[up], values)
    ax.set_xlabel(_label(result, across))
    ax.set_ylabel(_label(result, up))
    if grid.cartesian:
        ax.set_aspect("equal")


def _extend(below: bool, above: bool) -> Literal["neither", "min", "max", "both"]:
    """Matplotlib's word for values below or above the levels."""
    if below and above:
        return "both"
    return "min" if below else "max" if above else "neither"


def _levels(scale: Normalize, values: Array) -> Array:
    """Values at which lines are drawn: round numbers that cover the range, and more between levels with many points."""
    low, high = float(scale.vmin or 0.0), float(scale.vmax or 0.0)
    if isinstance(scale, LogNorm):
        ticks = np.asarray(LogLocator(subs=(1.0, 2.0, 5.0), numticks=99).tick_values(low, high))
        levels = ticks[max(np.searchsorted(ticks, low, "right") - 1, 0) : np.searchsorted(ticks, high) + 1]
    else:
        levels = np.asarray(MaxNLocator(_LEVELS).tick_values(low, high))
    finite = values[np.isfinite(values)]
    edges = np.concatenate([[-np.inf], levels, [np.inf]])
    more = []
    for least, most in pairwise(edges):
        inside = finite[(finite >= least) & (finite < most)]
        parts = int(np.ceil(len(inside) / (_ONE_COLOUR * len(finite))))
        spread = float(np.ptp(inside)) if parts > 1 else 0.0
        if spread > 0.0:
            digits = 1 - int(np.floor(np.log10(spread)))
            more += np.round(np.quantile(inside, np.arange(1, parts) / parts), digits).tolist()
    return np.unique(np.concatenate([levels, more]))


def _number(ax: Axes, lines: QuadContourSet) -> None:
    """Write one number on each line that is long enough, without overlaps."""
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    size, middle = np.array([right - left, top - bottom]), np.array([right + left, top + bottom]) / 2
    points = [np.concatenate([np.zeros((0, 2)), *pieces]) for pieces in lines.allsegs]
    places: list[Array] = []
    levels = []
    for k, (level, pieces) in enumerate(zip(lines.levels, lines.allsegs, strict=True)):
        others = np.concatenate([np.zeros((0, 2)), *points[:k], *points[k + 1 :]])
        for piece in sorted(pieces, key=len, reverse=True)[:1]:
            if len(piece) < 2 or (np.ptp(piece, axis=0) / size).max() < _LABEL_ROOM:
                continue
            tried = [piece[round(part * (len(piece) - 1))] for part in (0.5, 0.35, 0.65, 0.2, 0.8)]
            free = [
                p
                for p in tried
                if all(np.abs((p - q) / size).max() > _LABEL_ROOM for q in places)
                and (np.linalg.norm((others - p) / size, axis=1) > _CLEAR).all()
                and np.abs((p - middle) / size).max() < 0.5 - _INSIDE
            ]
            if free:
                places.append(free[0])
                levels.append(level)
    for level, place in zip(levels, places, strict=True):
        lines.clabel([level], fontsize=6, fmt="%g", manual=[tuple(place)])


def _mark(ax: Axes, across: Array, up: Array, values: Array) -> None:
    """Mark the largest values, the smallest ones if some are negative, and the origin if the section contains it."""
    _mark_largest(ax, across, up, values, "largest", sign=1)
    if (values < 0.0).any():
        _mark_largest(ax, across, up, values, "smallest", sign=-1)
    if across[0] <= 0 <= across[-1] and up[0] <= 0 <= up[-1]:
        ax.plot(0.0, 0.0, "+", color="r", ms=9, mew=1.2, label="origin")
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize=6, loc="best", framealpha=0.8)


def _mark_largest(ax: Axes, across: Array, up: Array, values: Array, word: str, sign: Literal[1, -1]) -> None:
    """Mark the largest of ``sign * values`` outside of the rim; nothing if the values grow up to the rim everywhere."""
    signed = sign * values
    inner, around = _off_the_rim(signed)
    largest = float(np.nanmax(np.where(inner, signed, np.nan))) if inner.any() else math.nan
    least = largest - _SAME * abs(largest)
    rows, columns = np.nonzero(inner & (signed >= least) & (around <= largest + _SAME * abs(largest)))
    if not len(rows) or np.nanmin(signed) >= least:
        return
    place = "" if np.nanmax(signed) <= largest + _SAME * abs(largest) else " off the rim"
    kept = np.unique(np.linspace(0, len(rows) - 1, _MARKS).round().astype(int))
    label, marker = f"{word}{place}: {sign * largest:.4g}", "x" if sign > 0 else "1"
    ax.plot(across[columns[kept]], up[rows[kept]], marker, color="w", mec="r", ms=7, mew=1.5, label=label)


def _off_the_rim(values: Array) -> tuple[Array, Array]:
    """Mask of the points outside of the rim, and the largest value around each point, within the width of the rim."""
    margin = max(1, round(_RIM * max(values.shape)))
    padded = np.pad(np.where(np.isfinite(values), values, -np.inf), margin, constant_values=-np.inf)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (2 * margin + 1, 2 * margin + 1))
    return np.isfinite(windows.min(axis=(2, 3))), windows.max(axis=(2, 3))


def _draw_space(
    out: Figure, ax: Axes3D, panel: _Panel, axes: list[int], result: OperationalMap, logarithmic: bool
) -> None:
    """Draw the three middle sections at right angles."""
    values, scale = panel.values, _scale(panel.values, logarithmic)
    coloured = ScalarMappable(scale, _COLORS)
    along = [_thinned(result.grid.values[k]) for k in axes]
    for normal in range(3):
        middle = values.shape[normal] // 2
        others = [k for k in range(3) if k != normal]
        surface = np.meshgrid(*(along[k][1] for k in others), indexing="ij")
        place: list[Array] = [np.zeros(0)] * 3
        place[normal] = np.full(surface[0].shape, result.grid.values[axes[normal]][middle])
        place[others[0]], place[others[1]] = surface
        cut = np.take(values, middle, axis=normal)[np.ix_(along[others[0]][0], along[others[1]][0])]
        color = coloured.to_rgba(cut)
        color[..., 3] = np.where(np.isfinite(cut), 0.9, 0.0)
        ax.plot_surface(*place, facecolors=color, rstride=1, cstride=1, shade=False, linewidth=0)
    ax.set_title(f"{panel.title}\nmiddle sections", fontsize=9)
    for k, label in zip(axes, (ax.set_xlabel, ax.set_ylabel, ax.set_zlabel), strict=True):
        label(_label(result, k), fontsize=7)
    ax.tick_params(labelsize=6)
    ax.set_box_aspect(None, zoom=0.85)  # pyright: ignore[reportArgumentType]  # room for the upright label
    out.colorbar(coloured, ax=ax, shrink=0.6)


def _thinned(values: Array) -> tuple[Array, Array]:
    """Indices and values of at most `_MOST_POINTS`, because a surface in space is drawn face by face."""
    index = np.unique(np.linspace(0, len(values) - 1, min(_MOST_POINTS, len(values))).round().astype(int))
    return index, values[index]


def _caption(result: OperationalMap, name: str, axes: Sequence[int]) -> list[str]:
    """Lines of the caption: robot, section, blank points, chosen branch."""
    model, grid = result.model, result.grid
    fixed = [
        f"{axis} = {values[len(values) // 2]:.4g}"
        for k, (axis, values) in enumerate(zip(grid.names, grid.values, strict=True))
        if k not in axes or (len(axes) == 3 and k == axes[0])
    ]
    section = f", section at {', '.join(fixed)}" if fixed else ""
    lines = [f"{model.name}, frame {model.frame}{section}; root frame"]
    counts = (
        (result.unreachable, "out of reach"),
        (result.singular, "singular, where the tip cannot move in some direction"),
    )
    if any(count for count, _ in counts):
        blank = ", ".join(f"{count} {words}" for count, words in counts if count)
        lines.append(f"blank: {blank}, of {grid.size} points")
    if grid.cartesian:
        near = ", ".join(f"{joint} = {q:.3g}" for joint, q in zip(model.joint_names, model.posture, strict=True))
        lines.append(f"of several postures that reach a point the one nearest to {near}")
    if name == "stiffness":
        lines.append(model.stiffness_note)
    return lines
