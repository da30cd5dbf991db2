"""A biped that walks as a joystick says: its zero moment point, where it may be, and what the hand feels of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from arguments import chosen_folder

from phantom_dyn.haptics.figures import walk_figure
from phantom_dyn.walking.footsteps import Joystick
from phantom_dyn.walking.walker import talos
from phantom_dyn.walking.walking_reference import walk

SILENT_ABOVE = 0.06

# Start, straight on, a turn to the left, straight on, stop in the middle of a step.
JOYSTICK = Joystick(
    t=np.array([0.5, 3.0, 6.0, 8.0]),
    speed=np.array([0.15, 0.15, 0.15, 0.0]),
    turn=np.array([0.0, 0.2, 0.0, 0.0]),
    walking=np.array([True, True, True, False]),
)


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
    walk_figure(reference, silent_above=SILENT_ABOVE).savefig(path, dpi=120)
    print(f"wrote {path}")


if __name__ == "__main__":
    main(chosen_folder(__doc__, "walking"))
