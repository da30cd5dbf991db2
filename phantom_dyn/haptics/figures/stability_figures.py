"""Draws the stability of a sampled loop: Bode diagram with margins, maps of critical stiffness, force feedforward."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.figures.canvas import (
    COLORS,
    GREY,
    IDEAL,
    MARKERS,
    frequency_axis,
    hertz,
    key,
    panels,
)
from phantom_dyn.haptics.stability.critical_stiffness import CriticalStiffness, LoopBode, StabilityMap
from phantom_dyn.haptics.stability.force_feedforward import Transparency
from phantom_dyn.haptics.stability.sampled_loop import CriticalGain

# Axes of a stability map.
_AXES = ("damping", "virtual_damping", "delay", "period")


def loop_bode_figure(bode: LoopBode, *, name: str, stiffness: float = 1.0) -> Figure:
    """Bode diagram of the sampled loop of a device and a virtual wall, with its margins.

    Args:
        bode: Result of `loop_bode`.
        name: Name of the device, for the title.
        stiffness: Stiffness of the wall [N/m]; with 1, the gain margin is the critical stiffness in decibels.
    """
    title = f"{name}, with a virtual wall of {stiffness:g} N/m\n{_verdict(bode.margin)}"
    out, ((gain,), (phase,)) = panels(2, title=title, together=True, height=3.0)
    raised = 20 * math.log10(stiffness)
    gain.plot(bode.frequency, bode.decibels + raised, color=COLORS[0], gid="gain")
    phase.plot(bode.frequency, np.degrees(bode.phase), color=COLORS[0], gid="phase")
    gain.axhline(0, color="black", lw=0.8)
    if math.isfinite(bode.linear):
        level = 20 * math.log10(bode.linear / stiffness)
        gain.axhline(-level, color=GREY, ls=IDEAL, lw=1.2, label=f"linear condition: {level:.2f} dB")
    lowest = min((crossing.gain for crossing in bode.margin.crossings), default=math.nan)
    for k, crossing in enumerate(bode.margin.crossings):
        decides = crossing.gain == lowest
        color, margin = COLORS[1] if decides else GREY, crossing.decibels - raised
        at = [crossing.frequency, crossing.frequency]
        words = f"{margin:.2f} dB at {crossing.frequency:.4g} rad/s"
        gain.plot(at, [-margin, 0], color=color, lw=1.6 if decides else 0.9, gid="gain margin")
        marker = MARKERS[k % len(MARKERS)]
        label = f"gain margin {words}" if decides else f"crossing: {words}"
        gain.plot(at[:1], [-margin], color=color, marker=marker, ls="", label=label)
        # The exact phase of a crossing is 180 degrees plus whole turns; interpolation is only close to it.
        half_turn = 180 - 360 * round((180 - np.degrees(_phase_at(bode, crossing.frequency))) / 360)
        phase.plot(at[:1], [half_turn], color=color, marker=marker, ls="", gid="crossing")
    for k, (frequency, margin) in enumerate(phase_margins(bode, stiffness)):
        end = np.degrees(_phase_at(bode, frequency))
        label = f"phase margin {np.degrees(margin):.1f}° at {frequency:.4g} rad/s"
        phase.plot([frequency] * 2, [end, end - np.degrees(margin)], color=COLORS[2], lw=1.6, label=label)
        gain.plot([frequency], [0], color=COLORS[2], marker="|", ms=12, ls="", gid=f"gain crossover {k}")
    lines = np.arange(-180.0, np.degrees(bode.phase.min()) - 180.0, -360.0)
    for line in lines if len(lines) else (-180.0,):
        phase.axhline(line, color="black", lw=0.8)
    gain.set_ylabel("position over force times wall [dB]")
    phase.set_ylabel("phase [°]")
    frequency_axis(gain, phase)
    key(gain, "lower left")
    if phase.get_legend_handles_labels()[0]:
        key(phase, "lower left")
    return out


def phase_margins(bode: LoopBode, stiffness: float) -> Float[Array, "c 2"]:
    """Frequencies at which the gain of the loop with a wall is one [rad/s], and phase margins [rad] in (-pi, pi].

    Between two frequencies of the diagram, gain and phase are interpolated linearly over the logarithm of frequency.

    Args:
        bode: The loop of the device.
        stiffness: Stiffness of the wall [N/m or N m/rad].

    Raises:
        ParameterError: If the stiffness is not above 0.
    """
    if not stiffness > 0:
        raise ParameterError(f"A wall of {stiffness:g} has no phase margin: give a stiffness above 0.")
    level = bode.decibels + 20 * math.log10(stiffness)
    at = np.flatnonzero(np.diff(np.signbit(level)))
    share = level[at] / (level[at] - level[at + 1])
    place = np.log(bode.frequency)
    frequency = np.exp(place[at] + share * (place[at + 1] - place[at]))
    phase = np.interp(np.log(frequency), place, bode.phase)
    return np.column_stack([frequency, np.pi - np.mod(-phase, 2 * np.pi)])


def critical_stiffness_figure(found: StabilityMap, *, name: str) -> Figure:
    """Critical stiffness, and frequency of the oscillation beyond it, over two quantities; white: no stable wall.

    Args:
        found: A map in which exactly two axes have more than one value.
        name: Name of the device, for the title.

    Raises:
        ParameterError: If the number of axes that vary is not two.
    """
    up, across = _varying(found, 2)
    fixed = ", ".join(_fixed(found, axis) for axis in _AXES if axis not in (up, across))
    title = f"{name}: stiffest stable virtual wall, and frequency of the oscillation beyond it\n{fixed}"
    out, ((left, right),) = panels(1, 2, title=title, width=11, height=4.2)
    # Axes with one value are removed; the two that vary are in the order of `_AXES`.
    stiffness, frequency = (values.squeeze() for values in (found.stiffness, found.frequency))
    for ax, values, colors, label in (
        (left, stiffness, "viridis", "critical stiffness [N/m]"),
        (right, frequency / (2 * np.pi), "cividis", "frequency of the oscillation [Hz]"),
    ):
        place = (_shown(found, across), _shown(found, up))
        # The frequency jumps where the first unstable oscillation changes, so that its contour lines would coincide.
        _coloured(out, ax, place, values, colors, label, lines=ax is left)
        ax.set_xlabel(_label(across))
        ax.set_ylabel(_label(up))
    return out


def linear_condition_figure(found: StabilityMap, *, name: str) -> Figure:
    """Exact critical stiffness, that of the linear condition, and the ratio of both.

    Args:
        found: A map in which one or two axes vary; if two vary, each value of the shorter one has a curve.
        name: Name of the device, for the title.

    Raises:
        ParameterError: If no axis varies or more than two do, or if there are more than seven curves.
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
    fixed = ", ".join(_fixed(found, axis) for axis in _AXES if axis not in varying)
    spread = f"{np.nanmin(ratio):.3g} to {np.nanmax(ratio):.3g}"
    title = f"{name}: exact critical stiffness is {spread} times that of the linear condition\n{fixed}"
    out, ((values,), (quotient,)) = panels(2, title=title, together=True, ratios=(3, 2))
    x = _shown(found, across)
    for k in range(count):
        label = f", {_fixed(found, others[0], k)}" if others else ""
        look = {"color": COLORS[k], "marker": MARKERS[k], "ms": 4, "markevery": max(len(x) // 10, 1)}
        values.plot(x, exact[k], **look, label=f"exact{label}")
        values.plot(x, linear[k], color=COLORS[k], ls=IDEAL, label=f"linear{label}")
        quotient.plot(x, ratio[k], **look)
    quotient.axhline(1, color="black", lw=0.8)
    if exact.max() > 20 * exact.min() > 0:
        values.set_yscale("log")
    values.set_ylabel("critical stiffness [N/m]")
    quotient.set_ylabel("exact over linear")
    quotient.set_xlabel(_label(across))
    key(values, columns=count)
    return out


def transparency_figure(results: Mapping[float, Transparency], *, name: str, filtered: str) -> Figure:
    """Bode diagram of a device in a hand with force feedforward, and the inertia that the hand feels.

    Args:
        results: Results of `transparency`; keys are force gains.
        name: Name of the device, for the title.
        filtered: Filters in the loop, for the title.
    """
    title = f"{name} with force feedforward: lighter at low frequency, as heavy as ever beyond the filter\n{filtered}"
    out, ((gain,), (phase,), (inertia,)) = panels(3, title=title, together=True, height=2.5)
    for k, (force_gain, result) in enumerate(results.items()):
        w, color, label = result.frequency, COLORS[k % len(COLORS)], f"force gain {force_gain:g}"
        for response, dash, words in ((result.response, "-", label), (result.ideal, IDEAL, f"{label}, ideal")):
            gain.plot(w, 20 * np.log10(np.abs(response)), color=color, ls=dash, label=words, gid=words)
            phase.plot(w, np.degrees(np.unwrap(np.angle(response))), color=color, ls=dash)
        felt = f"{label}: {result.apparent_inertia[0]:.2g} kg at low frequency"
        inertia.plot(w, result.apparent_inertia, color=color, label=felt, gid=f"{label}, inertia")
    inertia.axhline(0, color="black", lw=0.8)
    # Without fixed limits, a resonance would determine the limits of the panel.
    heaviest = max(float(result.apparent_inertia[0]) for result in results.values())
    inertia.set_ylim(-0.5 * heaviest, 2.0 * heaviest)
    gain.set_ylabel("position over the\nhand's force [dB]")
    phase.set_ylabel("phase [°]")
    inertia.set_ylabel("apparent inertia\nof the device [kg]")
    frequency_axis(gain, inertia)
    key(gain, "lower left")
    key(inertia, "upper left")
    return out


def worst_delay_figure(
    delay: Float[Array, " k"],
    limits: Mapping[str, Sequence[CriticalGain]],
    worst: Mapping[str, float],
    *,
    name: str,
) -> Figure:
    """Largest stable force gain over the delay, and its limit for long delays.

    Args:
        delay: Delay of the loop in addition to the hold [s], shape ``(k,)``.
        limits: Results of `critical_feedforward`, one for each delay; keys are names of curves.
        worst: Results of `worst_critical_feedforward`, with the same keys.
        name: Name of the device, for the title.
    """
    title = f"{name}: a short delay raises the stable force gain, longer ones lower it towards 1 + m/m_h"
    out, ((gain,), (frequency,)) = panels(2, title=title, together=True, ratios=(3, 2))
    for k, (label, found) in enumerate(limits.items()):
        # The frequencies of several curves may coincide, so that later markers are larger and hollow.
        look = {"color": COLORS[k % len(COLORS)], "marker": MARKERS[k % len(MARKERS)], "ms": 3 + 3 * k, "mfc": "none"}
        gain.semilogy(1e3 * delay, [one.gain for one in found], **look, label=label, gid=label)
        words = f"{label}, worst case {worst[label]:.2f}"
        gain.axhline(worst[label], color=look["color"], ls=IDEAL, lw=1, label=words)
        frequency.semilogy(1e3 * delay, [one.frequency / (2 * np.pi) for one in found], **look)
    for ax in (gain, frequency):
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_formatter("{x:g}")
        ax.tick_params(axis="y", which="both", labelsize=8)
    gain.set_ylabel("largest stable force gain")
    frequency.set_ylabel("frequency of the\noscillation beyond it [Hz]")
    frequency.set_xlabel("delay in addition to the hold [ms]")
    key(gain, "upper right")
    return out


def _phase_at(bode: LoopBode, frequency: float) -> float:
    """Phase of a loop at a frequency [rad/s], interpolated between those of the diagram [rad]."""
    return float(np.interp(math.log(frequency), np.log(bode.frequency), bode.phase))


def _verdict(margin: CriticalStiffness) -> str:
    """The critical stiffness in words."""
    if margin.stiffness == 0:
        return "no virtual wall is stable"
    if math.isinf(margin.stiffness):
        return "every virtual wall is stable"
    frequency = f"{margin.frequency:.4g} rad/s ({hertz(margin.frequency):.3g} Hz)"
    return f"stable up to {margin.stiffness:.5g} N/m ({margin.decibels:.2f} dB), then it oscillates at {frequency}"


def _varying(found: StabilityMap, *wanted: int) -> list[str]:
    """Axes of a map with more than one value; their number must be one of ``wanted``."""
    varying = [axis for axis in _AXES if len(getattr(found, axis)) > 1]
    if len(varying) not in wanted:
        raise ParameterError(
            f"The map varies {', '.join(varying) or 'nothing'}: "
            f"this figure takes one that varies {' or '.join(map(str, wanted))} of {', '.join(_AXES)}."
        )
    return varying


def _shown(found: StabilityMap, axis: str) -> Array:
    """Values of an axis in the unit of its label: times in ms."""
    values = getattr(found, axis)
    return 1e3 * values if axis in ("delay", "period") else values


def _label(axis: str) -> str:
    if axis in ("delay", "period"):
        return f"{'delay in addition to the hold' if axis == 'delay' else 'sampling period'} [ms]"
    words = "damping added to the motor" if axis == "damping" else "virtual damping of the wall"
    return f"{words} [N s/m]"


def _fixed(found: StabilityMap, axis: str, k: int = 0) -> str:
    """Name and k-th value of an axis in words."""
    words = {"damping": "added damping", "virtual_damping": "virtual damping", "delay": "delay", "period": "period"}
    unit = "ms" if axis in ("delay", "period") else "N s/m"
    return f"{words[axis]} {_shown(found, axis)[k]:g} {unit}"


def _coloured(
    out: Figure, ax: Axes, place: tuple[Array, Array], values: Array, colors: str, label: str, *, lines: bool
) -> None:
    """Draw values over two axes in colours on a logarithmic scale, with contour lines if ``lines``."""
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
