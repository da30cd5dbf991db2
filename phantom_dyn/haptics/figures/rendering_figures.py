"""Draws what a hand feels over time: friction that sticks, play, a cheap axis, the stability margin of a biped."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from phantom_dyn.array_types import Array, Float
from phantom_dyn.haptics.cheap.cheap_axis import CheapAxis
from phantom_dyn.haptics.cheap.cheap_hardware import Rendered
from phantom_dyn.haptics.figures.canvas import COLORS, GREY, IDEAL, MARK, beside, key, panels, shade
from phantom_dyn.walking.stairs import StairReference
from phantom_dyn.walking.walking_reference import WalkingReference


def sticking_figure(t: Float[Array, " N"], x: Float[Array, " N"], rendered: Rendered, axis: CheapAxis) -> Figure:
    """Friction that sticks, as in Figure 8 of Brouwer and MacLean: position of the probe and force of the friction.

    Args:
        t: Times [s], shape ``(N,)``.
        x: Positions of the probe [m], shape ``(N,)``.
        rendered: Rendered signals.
        axis: The cheap axis, whose friction levels are drawn.
    """
    title = "Friction that sticks: it drops, grows while the hand creeps, turns with it, and slips again"
    figure, ((place,), (force,), (speed,)) = panels(3, title=title, together=True, height=2.2, width=10)
    place.plot(t, 1e3 * x, color=COLORS[0], gid="position")
    force.plot(t, rendered.force, color=COLORS[1], gid="force")
    speed.plot(t, 1e3 * rendered.velocity, color=COLORS[0], gid="velocity")
    if axis.friction is not None:
        slip, static = axis.friction.torque, axis.friction.torque * axis.friction.static_ratio
        for sign in (-1, 1):
            force.axhline(sign * slip, color="black", ls=MARK, lw=1.2, label="in slip" if sign > 0 else None)
            force.axhline(sign * static, color=COLORS[2], ls=MARK, lw=1.2, label="breaks loose" if sign > 0 else None)
            level = 1e3 * sign * axis.friction.stick_velocity
            speed.axhline(level, color=GREY, ls=MARK, lw=1.2, label="sticks below" if sign > 0 else None)
    for ax in (place, force, speed):
        shade(ax, t, rendered.stuck, "stuck")
    speed.set_ylim(*(4 * np.array([-1, 1]) * max(5.0, 1e3 * (axis.friction.stick_velocity if axis.friction else 0.0))))
    place.set_ylabel("probe [mm]")
    force.set_ylabel("friction on\nthe hand [N]")
    speed.set_ylabel("velocity, filtered\n[mm/s]")
    speed.set_xlabel("time [s]")
    for ax in (force, speed):
        beside(ax)
    return figure


def backlash_figure(t: Float[Array, " N"], x: Float[Array, " N"], rendered: Rendered, axis: CheapAxis) -> Figure:
    """Backlash, as in Figure 9 of Brouwer and MacLean: the probe relative to the gap in the virtual mass.

    Args:
        t: Times [s], shape ``(N,)``.
        x: Positions of the probe [m], shape ``(N,)``.
        rendered: Rendered signals.
        axis: The cheap axis, whose gap is drawn.
    """
    mass = "" if axis.mass is None else f", mass {axis.mass.inertia:g} kg on {axis.mass.stiffness:g} N/m"
    title = f"Play of {1e3 * axis.gap:g} mm: the mass drifts from wall to wall{mass}"
    figure, ((place,), (apart,), (force,)) = panels(3, title=title, together=True, height=2.2, width=10)
    place.plot(t, 1e3 * x, color=COLORS[0], label="probe", gid="probe")
    place.plot(t, 1e3 * rendered.mass_position, color=COLORS[1], label="virtual mass", gid="mass")
    apart.plot(t, 1e3 * (x - rendered.mass_position), color=COLORS[2], gid="apart")
    for sign in (-1, 1):
        apart.axhline(1e3 * sign * axis.gap / 2, color=GREY, ls=MARK, lw=1.2, label="wall" if sign > 0 else None)
    force.plot(t, rendered.coupling, color=COLORS[1], lw=0.9, label="of the coupling", gid="coupling")
    force.plot(t, rendered.force, color=COLORS[0], label="on the hand, averaged", gid="force")
    for ax in (place, apart, force):
        shade(ax, t, rendered.contact, "contact")
    place.set_ylabel("position [mm]")
    apart.set_ylabel("probe less\nmass [mm]")
    force.set_ylabel("force [N]")
    force.set_xlabel("time [s]")
    for ax in (place, apart, force):
        beside(ax)
    return figure


def cheap_axis_figure(
    t: Float[Array, " N"], x: Float[Array, " N"], asked: Float[Array, " N"], rendered: Rendered, axis: CheapAxis
) -> Figure:
    """All defects of a cheap axis together: force that the virtual environment commands, and force on the hand.

    Args:
        t: Times [s], shape ``(N,)``.
        x: Positions of the probe [m], shape ``(N,)``.
        asked: Commanded force [N], shape ``(N,)``.
        rendered: Rendered signals.
        axis: The cheap axis.
    """
    parts = {
        "mass": axis.mass,
        f"play {1e3 * axis.gap:g} mm": axis.gap,
        "friction": axis.friction,
        "cogging": axis.cogging,
        f"motor of {axis.limit:g} N": np.isfinite(axis.limit),
    }
    title = f"A cheap axis ({', '.join(name for name, present in parts.items() if present)}): asked for and felt"
    figure, ((place,), (force,), (step,)) = panels(
        3, title=title, together=True, ratios=(2, 3, 1.5), height=2.3, width=10
    )
    place.plot(t, 1e3 * x, color=COLORS[0], label="probe", gid="probe")
    place.plot(t, 1e3 * rendered.mass_position, color=COLORS[1], label="virtual mass", gid="mass")
    force.plot(t, asked, color="black", lw=1, label="asked for", gid="asked")
    force.plot(t, rendered.force, color=COLORS[1], lw=0.9, label="felt", gid="felt")
    step.plot(t[1:], 1 / np.diff(t), ".", ms=1.5, color=COLORS[0], gid="rate")
    for ax in (place, force):
        shade(ax, t, rendered.contact, "contact")
        beside(ax)
    place.set_ylabel("position [mm]")
    force.set_ylabel("force [N]")
    step.set_ylabel("sampling [Hz]")
    step.set_xlabel("time [s]")
    return figure


def walk_figure(reference: WalkingReference, *, silent_above: float) -> Figure:
    """Zero moment point in the support polygons, its margin, and the signal by which the hand feels the margin.

    Args:
        reference: The walk.
        silent_above: Margin at and above which the hand feels nothing [m].
    """
    least = 1e3 * reference.margin.min()
    title = f"Biped on a joystick: the zero moment point keeps {least:.0f} mm or more inside the support polygon"
    drawing, ((ground,), (margin,)) = panels(2, title=title, width=9, height=3.2, ratios=(1.5, 1))
    for k, polygon in enumerate(reference.polygons):
        label = "support polygons" if k == 0 else None
        ground.fill(*polygon.vertices.T, facecolor="#0072B210", edgecolor="#0072B270", linewidth=0.8, label=label)
    ground.plot(*reference.pendulum.com.T, color=GREY, label="centre of mass", gid="com")
    ground.plot(*reference.pendulum.zmp.T, color=COLORS[4], ls=IDEAL, label="planned zero moment point", gid="plan")
    ground.plot(*reference.zmp.T, color=COLORS[1], lw=1, label="zero moment point of all bodies", gid="zmp")
    ground.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    key(ground, "upper left")
    margin.plot(reference.t, 1e3 * reference.margin, color=COLORS[1], gid="margin")
    margin.axhline(0, color="black", lw=0.8)
    margin.set(xlabel="time [s]", xlim=(0, reference.t[-1]))
    margin.set_ylabel("margin [mm]", color=COLORS[1])
    for k, time in enumerate(reference.joystick.t):
        margin.axvline(time, color=GREY, ls=MARK, label="joystick moves" if k == 0 else None)
    hand = margin.twinx()
    felt = reference.haptic_signal(silent_above=silent_above)
    hand.fill_between(reference.t, felt, color=COLORS[2], alpha=0.3, lw=0)
    hand.set_ylabel("drive of the motor\nin the hand [-]", color=COLORS[2])
    hand.set_ylim(0, 1)
    margin.set_ylim(top=1.35e3 * reference.margin.max())  # room for the legend
    key(margin, "upper left")
    return drawing


def stairs_figure(reference: StairReference) -> Figure:
    """A walk over stairs from the side, and the margin of its zero moment point.

    Args:
        reference: The walk.
    """
    stairs = reference.stairs
    way = "up" if stairs.rise >= 0 else "down"
    title = (
        f"Biped {way} stairs of {1e3 * stairs.tread:g} mm by {1e3 * abs(stairs.rise):g} mm\n"
        f"the zero moment point keeps {1e3 * reference.margin.min():.0f} mm or more inside the support polygon"
    )
    drawing, ((side,), (margin,)) = panels(2, title=title, width=9, height=3.2, ratios=(1.7, 1))
    begin, end = (float(place) for place in reference.com.position[[0, -1], 0])
    x = np.linspace(begin - 0.5 * stairs.tread, end + 0.5 * stairs.tread, 2000)
    side.plot(x, stairs.height(x), color="black", lw=1.2, label="stairs", gid="stairs")
    for foot, color, words in ((reference.left, COLORS[0], "left sole"), (reference.right, COLORS[2], "right sole")):
        side.plot(foot.position[:, 0], foot.position[:, 2], color=color, label=words, gid=words)
    side.plot(*reference.com.position[:, [0, 2]].T, color=GREY, label="centre of mass", gid="com")
    side.plot(x, stairs.slope * x, color=COLORS[4], ls=IDEAL, label="slope of the footholds")
    side.plot(*reference.zmp[:, [0, 2]].T, color=COLORS[1], lw=1, label="zero moment point", gid="zmp")
    side.set(xlabel="x [m]", ylabel="z [m]")
    beside(side)
    margin.plot(reference.t, 1e3 * reference.margin, color=COLORS[1], gid="margin")
    margin.axhline(0, color="black", lw=0.8)
    margin.set(xlabel="time [s]", ylabel="margin [mm]", xlim=(0, reference.t[-1]))
    return drawing
