"""Force feedforward: what a hand feels, and how much of it delay allows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from phantom_dyn.haptics.figures.canvas import COLORS, MARKERS, frequency_axis, key, panels
from phantom_dyn.haptics.stability.force_feedforward import Transparency
from phantom_dyn.haptics.stability.sampled_loop import CriticalGain

Array = np.ndarray


def transparency_figure(results: Mapping[float, Transparency], *, name: str, filtered: str) -> Figure:
    """Bode diagram of a device in a hand with force feedforward, and the inertia that the hand feels.

    Args:
        results: Of `transparency`, by their force gain.
        name: Of the device, for the title.
        filtered: What is in the loop, for the title.
    """
    title = f"{name} with force feedforward: lighter at low frequency, as heavy as ever beyond the filter\n{filtered}"
    out, ((gain,), (phase,), (inertia,)) = panels(3, title=title, together=True, height=2.5)
    for k, (force_gain, result) in enumerate(results.items()):
        w, color, label = result.frequency, COLORS[k % len(COLORS)], f"force gain {force_gain:g}"
        for response, dash, words in ((result.response, "-", label), (result.ideal, ":", f"{label}, ideal")):
            gain.plot(w, 20 * np.log10(np.abs(response)), color=color, ls=dash, label=words, gid=words)
            phase.plot(w, np.degrees(np.unwrap(np.angle(response))), color=color, ls=dash)
        inertia.plot(w, result.apparent_inertia, color=color, label=label, gid=f"{label}, inertia")
    inertia.axhline(0, color="black", lw=0.8)
    gain.set_ylabel("position over the\nhand's force [dB]")
    phase.set_ylabel("phase [°]")
    inertia.set_ylabel("apparent inertia\nof the device [kg]")
    frequency_axis(gain, inertia)
    key(gain, "lower left")
    key(inertia)
    return out


def worst_delay_figure(
    delay: Float[Array, " k"],
    limits: Mapping[str, Sequence[CriticalGain]],
    worst: Mapping[str, float],
    *,
    name: str,
) -> Figure:
    """Largest stable force gain over the delay, and the value that it tends to.

    Args:
        delay: Of the loop beside the hold [s], shape ``(k,)``.
        limits: Of `critical_feedforward`, as many as there are delays, by what they hold for.
        worst: Of `worst_critical_feedforward`, by the same words.
        name: Of the device, for the title.
    """
    title = f"{name}: a short delay raises the stable force gain, longer ones lower it towards 1 + m/m_h"
    out, ((gain,), (frequency,)) = panels(2, title=title, together=True, ratios=(3, 2))
    for k, (label, found) in enumerate(limits.items()):
        # The frequencies of several hands may lie on each other: later marks are larger and hollow.
        look = {"color": COLORS[k % len(COLORS)], "marker": MARKERS[k % len(MARKERS)], "ms": 3 + 3 * k, "mfc": "none"}
        gain.semilogy(1e3 * delay, [one.gain for one in found], **look, label=label, gid=label)
        words = f"{label}, worst case {worst[label]:.2f}"
        gain.axhline(worst[label], color=look["color"], ls="--", lw=1, label=words)
        frequency.semilogy(1e3 * delay, [one.frequency / (2 * np.pi) for one in found], **look)
    for ax in (gain, frequency):
        ax.yaxis.set_major_formatter("{x:g}")
        ax.yaxis.set_minor_formatter("{x:g}")
        ax.tick_params(axis="y", which="both", labelsize=8)
    gain.set_ylabel("largest stable force gain")
    frequency.set_ylabel("it then swings at [Hz]")
    frequency.set_xlabel("delay beside the hold [ms]")
    key(gain, "upper right")
    return out
