"""The improved electronics of the PHANToM: velocity estimators, heat of drives, gains beside the published ratios."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from phantom_dyn.haptics.device.drives import PUBLISHED_RISE_LINEAR, PUBLISHED_RISE_PULSES, SwitchedCurrent, Warming
from phantom_dyn.haptics.figures.canvas import COLORS, MARK, MARKERS, key, panels
from phantom_dyn.haptics.sensing.loop_simulation import LoopTrace
from phantom_dyn.haptics.sensing.velocity_comparison import EstimatorFigures
from phantom_dyn.haptics.stability.phantom_improvements import Improvement, ModelFigure
from phantom_dyn.haptics.stability.published_ratios import Explained

Array = np.ndarray

_SHOWN, _SHOWN_STEADY = 0.1, 0.04
"""Ends of the accelerated and of the steady motion that the traces show [s]."""
_PUBLISHED_AFTER = 600.0
"""Time after which the published rises of the casing were measured [s]."""


def improvements_figure(improvements: Sequence[Improvement], explained: Sequence[Explained] = ()) -> Figure:
    """How much better a quantity became by the improved electronics: published, assumed, and by each model.

    Args:
        improvements: Results of `phantom_improvements`.
        explained: Results of `explained_improvements`, as many and in the same order, or none.
    """
    title = "PHANToM 1.5, improved over stock: published, under assumptions, and by models alone"
    rows = [[_published(one), *map(_model, one.models)] for one in improvements]
    for row, one in zip(rows, explained, strict=False):
        row.insert(1, _assumed(one))
    ratios = [ratio for row in rows for _, ratio, _, _ in row if not math.isnan(ratio)]
    out, axes = panels(len(rows), title=title, width=12, height=1.9, ratios=[len(row) for row in rows])
    for (ax,), row, one in zip(axes, rows, improvements, strict=True):
        ax.axvline(one.published_ratio, color=COLORS[1], ls=MARK, lw=1)
        for k, (name, ratio, says, needs) in enumerate(row):
            kind = 1 if k == 0 else 2 if name == "under assumptions" else 0
            if not math.isnan(ratio):
                ax.plot([1, ratio], [k, k], color=COLORS[kind], lw=2)
                ax.plot([ratio], [k], MARKERS[kind], color=COLORS[kind], gid=name)
            ax.text(1.06 * ratio if needs else 1.0, k, needs, va="center", fontsize=8)
            # Beside the panel, where no curve runs through it.
            ax.text(1.01, k, says, va="center", fontsize=8, transform=ax.get_yaxis_transform())
        ax.set_xscale("log")
        ax.set_xlim(0.95, 1.3 * max(2.0, *ratios))
        ax.set_xticks([1, 1.5, 2, 3, 5, 10, 20], ["1", "1.5", "2", "3", "5", "10", "20"])
        ax.grid(False, axis="y")
        ax.minorticks_off()
        ax.set_yticks(range(len(row)), [name for name, *_ in row], fontsize=8)
        ax.set_ylim(len(row) - 0.4, -0.6)
        ax.set_title(one.quantity, fontsize=9)
    axes[-1][0].set_xlabel("improved over stock [-]")
    return out


_Row = tuple[str, float, str, str]
"""Name, ratio, what stands beside the panel, and what is assumed."""


def _published(one: Improvement) -> _Row:
    values = "" if one.published is None else f": {one.published[0]:g} to {one.published[1]:g} {one.unit}"
    return "published", one.published_ratio, f"{100 * (one.published_ratio - 1):+.0f} %{values}", ""


def _assumed(one: Explained) -> _Row:
    # Where no values are published, the model's stand on nothing but its assumptions.
    values = "" if one.published is None else f": {one.before:.4g} to {one.after:.4g} {one.unit}"
    needs = "; ".join(f"{need.says}: {need.value:.3g} {need.unit}" for need in one.assumptions)
    return "under assumptions", one.ratio, f"{100 * (one.ratio - 1):+.0f} %{values}", needs


def _model(model: ModelFigure) -> _Row:
    if math.isnan(model.ratio):
        return model.model, model.ratio, _no_answer((model.before, model.after)), ""
    known = not model.unit.startswith("in the fit")
    values = f": {model.before:.3g} to {model.after:.3g} {model.unit}" if known else ", units of the fit not stated"
    return model.model, model.ratio, f"{100 * (model.ratio - 1):+.0f} %{values}", ""


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


def _no_answer(pair: tuple[float, float] | None) -> str:
    if pair is not None and pair[0] == 0:
        return "no answer: unstable for every gain"
    return "no answer: stable for every gain" if pair is not None and math.isinf(pair[0]) else "no answer"
