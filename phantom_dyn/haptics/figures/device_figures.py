"""Draws figures of a haptic device: lossy links, encoders, brushes, velocity estimators, heat, safety, experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from phantom_dyn.array_types import Array, Float
from phantom_dyn.haptics.device.drives import (
    PUBLISHED_RISE_LINEAR,
    PUBLISHED_RISE_PULSES,
    BrushMotor,
    SwitchedCurrent,
    Warming,
    steady_torque,
)
from phantom_dyn.haptics.device.safety import Guard, GuardTrace
from phantom_dyn.haptics.experiments.frequency_response import TwoMassFit
from phantom_dyn.haptics.experiments.relay import LimitCycle, RelayExperiment
from phantom_dyn.haptics.figures.canvas import (
    COLORS,
    GREY,
    IDEAL,
    MARK,
    MARKERS,
    PALE,
    beside,
    frequency_axis,
    hertz,
    key,
    panels,
    shade,
)
from phantom_dyn.haptics.sensing.encoder import SinusoidalEncoder
from phantom_dyn.haptics.sensing.loop_simulation import LoopTrace
from phantom_dyn.haptics.sensing.velocity_comparison import EstimatorFigures
from phantom_dyn.haptics.stability.force_link import NoiseFelt


def lossy_link_figure(
    loss: Float[Array, " k"],
    limits: Mapping[str, Sequence[float]],
    felt: Mapping[str, Sequence[NoiseFelt]],
    *,
    name: str,
) -> Figure:
    """Largest stable force gain over the share of lost samples; motor force and hand motion due to sensor noise.

    Args:
        loss: Share of samples that are lost, shape ``(k,)``.
        limits: Results of `critical_feedforward_of_link`, one for each loss; keys are names of devices.
        felt: Results of `noise_felt`, one for each loss; keys are names of gains.
        name: Names of device and noise for the title.
    """
    title = f"{name}: force feedforward over a link that loses samples"
    out, ((gain,), (motor,), (hand,)) = panels(3, title=title, together=True, height=2.3)
    for k, (words, values) in enumerate(limits.items()):
        gain.semilogy(100 * loss, values, color=COLORS[k], marker=MARKERS[k], ms=4, label=words, gid=words)
    for k, (words, values) in enumerate(felt.items()):
        look = {"color": COLORS[k + len(limits)], "marker": MARKERS[k + len(limits)], "ms": 4, "label": words}
        motor.plot(100 * loss, [one.motor_force for one in values], **look, gid=words)
        hand.plot(100 * loss, [1e3 * one.tip for one in values], **look)
    gain.yaxis.set_major_formatter("{x:g}")
    gain.yaxis.set_minor_formatter("{x:g}")
    gain.set_ylabel("largest stable\nforce gain")
    motor.set_ylabel("motor force from\nnoise, RMS [N]")
    hand.set_ylabel("motion of the hand\nfrom noise, RMS [mm]")
    hand.set_xlabel("samples lost [%]")
    for ax in (gain, motor):
        beside(ax)
    return out


def sinusoidal_encoder_figure(encoders: Mapping[str, SinusoidalEncoder], *, speed: float) -> Figure:
    """Errors of position within a line of sinusoidal encoders, and the ripple of velocity that they cause.

    Args:
        encoders: Encoders with the same pitch; keys are names of their signal errors.
        speed: Speed at which the ripple is drawn [m/s].
    """
    pitch = next(iter(encoders.values())).pitch
    x = pitch * np.linspace(0.0, 2.0, 2001)
    title = f"Sinusoidal encoder, {1e6 * pitch:g} um per line: signal errors repeat themselves with the line"
    out, ((place,), (ripple,)) = panels(2, title=title, together=True, height=2.6, width=10)
    for k, (words, encoder) in enumerate(encoders.items()):
        error = encoder.interpolated(x) - x
        color = COLORS[k % len(COLORS)]
        place.plot(1e6 * x, 1e6 * error, color=color, label=words, gid=words)
        ripple.plot(1e6 * x, 1e3 * speed * np.gradient(error, x), color=color)
    steps = {encoder.step for encoder in encoders.values()}
    for sign in (-1, 1):
        for step in steps:
            label = f"half a step of {1e6 * step:.2g} um" if sign > 0 else None
            place.axhline(0.5e6 * sign * step, color=GREY, ls=MARK, lw=1.2, label=label)
    place.set_ylabel("error of position [um]")
    ripple.set_ylabel(f"error of velocity\nat {1e3 * speed:g} mm/s [mm/s]")
    ripple.set_xlabel("position [um]")
    beside(place)
    return out


def commutation_figure(motor: BrushMotor, *, voltage: float, speeds: Sequence[float]) -> Figure:
    """Torque of a brush motor over the angle of its rotor, under a constant voltage and under a constant current.

    Args:
        motor: The motor.
        voltage: Voltage at the motor [V].
        speeds: Speeds of the rotor, above 0 [rad/s].
    """
    title = f"Brushes of a motor with {motor.bars} bars: a voltage amplifier lets the torque follow their switching"
    out, ((torque,),) = panels(1, title=title, height=3.4)
    for k, speed in enumerate(speeds):
        found = steady_torque(motor, speed=speed, voltage=voltage)
        turn = np.concatenate([found.angle, found.angle + motor.period])
        values = 1e3 * np.tile(found.torque, 2)
        color, words = COLORS[k % len(COLORS)], f"voltage, {speed:g} rad/s: {100 * found.ripple:.1f} % of the mean"
        torque.plot(turn, values, color=color, label=words, gid=f"{speed:g}")
        label = "current of the same mean" if k == 0 else None
        torque.axhline(1e3 * found.mean, color=color, ls=IDEAL, lw=1, label=label)
    torque.set_xlabel("angle of the rotor [rad]")
    torque.set_ylabel("torque [mN m]")
    beside(torque)
    return out


def safety_figure(guard: Guard, dt: float, asked: Float[Array, " N"], trace: GuardTrace) -> Figure:
    """Output forces of a driver with safety logic, and the temperature of its motor.

    Args:
        guard: Limits of the driver.
        dt: Length of a cycle [s].
        asked: Commands [N], NaN if none came, shape ``(N,)``.
        trace: Result of `run_guard`.
    """
    t = dt * np.arange(len(asked))
    title = f"Safety logic: off above {guard.warmest:g} K until {guard.cool:g} K, and below {guard.slowest:g} updates/s"
    out, ((force,), (rise,)) = panels(2, title=title, together=True, height=2.4, width=10)
    force.plot(t, asked, ".", ms=4, color=COLORS[1], label="asked for", gid="asked")
    force.step(t, trace.force, where="post", color=COLORS[0], label="let through", gid="force")
    rise.plot(t + dt, trace.rise, color=COLORS[0], gid="rise")
    for level, words in ((guard.warmest, "goes off"), (guard.cool, "may come back")):
        rise.axhline(level, color=COLORS[1] if level == guard.warmest else COLORS[2], ls=MARK, label=words)
    for ax in (force, rise):
        shade(ax, t, trace.hot | trace.late, "off")
        beside(ax)
    force.set_ylabel("force [N]")
    rise.set_ylabel("rise of the motor [K]")
    rise.set_xlabel("time [s]")
    return out


# Durations at the end of the accelerated and of the steady motion that the traces show [s].
_SHOWN, _SHOWN_STEADY = 0.1, 0.04
# Time after which the published rises of the casing were measured [s].
_PUBLISHED_AFTER = 600.0


def loop_traces_figure(traces: Mapping[str, LoopTrace], *, title: str) -> Figure:
    """Positions and commanded forces of loops over time, one row each: a wall, a damper or two coupled devices.

    Args:
        traces: Loops; keys are names of their settings, such as the gain.
        title: Title of the figure.
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
    """Lag and granularity of velocity estimators, and their estimates of an accelerated and of a steady motion.

    Args:
        estimators: Results of `estimator_figures` for one motion, at most seven; keys are names of estimators.
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
    tail, end = first.t >= first.t[-1] - _SHOWN, first.t >= first.t[-1] - _SHOWN_STEADY
    fast.plot(first.t[tail], 1e3 * first.velocity[tail], color="black", lw=1, label="true", zorder=3)
    steady.axhline(1e3 * first.velocity[0], color="black", lw=1, label="true", zorder=3)
    coarsest = max(one.granularity for one in found)
    for k, (name, one) in enumerate(estimators.items()):
        # The coarsest estimate would fill the panels with vertical lines; its bar shows its granularity.
        if one.granularity == coarsest and len(found) > 1:
            continue
        look = {"color": COLORS[k], "lw": 1.3, "label": name, "drawstyle": "steps-post", "zorder": 2}
        fast.plot(one.t[tail], 1e3 * one.estimate[tail], **look)
        steady.plot(one.t[end], 1e3 * one.steady_estimate[end], **look)
    fast.set_title("constant acceleration", fontsize=9)
    steady.set_title("constant speed", fontsize=9)
    for ax in (fast, steady):
        ax.set_xlabel("time [s]")
        ax.set_ylabel("velocity [mm/s]")
    # The limits of the panels follow from the largest error by lag, or from the steps of the second coarsest estimator,
    # because the coarsest one is not drawn.
    late_by = max(abs(one.lag) for one in found) * (first.velocity[-1] - first.velocity[0]) / first.t[-1]
    reach = 1.6e3 * max(abs(late_by), sorted(one.granularity for one in found)[-2:][0])
    low, high = np.sort(1e3 * first.velocity[tail][[0, -1]])
    fast.set_ylim(low - reach, high + reach)
    steady.set_ylim(1e3 * first.velocity[0] - reach, 1e3 * first.velocity[0] + reach)
    out.legend(*steady.get_legend_handles_labels(), loc="outside lower center", ncols=len(found), fontsize=8)
    return out


def drive_heat_figure(switched: Mapping[str, SwitchedCurrent], warm: Warming) -> Figure:
    """Current of a motor under pulses, its heat under pulses and under a linear drive, and its temperature rise.

    Args:
        switched: Steady currents at one duty cycle; keys are names of windings.
        warm: Temperature rise under both drives, drawn with the published rises after ten minutes.
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


