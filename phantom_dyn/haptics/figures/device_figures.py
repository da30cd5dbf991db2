"""A device's electronics: links that lose samples, sinusoidal encoders, brushes, and the safety logic of a driver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from phantom_dyn.array_types import Array, Float
from phantom_dyn.haptics.device.commutation import BrushMotor, steady_torque
from phantom_dyn.haptics.device.safety import Guard, GuardTrace
from phantom_dyn.haptics.figures.canvas import COLORS, GREY, IDEAL, MARK, MARKERS, beside, panels, shade
from phantom_dyn.haptics.sensing.sinusoidal_encoder import SinusoidalEncoder
from phantom_dyn.haptics.stability.force_link import NoiseFelt


def lossy_link_figure(
    loss: Float[Array, " k"],
    limits: Mapping[str, Sequence[float]],
    felt: Mapping[str, Sequence[NoiseFelt]],
    *,
    name: str,
) -> Figure:
    """Largest stable force gain over the share of lost samples, and what the sensor's noise does to motor and hand.

    Args:
        loss: Share of samples that are lost, shape ``(k,)``.
        limits: Of `critical_feedforward_of_link`, as many, by what the device is.
        felt: Of `noise_felt`, as many, by what the gain is.
        name: Of the device and its noise, for the title.
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
    """Errors of position within a line of sinusoidal encoders, and the ripple on the velocity that they leave.

    Args:
        encoders: By what is wrong with the signals; of one pitch.
        speed: At which the ripple is drawn [m/s].
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
    """Torque of a brush motor under a held voltage over the turning of its rotor, beside that of a held current.

    Args:
        motor: With brushes.
        voltage: [V].
        speeds: Of the rotor, above 0 [rad/s].
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
    """What a driver lets through of the commands, and the warming of its motor.

    Args:
        guard: Its limits.
        dt: Length of a cycle [s].
        asked: Commands, NaN where none came [N], shape ``(N,)``.
        trace: Of `run_guard`.
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
