"""Bode diagram of a sampled loop with a virtual wall: gain margins at all crossings, phase margins."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.figures.canvas import COLORS, GREY, MARKERS, frequency_axis, hertz, key, panels, stiffness_unit
from phantom_dyn.haptics.stability.critical_stiffness import CriticalStiffness, LoopBode

Array = np.ndarray


def phase_margins(bode: LoopBode, stiffness: float) -> Float[Array, "c 2"]:
    """Where the loop of a wall has gain one: frequencies [rad/s] and phase margins [rad], in (-pi, pi].

    Between two frequencies of the diagram both run straight over the logarithm of the frequency.

    Args:
        bode: The loop of the device.
        stiffness: Of the wall [N/m or N m/rad].

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


def loop_bode_figure(bode: LoopBode, *, name: str, stiffness: float = 1.0, rotary: bool = False) -> Figure:
    """Bode diagram of the sampled loop of a device and a virtual wall, with its margins.

    Args:
        bode: From `loop_bode`.
        name: Of the device, for the title.
        stiffness: Of the wall [N/m or N m/rad]; at 1 the gain margin in decibels is the critical stiffness.
        rotary: Whether the axis turns, for the units.
    """
    unit = stiffness_unit(rotary)
    title = f"{name}, with a virtual wall of {stiffness:g} {unit}\n{_verdict(bode.margin, unit)}"
    out, ((gain,), (phase,)) = panels(2, title=title, together=True, height=3.0)
    raised = 20 * math.log10(stiffness)
    gain.plot(bode.frequency, bode.decibels + raised, color=COLORS[0], gid="gain")
    phase.plot(bode.frequency, np.degrees(bode.phase), color=COLORS[0], gid="phase")
    gain.axhline(0, color="black", lw=0.8)
    if math.isfinite(bode.linear):
        level = 20 * math.log10(bode.linear / stiffness)
        gain.axhline(-level, color=GREY, ls=":", lw=1.2, label=f"linear condition: {level:.2f} dB")
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
        turn = 180 - 360 * round((180 - np.degrees(_at(bode, crossing.frequency))) / 360)
        phase.plot(at[:1], [turn], color=color, marker=marker, ls="", gid="crossing")
    for k, (frequency, margin) in enumerate(phase_margins(bode, stiffness)):
        end = np.degrees(_at(bode, frequency))
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


def _at(bode: LoopBode, frequency: float) -> float:
    return float(np.interp(math.log(frequency), np.log(bode.frequency), bode.phase))


def _verdict(margin: CriticalStiffness, unit: str) -> str:
    if margin.stiffness == 0:
        return "no virtual wall is stable"
    if math.isinf(margin.stiffness):
        return "every virtual wall is stable"
    swings = f"{margin.frequency:.4g} rad/s ({hertz(margin.frequency):.3g} Hz)"
    return f"stable up to {margin.stiffness:.5g} {unit} ({margin.decibels:.2f} dB), then it swings at {swings}"