# Number of cycles of the oscillation in a time trace and a phase plane.
_CYCLES = 5


def limit_cycles_figure(runs: Mapping[str, tuple[RelayExperiment, LimitCycle]], *, name: str) -> Figure:
    """Relay experiments, one row each: the last cycles over time and in the phase plane, and the spectrum.

    Args:
        runs: Experiments and their limit cycles; keys are names of the starts.
        name: Name of the device, for the title.
    """
    title = f"{name} under a relay: the start decides which oscillation lasts"
    out, rows = panels(len(runs), 3, title=title, width=13, height=2.9)
    for (start, (experiment, cycle)), (trace, plane, spectrum) in zip(runs.items(), rows, strict=True):
        scale, unit = (1e6, "um") if np.abs(experiment.position).max() < 1e-3 else (1e3, "mm")
        period = 2 * np.pi / cycle.frequency
        tail = experiment.t >= experiment.t[-1] - _CYCLES * period
        velocity = np.gradient(experiment.position, experiment.period)
        t, x = experiment.t[tail], scale * experiment.position[tail]
        trace.plot(t, x, color=COLORS[0], gid="position")
        force = trace.twinx()
        force.step(t, experiment.force[tail], where="post", color=COLORS[1], lw=0.8, gid="force")
        force.set_ylabel("force [N]", color=COLORS[1])
        trace.set_ylabel(f"position [{unit}]", color=COLORS[0])
        trace.set_xlabel("time [s]")
        trace.set_title(f"{start}: {hertz(cycle.frequency):.3g} Hz", fontsize=9)
        plane.plot(x, scale * velocity[tail], color=COLORS[0], lw=0.8, gid="path")
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
        fit: Result of `fit_two_mass`.
        name: Name of the device, for the title.
        experiment: Name of the experiment, for the title.
        rotary: True if the axis is rotary, which changes the units.
    """
    mass, stiffness = ("kg m²", "N m/rad") if rotary else ("kg", "N/m")
    (high, high_error), (low, low_error) = fit.resonance, fit.anti_resonance
    title = (
        f"{name} from {experiment}\n"
        f"anti-resonance {hertz(low):.2f} ± {hertz(low_error):.1g} Hz, "
        f"resonance {hertz(high):.2f} ± {hertz(high_error):.1g} Hz\n"
        f"motor {fit.axis.motor_mass:.3g} {mass}, body {fit.axis.body_mass:.3g} {mass}, "
        f"cable {fit.axis.cable_stiffness:.4g} {stiffness}"
    )
    out, ((gain,), (phase,), (coherence,)) = panels(3, title=title, together=True, ratios=(3, 2, 2), height=2.4)
    measured, w = fit.response, fit.response.frequency
    gain.fill_between(w, *measured.interval, color=PALE, lw=0, label="95 % of the measured")
    gain.plot(w, measured.decibels, ".", color=COLORS[0], ms=2.5, label="measured", gid="measured")
    gain.plot(w, 20 * np.log10(np.abs(fit.model)), color=COLORS[1], lw=1.4, label="two-mass model", gid="model")
    # The measured phase alone would jump between -pi and pi; it is drawn as phase of the model plus the difference.
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
