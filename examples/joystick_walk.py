"""A biped that walks as a joystick says: its zero moment point, where it may be, and what the hand feels of it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from phantom_dyn.walking.joystick import Joystick
from phantom_dyn.walking.walker import talos
from phantom_dyn.walking.walking_reference import WalkingReference, walk

CHECKOUT = Path(__file__).resolve().parents[1]
SILENT_ABOVE = 0.06

# Start, straight on, a turn to the left, straight on, stop in the middle of a step.
JOYSTICK = Joystick(
    t=np.array([0.5, 3.0, 6.0, 8.0]),
    speed=np.array([0.15, 0.15, 0.15, 0.0]),
    turn=np.array([0.0, 0.2, 0.0, 0.0]),
    walking=np.array([True, True, True, False]),
)


def figure(reference: WalkingReference) -> Figure:
    drawing = Figure(figsize=(9, 8), layout="constrained")
    ground, margin = drawing.subplots(2, 1, height_ratios=(2, 1))
    for polygon in reference.polygons:
        ground.fill(*polygon.vertices.T, facecolor="#1f77b410", edgecolor="#1f77b480", linewidth=0.8)
    ground.plot(*reference.pendulum.com.T, color="#7f7f7f", label="centre of mass")
    ground.plot(*reference.pendulum.zmp.T, color="#ff7f0e", linestyle="--", label="planned zero moment point")
    ground.plot(*reference.zmp.T, color="#d62728", linewidth=1, label="zero moment point of all bodies")
    ground.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Ground, with all support polygons")
    ground.legend(loc="upper left")
    margin.plot(reference.t, 1000 * reference.margin, color="#d62728")
    margin.axhline(0, color="black", linewidth=0.8)
    margin.set(xlabel="time [s]", ylabel="margin [mm]", xlim=(0, reference.t[-1]))
    for time in reference.joystick.t:
        margin.axvline(time, color="#7f7f7f", linestyle=":")
    hand = margin.twinx()
    hand.fill_between(
        reference.t, reference.haptic_signal(silent_above=SILENT_ABOVE), color="#2ca02c", alpha=0.3, linewidth=0
    )
    hand.set(ylabel="drive of the motor in the hand", ylim=(0, 1))
    return drawing


def main(folder: Path) -> None:
    reference = walk(talos(), JOYSTICK, duration=10.0)
    stop = reference.joystick.t[-1]
    after = reference.landings[reference.landings > stop]
    print(f"{len(reference.landings)} steps in {reference.t[-1]:.1f} s")
    print(f"turned by {np.degrees(reference.left.position[-1, 3]):.0f} degrees to the left")
    print(f"smallest margin {1000 * reference.margin.min():.1f} mm at {reference.t[reference.margin.argmin()]:.2f} s")
    print(f"stop at {stop:.1f} s, {len(after)} landings after it, the last at {after[-1]:.1f} s")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "joystick_walk.png"
    figure(reference).savefig(path, dpi=120)
    print(f"wrote {path}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else CHECKOUT / "demo" / "walking")
