"""The improved electronics of the PHANToM: velocity estimators, heat of drives, loops in time."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from phantom_dyn.haptics.device.drives import PUBLISHED_RISE_LINEAR, PUBLISHED_RISE_PULSES, SwitchedCurrent, Warming
from phantom_dyn.haptics.figures.canvas import COLORS, MARKERS, key, panels
from phantom_dyn.haptics.sensing.loop_simulation import LoopTrace
from phantom_dyn.haptics.sensing.velocity_comparison import EstimatorFigures

_SHOWN, _SHOWN_STEADY = 0.1, 0.04
"""Ends of the accelerated and of the steady motion that the traces show [s]."""
_PUBLISHED_AFTER = 600.0
"""Time after which the published rises of the casing were measured [s]."""


def loop_traces_figure(traces: Mapping[str, LoopTrace], *, title: str) -> Figure:
    """Positions and commanded forces of loops in time, one row each; a wall, a damper or two devices tied together.

    Args:
        traces: Loops by what was set, such as the gain.
        title: What is seen.
    """
    out, rows = panels(len(traces), 2, title=title, width=11, height=2.2)
    for (name, trace), (position, force) in zip(traces.items(), rows, strict=True):
        for device in range(trace.position.shape[1]):
            label = f"device {device + 1}" if trace.position.shape[1] > 1 else None
            look = {"color": COLORS[device], "label": label}
            position.plot(trace.t, 1e3 * trace.position[:, device], **look)
            force.plot(trace.t, trace.force[:, device], lw=0.8, **look)
        ended = ", it ran away" if trace.ran_away else ""
        position.set_title(f"{name}{ended}", fontsize=9)
        position.set_ylabel("position [mm]")
        force.set_ylabel("force [N]")
        if trace.position.shape[1] > 1 and position is rows[0][0]:
            key(position, "upper right")
        for ax in (position, force):
            ax.set_xlabel("time [s]")
    return out


def velocity_estimators_figure(estimators: Mapping[str, EstimatorFigures]) -> Figure:
    """Lag and granularity of velocity estimators, and what they make of an accelerated and of a steady motion.

    Args:
        estimators: Results of `estimator_figures` for one motion, by the estimator's name; at most seven.
    """
    title = "Velocity estimators: what is fine is late, unless the time between edges or the acceleration is measured"
    out, ((lag, grain), (fast, steady)) = panels(2, 2, title=title, width=12, height=3.4)
    names, found = list(estimators), list(estimators.values())
    places = np.arange(len(names))
    for ax, values, label, digits in (
        (lag, [1e3 * one.lag for one in found], "lag [ms]", ".1f"),
        (grain, [1e3 * one.granularity for one in found], "granularity [mm/s]", ".2g"),
    ):
        bars = ax.barh(places, values, color=COLORS[: len(names)])
        ax.bar_label(bars, [f" {value:{digits}}" for value in values], fontsize=8)
        ax.set_yticks(places, names, fontsize=8)
        ax.invert_yaxis()
        ax.set_xlabel(label)
    grain.set_xscale("log")
    for ax in (lag, grain):
        ax.margins(x=0.15)
    first = found[0]
    late, end = first.t >= first.t[-1] - _SHOWN, first.t >= first.t[-1] - _SHOWN_STEADY
    fast.plot(first.t[late], 1e3 * first.velocity[late], color="black", lw=1, label="true")
    steady.axhline(1e3 * first.velocity[0], color="black", lw=1, label="true")
    for k, (name, one) in enumerate(estimators.items()):
        # The coarsest would cross the panels as upright lines: its bar says what it does.
        if one.granularity == max(other.granularity for other in found) and len(found) > 1:
            continue
        look = {"color": COLORS[k], "lw": 1.3, "label": name, "drawstyle": "steps-post", "zorder": 2}
        fast.plot(one.t[late], 1e3 * one.estimate[late], **look)
        steady.plot(one.t[end], 1e3 * one.steady_estimate[end], **look)
    fast.set_title("constant acceleration", fontsize=9)
    steady.set_title("constant speed", fontsize=9)
    for ax in (fast, steady):
        ax.set_xlabel("time [s]")
        ax.set_ylabel("velocity [mm/s]")
    late_by = max(abs(one.lag) for one in found) * (first.velocity[-1] - first.velocity[0]) / first.t[-1]
    reach = 1.6e3 * max(abs(late_by), sorted(one.granularity for one in found)[-2:][0])
    low, high = np.sort(1e3 * first.velocity[late][[0, -1]])
    fast.set_ylim(low - reach, high + reach)
    steady.set_ylim(1e3 * first.velocity[0] - reach, 1e3 * first.velocity[0] + reach)
    for ax in (fast, steady):
        ax.get_lines()[0].set_zorder(3)
    out.legend(*steady.get_legend_handles_labels(), loc="outside lower center", ncols=len(found), fontsize=8)
    return out


def drive_heat_figure(switched: Mapping[str, SwitchedCurrent], warm: Warming) -> Figure:
    """Current of a motor under pulses, its heat beside that of a linear drive, and how the motor warms up.

    Args:
        switched: Steady currents at one duty cycle, by what the winding is.
        warm: Temperature rise under both drives; beside it the published rises after ten minutes.
    """
    title = "Pulses heat a motor more than a linear drive of the same mean current, unless its winding is slow"
    out, ((current, heat, rise),) = panels(1, 3, title=title, width=13, height=3.6)
    for k, (name, one) in enumerate(switched.items()):
        look = {"marker": MARKERS[k % len(MARKERS)], "ms": 4, "markevery": len(one.t) // 10}
        current.plot(1e6 * one.t, one.current, color=COLORS[k % len(COLORS)], **look, label=name)
    means = [one.mean for one in switched.values()]
    current.axhline(float(np.mean(means)), color="black", lw=1, label="mean")
    current.set_xlabel("time in a period of the pulses [us]")
    current.set_ylabel("current [A]")
    key(current)
    places, width = np.arange(len(switched)), 0.38
    for shift, values, color, label in (
        (-width / 2, [one.heat for one in switched.values()], COLORS[1], "pulses"),
        (width / 2, [one.heat_linear for one in switched.values()], COLORS[0], "linear"),
    ):
        bars = heat.bar(places + shift, values, width, color=color, label=label)
        if label == "pulses":
            heat.bar_label(bars, [f"x {one.ratio:.2f}" for one in switched.values()], fontsize=8)
    heat.set_xticks(places, list(switched), fontsize=8)
    heat.margins(y=0.12)
    heat.set_ylabel("heat in the winding [W]")
    key(heat)
    rise.plot(warm.t / 60, warm.pulses, color=COLORS[1], label="pulses", gid="pulses")
    rise.plot(warm.t / 60, warm.linear, color=COLORS[0], label="linear", gid="linear")
    for value, color, label in (
        (PUBLISHED_RISE_PULSES, COLORS[1], "pulses"),
        (PUBLISHED_RISE_LINEAR, COLORS[0], "linear"),
    ):
        rise.plot([_PUBLISHED_AFTER / 60], [value], "D", color=color, label=f"published, {label}: {value} K")
    rise.set_xlabel("time [min]")
    rise.set_ylabel("rise of the casing [K]")
    key(rise, "lower right")
    return out
