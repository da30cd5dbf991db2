"""What all figures of haptics share: colours for colour-blind readers, panels, axes of frequency, legends, units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from phantom_dyn.array_types import Array

Place = Literal["best", "upper left", "upper right", "lower left", "lower right", "center left"]

# Colours of Okabe and Ito, and a wine red of Tol; markers distinguish the same curves without any colour.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#882255")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
# One meaning for one line style, in every figure: a result is solid.
IDEAL = "--"
"""What an approximation, an ideal or a plan gives, or what a result tends to."""
MARK = ":"
"""A level or an instant that is pointed at, such as a limit that was set or a published value."""
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
        rows: Of panels.
        columns: Of panels.
        title: What is seen.
        width: Of the figure [inch].
        height: Of a row [inch].
        ratios: Heights of the rows in relation to each other.
        together: Whether all panels of a column have one abscissa.
    """
    out = Figure(figsize=(width, 0.8 + height * rows), dpi=110, layout="constrained")
    share = "col" if together else False
    axes = cast(Array, out.subplots(rows, columns, squeeze=False, sharex=share, height_ratios=ratios))
    for ax in axes.flat:
        ax.grid(alpha=0.3)
    out.suptitle(title, fontsize=_TITLE)
    return out, axes.tolist()


def frequency_axis(top: Axes, bottom: Axes) -> None:
    """Logarithmic frequency for panels over each other: rad/s below the last, Hz above the first."""
    for ax in (top, bottom):
        ax.set_xscale("log")
    bottom.set_xlabel("frequency [rad/s]")
    hertz = top.secondary_xaxis(
        "top", functions=(lambda w: np.divide(w, 2 * np.pi), lambda f: np.multiply(f, 2 * np.pi))
    )
    hertz.set_xlabel("frequency [Hz]", fontsize=8)
    hertz.tick_params(labelsize=8)


def shade(ax: Axes, x: Array, where: Array, label: str) -> None:
    """A pale ground over the abscissas where something holds."""
    ax.fill_between(x, 0, 1, where=where.tolist(), transform=ax.get_xaxis_transform(), color=PALE, lw=0, label=label)


def key(ax: Axes, place: Place = "best", columns: int = 1) -> None:
    """A small legend."""
    ax.legend(loc=place, fontsize=8, ncols=columns, framealpha=0.85)


def beside(ax: Axes) -> None:
    """A small legend right of the panel, where it hides nothing."""
    ax.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)


def hertz(frequency: float) -> float:
    """A frequency in rad/s in hertz."""
    return frequency / (2 * math.pi)
