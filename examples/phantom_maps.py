"""PHANToM 1.5: the manipulability of its published figure 3, and the mass that a hand feels at the tip."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from arguments import chosen_folder

from identification.export.log_and_map_files import write_map
from phantom_dyn import load_robot
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.operational_map import operational_map

QUANTITIES = ("manipulability", "apparent_mass", "apparent_mass_matrix", "gravity_force")

# Section through the workspace with theta1 = 0: the origin of the frame is one of the points.
SECTION = "x=0:0:1,y=-0.22:0.38:301,z=-0.2:0.2:201"


def main(folder: Path) -> None:
    model = map_model(load_robot("phantom_1_5"))
    result = operational_map(model, read_grid(SECTION, model.joint_names), QUANTITIES)
    _, y, z = result.grid.values
    manipulability = result.values["manipulability"][0]
    best = manipulability >= np.nanmax(manipulability) - 1e-9
    print(f"{result.grid.size} points, {result.unreachable} out of reach, {result.singular} singular")
    print(f"largest manipulability {np.nanmax(manipulability):.10f}, published lengths say 34/43 = {34 / 43:.10f}")
    print("reached at y, z =", ", ".join(f"({y[i]:.3f}, {z[k]:.3f})" for i, k in np.argwhere(best)))
    here = 0, int(np.argmin(np.abs(y))), int(np.argmin(np.abs(z)))
    mass = np.diag(result.values["apparent_mass_matrix"][here])
    print("apparent mass at the origin:", ", ".join(f"{1000 * m:.3f} g" for m in mass))
    print("the fits of its frequency response print 16.69, 15.96, 8.78 (kg mm/N): no unit of force makes these agree")
    for path in write_map(result, folder):
        print(f"wrote {path}")


if __name__ == "__main__":
    main(chosen_folder(__doc__, "maps"))
