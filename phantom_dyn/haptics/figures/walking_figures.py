"""A biped that walks as a joystick says: ground, support polygons, margin and what the hand feels of it."""

from __future__ import annotations

from matplotlib.figure import Figure

from phantom_dyn.haptics.figures.canvas import COLORS, GREY, key, panels
from phantom_dyn.walking.walking_reference import WalkingReference


def walk_figure(reference: WalkingReference, *, silent_above: float) -> Figure:
    """Zero moment point in the support polygons, and its margin as the hand feels it.

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
    ground.plot(*reference.pendulum.zmp.T, color=COLORS[4], ls="--", label="planned zero moment point", gid="plan")
    ground.plot(*reference.zmp.T, color=COLORS[1], lw=1, label="zero moment point of all bodies", gid="zmp")
    ground.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    key(ground, "upper left")
    margin.plot(reference.t, 1e3 * reference.margin, color=COLORS[1], gid="margin")
    margin.axhline(0, color="black", lw=0.8)
    margin.set(xlabel="time [s]", xlim=(0, reference.t[-1]))
    margin.set_ylabel("margin [mm]", color=COLORS[1])
    for k, time in enumerate(reference.joystick.t):
        margin.axvline(time, color=GREY, ls=":", label="joystick moves" if k == 0 else None)
    hand = margin.twinx()
    felt = reference.haptic_signal(silent_above=silent_above)
    hand.fill_between(reference.t, felt, color=COLORS[2], alpha=0.3, lw=0)
    hand.set_ylabel("drive of the motor\nin the hand [-]", color=COLORS[2])
    hand.set_ylim(0, 1)
    key(margin, "center left")
    return drawing
