"""Maps of critical stiffness, and the linear condition beside the exact boundary."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.figures.canvas import COLORS, DASHES, damping_unit, key, panels, stiffness_unit
from phantom_dyn.haptics.stability.critical_stiffness import StabilityMap

Array = np.ndarray
_AXES = ("damping", "virtual_damping", "delay", "period")


def critical_stiffness_figure(found: StabilityMap, *, name: str, rotary: bool = False) -> Figure:
    """Critical stiffness and the frequency of the oscillation at the edge, over two quantities; white: none is stable.

    Args:
        found: A map with two axes of more than one value.
        name: Of the device, for the title.
        rotary: Whether the axis turns, for the units.

    Raises:
        ParameterError: If other than two axes vary.
    """
    up, across = _varying(found, 2)
    fixed = ", ".join(_fixed(found, axis, rotary) for axis in _AXES if axis not in (up, across))
    title = f"{name}: stiffest stable virtual wall, and how it swings beyond it\n{fixed}"
    out, ((left, right),) = panels(1, 2, title=title, width=11, height=4.2)
    # Columns of an axis that varies are left; the first of the fields is the first axis of the array.
    stiffness, frequency = (values.squeeze() for values in (found.stiffness, found.frequency))
    for ax, values, colors, label in (
        (left, stiffness, "viridis", f"critical stiffness [{stiffness_unit(rotary)}]"),
        (right, frequency / (2 * np.pi), "cividis", "frequency of the oscillation [Hz]"),
    ):
        place = (_shown(found, across), _shown(found, up))
        # Where another oscillation takes over the frequency jumps: lines of equal value would pile up there.
        _coloured(out, ax, place, values, colors, label, lines=ax is left)
        ax.set_xlabel(_label(across, rotary))
        ax.set_ylabel(_label(up, rotary))
    return out


def linear_condition_figure(found: StabilityMap, *, name: str, rotary: bool = False) -> Figure:
    """Exact critical stiffness beside that of the linear condition, and the ratio of both.

    Args:
        found: A map along one axis, or along two, of which the shorter one makes a curve for each of its values.
        name: Of the device, for the title.
        rotary: Whether the axis turns, for the units.

    Raises:
        ParameterError: If no axis varies, more than two do, or there would be more than six curves.
    """
    varying = sorted(_varying(found, 1, 2), key=lambda axis: len(getattr(found, axis)))
    across, others = varying[-1], varying[:-1]
    count = len(getattr(found, others[0])) if others else 1
    if count > len(COLORS):
        raise ParameterError(
            f"{count} curves were asked for: give a map with at most {len(COLORS)} values of one axis."
        )
    order = [_AXES.index(axis) for axis in (*others, across)]
    rest = [k for k in range(4) if k not in order]
    exact, linear, ratio = (
        np.transpose(values, (*order, *rest)).reshape(count, -1)
        for values in (found.stiffness, found.linear, found.ratio)
    )
    fixed = ", ".join(_fixed(found, axis, rotary) for axis in _AXES if axis not in varying)
    spread = f"{np.nanmin(ratio):.3g} to {np.nanmax(ratio):.3g}"
    title = f"{name}: exact critical stiffness is {spread} times that of the linear condition\n{fixed}"
    out, ((values,), (quotient,)) = panels(2, title=title, together=True, ratios=(3, 2))
    x = _shown(found, across)
    for k in range(count):
        label = f", {_fixed(found, others[0], rotary, k)}" if others else ""
        values.plot(x, exact[k], color=COLORS[k], label=f"exact{label}")
        values.plot(x, linear[k], color=COLORS[k], ls="--", label=f"linear{label}")
        quotient.plot(x, ratio[k], color=COLORS[k], ls=DASHES[k])
    quotient.axhline(1, color="black", lw=0.8)
    if exact.max() > 20 * exact.min() > 0:
        values.set_yscale("log")
    values.set_ylabel(f"critical stiffness [{stiffness_unit(rotary)}]")
    quotient.set_ylabel("exact over linear")
    quotient.set_xlabel(_label(across, rotary))
    key(values, columns=count)
    return out


def _varying(found: StabilityMap, *wanted: int) -> list[str]:
    varying = [axis for axis in _AXES if len(getattr(found, axis)) > 1]
    if len(varying) not in wanted:
        raise ParameterError(
            f"The map varies {', '.join(varying) or 'nothing'}: "
            f"this figure takes one that varies {' or '.join(map(str, wanted))} of {', '.join(_AXES)}."
        )
    return varying


def _shown(found: StabilityMap, axis: str) -> Array:
    values = getattr(found, axis)
    return 1e3 * values if axis in ("delay", "period") else values


def _label(axis: str, rotary: bool) -> str:
    if axis in ("delay", "period"):
        return f"{'delay beside the hold' if axis == 'delay' else 'sampling period'} [ms]"
    words = "damping added to the motor" if axis == "damping" else "virtual damping of the wall"
    return f"{words} [{damping_unit(rotary)}]"


def _fixed(found: StabilityMap, axis: str, rotary: bool, k: int = 0) -> str:
    words = {"damping": "added damping", "virtual_damping": "virtual damping", "delay": "delay", "period": "period"}
    unit = "ms" if axis in ("delay", "period") else damping_unit(rotary)
    return f"{words[axis]} {_shown(found, axis)[k]:g} {unit}"


def _coloured(
    out: Figure, ax: Axes, place: tuple[Array, Array], values: Array, colors: str, label: str, *, lines: bool
) -> None:
    stable = np.ma.masked_invalid(np.ma.masked_less_equal(values, 0))
    ax.grid(False)
    if stable.count() == 0:
        ax.text(0.5, 0.5, "no wall is stable", ha="center", transform=ax.transAxes)
        return
    low, high = float(stable.min()), float(stable.max())
    shown = ax.pcolormesh(*place, stable, norm=LogNorm(low, high), cmap=colors, shading="nearest", rasterized=True)
    out.colorbar(shown, ax=ax, label=label)
    levels = np.asarray(LogLocator(subs=(1.0, 2.0, 5.0), numticks=30).tick_values(low, high))
    levels = levels[(levels > low) & (levels < high)]
    if lines and len(levels):
        drawn = ax.contour(*place, stable, levels, colors="white", linewidths=0.8)
        ax.clabel(drawn, fmt=lambda value: f"{value:g}", fontsize=8)
