"""Parts that all figures of haptics share: colours for colour-blind readers, panels, frequency axes, legends, units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phantom_dyn.array_types import Array

Place = Literal["best", "upper left", "upper right", "lower left", "lower right", "center left"]

# Colours of Okabe and Ito, and a wine red of Tol. Markers distinguish the curves for readers who see no colours.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
# Line styles have the same meaning in all figures; results are solid lines.
IDEAL = "--"
"""Line style of an approximation, an ideal, a plan or an asymptote."""
MARK = ":"
"""Line style that marks a level or an instant, such as a limit or a published value."""
GREY = "#666666"
PALE = "#56B4E940"
_TITLE, _WIDTH = 11, 8.5


def panels(
    rows: int,
    columns: int = 1,
    *,
    title: str,
    width: float = _WIDTH,
    height: float = 2.7,
    ratios: Sequence[float] | None = None,
    together: bool = False,
) -> tuple[Figure, list[list[Axes]]]:
    """An empty figure with a title and a grid of panels.

    Args:
        rows: Number of rows of panels.
        columns: Number of columns of panels.
        title: Title of the figure.
        width: Width of the figure [inch].
        height: Height of a row [inch].
        ratios: Relative heights of the rows.
        together: True if all panels of a column share their x axis.
    """
    out = Figure(figsize=(width, 0.8 + height * rows), dpi=110, layout="constrained")
    share = "col" if together else False
    axes = cast(Array, out.subplots(rows, columns, squeeze=False, sharex=share, height_ratios=ratios))
    for ax in axes.flat:
        ax.grid(alpha=0.3)
    out.suptitle(title, fontsize=_TITLE)
    return out, axes.tolist()


def frequency_axis(top: Axes, bottom: Axes) -> None:
    """Logarithmic frequency axis for panels above each other: rad/s below the last, Hz above the first."""
    for ax in (top, bottom):
        ax.set_xscale("log")
    bottom.set_xlabel("frequency [rad/s]")
    hertz = top.secondary_xaxis(
        "top", functions=(lambda w: np.divide(w, 2 * np.pi), lambda f: np.multiply(f, 2 * np.pi))
    )
    hertz.set_xlabel("frequency [Hz]", fontsize=8)
    hertz.tick_params(labelsize=8)


def shade(ax: Axes, x: Array, where: Array, label: str) -> None:
    """Add a pale background where a condition holds."""
    ax.fill_between(x, 0, 1, where=where.tolist(), transform=ax.get_xaxis_transform(), color=PALE, lw=0, label=label)


def key(ax: Axes, place: Place = "best", columns: int = 1) -> None:
    """Add a small legend to a panel."""
    ax.legend(loc=place, fontsize=8, ncols=columns, framealpha=0.85)


def beside(ax: Axes) -> None:
    """Add a small legend to the right of a panel, where it hides nothing."""
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)


def hertz(frequency: float) -> float:
    """A frequency in rad/s converted to Hz."""
    return frequency / (2 * math.pi)
