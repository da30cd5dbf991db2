"""Experiments on a device: limit cycles under a relay, and a frequency response with the model that fits it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from phantom_dyn.haptics.experiments.frequency_identification import TwoMassFit
from phantom_dyn.haptics.experiments.relay import LimitCycle, RelayExperiment
from phantom_dyn.haptics.figures.canvas import (
    COLORS,
    GREY,
    MARK,
    PALE,
    frequency_axis,
    hertz,
    key,
    panels,
    stiffness_unit,
)

_CYCLES = 5
"""Cycles of the oscillation that a time trace and a phase plane show."""


def limit_cycles_figure(runs: Mapping[str, tuple[RelayExperiment, LimitCycle]], *, name: str) -> Figure:
    """Relay experiments under each other: the end in time, its closed path, and the spectrum with its peak.

    Args:
        runs: Experiment and its limit cycle by what the start was.
        name: Of the device, for the title.
    """
    title = f"{name} under a relay: the start decides which oscillation lasts"
    out, rows = panels(len(runs), 3, title=title, width=13, height=2.9)
    for (start, (experiment, cycle)), (trace, plane, spectrum) in zip(runs.items(), rows, strict=True):
        scale, unit = (1e6, "um") if np.abs(experiment.position).max() < 1e-3 else (1e3, "mm")
        period = 2 * np.pi / cycle.frequency
        late = experiment.t >= experiment.t[-1] - _CYCLES * period
        velocity = np.gradient(experiment.position, experiment.period)
        t, x = experiment.t[late], scale * experiment.position[late]
        trace.plot(t, x, color=COLORS[0], gid="position")
        force = trace.twinx()
        force.step(t, experiment.force[late], where="post", color=COLORS[1], lw=0.8, gid="force")
        force.set_ylabel("force [N]", color=COLORS[1])
        trace.set_ylabel(f"position [{unit}]", color=COLORS[0])
        trace.set_xlabel("time [s]")
        trace.set_title(f"{start}: {hertz(cycle.frequency):.3g} Hz", fontsize=9)
        plane.plot(x, scale * velocity[late], color=COLORS[0], lw=0.8, gid="path")
        plane.set_xlabel(f"position [{unit}]")
        plane.set_ylabel(f"velocity [{unit}/s]")
        plane.set_title(f"last {_CYCLES} cycles", fontsize=9)
        spectrum.loglog(hertz(1) * cycle.frequencies[1:], cycle.position_density[1:], color=COLORS[0], gid="density")
        words = f"{cycle.stiffness:.4g} N/m = {cycle.decibels:.1f} dB"
        spectrum.axvline(hertz(cycle.frequency), color=COLORS[1], ls=MARK, label=f"critical stiffness\n{words}")
        spectrum.set_xlabel("frequency [Hz]")
        spectrum.set_ylabel("position [m²/Hz]")
        spectrum.set_title("spectrum of the position", fontsize=9)
        key(spectrum, "lower left")
    return out


def two_mass_fit_figure(fit: TwoMassFit, *, name: str, experiment: str = "white noise", rotary: bool = False) -> Figure:
    """Empirical transfer function with its 95 % band, the two-mass model that fits it, and the coherence.

    Args:
        fit: From `fit_two_mass`.
        name: Of the device, for the title.
        experiment: What drove it, for the title.
        rotary: Whether the axis turns, for the units.
    """
    mass = "kg m²" if rotary else "kg"
    (high, high_error), (low, low_error) = fit.resonance, fit.anti_resonance
    title = (
        f"{name} from {experiment}\n"
        f"anti-resonance {hertz(low):.2f} ± {hertz(low_error):.1g} Hz, "
        f"resonance {hertz(high):.2f} ± {hertz(high_error):.1g} Hz\n"
        f"motor {fit.axis.motor_mass:.3g} {mass}, body {fit.axis.body_mass:.3g} {mass}, "
        f"cable {fit.axis.cable_stiffness:.4g} {stiffness_unit(rotary)}"
    )
    out, ((gain,), (phase,), (coherence,)) = panels(3, title=title, together=True, ratios=(3, 2, 2), height=2.4)
    measured, w = fit.response, fit.response.frequency
    gain.fill_between(w, *measured.interval, color=PALE, lw=0, label="95 % of the measured")
    gain.plot(w, measured.decibels, ".", color=COLORS[0], ms=2.5, label="measured", gid="measured")
    gain.plot(w, 20 * np.log10(np.abs(fit.model)), color=COLORS[1], lw=1.4, label="two-mass model", gid="model")
    # Twice between -pi and pi would jump: the measured phase is that of the model and a small rest.
    smooth = np.unwrap(np.angle(fit.model))
    smooth -= 2 * np.pi * np.round((smooth[0] + 0.75 * np.pi) / (2 * np.pi))
    apart = np.angle(measured.response / fit.model)
    phase.plot(w, np.degrees(smooth + apart), ".", color=COLORS[0], ms=2.5, gid="measured phase")
    phase.plot(w, np.degrees(smooth), color=COLORS[1], lw=1.4, gid="model phase")
    coherence.plot(w, measured.coherence, ".", color=COLORS[0], ms=2.5, gid="coherence")
    for ax in (gain, phase, coherence):
        for place in (low, high):
            ax.axvline(place, color=GREY, ls=MARK, lw=1)
    bottom, top = measured.decibels.min(), measured.decibels.max()
    gain.set_ylim(bottom - 15, top + 10)
    gain.set_ylabel("position over force [dB]")
    phase.set_ylabel("phase [°]")
    coherence.set_ylabel("coherence")
    coherence.set_ylim(0, 1.05)
    frequency_axis(gain, coherence)
    key(gain, "lower left")
    return out
