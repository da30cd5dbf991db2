"""Gains of virtual walls, dampers and teleoperation, with the published ratios beside; loops in time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from phantom_dyn.haptics.figures.canvas import COLORS, MARKERS, key, panels
from phantom_dyn.haptics.sensing.loop_simulation import LoopTrace
from phantom_dyn.haptics.stability.phantom_improvements import Improvement

Array = np.ndarray


def improvements_figure(improvements: Sequence[Improvement]) -> Figure:
    """How much better a quantity became by the improved electronics: published, and by each model that has an answer.

    Args:
        improvements: Results of `phantom_improvements`.
    """
    title = "PHANToM 1.5, improved over stock: published ratios and those of models"
    answers = [model.ratio for one in improvements for model in one.models]
    most = float(np.nanmax([2.0, *(one.published_ratio for one in improvements), *answers]))
    rows = [1 + len(one.models) for one in improvements]
    out, axes = panels(len(rows), title=title, width=9.5, height=0.42 * max(rows) + 0.7, ratios=rows)
    for (ax,), one in zip(axes, improvements, strict=True):
        ratios = [one.published_ratio, *(model.ratio for model in one.models)]
        names = ["published", *(model.model for model in one.models)]
        figures = [one.published, *((model.before, model.after) for model in one.models)]
        units = [one.unit, *(model.unit for model in one.models)]
        for k, (ratio, pair, unit) in enumerate(zip(ratios, figures, units, strict=True)):
            if math.isnan(ratio):
                ax.text(1.03, k, _no_answer(pair), va="center", fontsize=8)
                continue
            ax.plot([1, ratio], [k, k], color=COLORS[1 if k == 0 else 0], lw=2)
            ax.plot([ratio], [k], MARKERS[k == 0], color=COLORS[1 if k == 0 else 0], gid=names[k])
            values = "" if pair is None else f" ({pair[0]:.4g} to {pair[1]:.4g} {unit})"
            ax.text(ratio * 1.03, k, f"{100 * (ratio - 1):+.0f} %{values}", va="center", fontsize=8)
        ax.axvline(one.published_ratio, color=COLORS[1], ls=":", lw=1)
        ax.set_xscale("log")
        ax.set_xlim(0.95, 6 * most)
        ax.set_xticks([1, 1.5, 2, 3, 5, 10, 20], ["1", "1.5", "2", "3", "5", "10", "20"])
        ax.grid(False, axis="y")
        ax.minorticks_off()
        ax.set_yticks(range(len(names)), names, fontsize=8)
        ax.set_ylim(len(names) - 0.4, -0.6)
        ax.set_title(one.quantity, fontsize=9)
    axes[-1][0].set_xlabel("improved over stock [-]")
    return out


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
            look = {"color": COLORS[device], "ls": "--" if device else "-", "label": label}
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


def _no_answer(pair: tuple[float, float] | None) -> str:
    if pair is not None and pair[0] == 0:
        return "no answer: unstable for every gain"
    return "no answer: stable for every gain" if pair is not None and math.isinf(pair[0]) else "no answer"
