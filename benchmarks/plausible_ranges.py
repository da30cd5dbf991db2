# pyright: reportAttributeAccessIssue=false
"""Print mass per length and centre of mass of links of public robot models, and the friction that their files state.

    python -m benchmarks.plausible_ranges

The models are those of ``example-robot-data`` that can be loaded. A link counts if another joint is at least 5 cm away
from its own. Output: quantiles over all links, and the friction values of each model's joints.
"""

from __future__ import annotations

import numpy as np

from phantom_dyn import load_robot
from phantom_dyn.errors import PhantomDynError
from phantom_dyn.model.robot import Robot

MODELS = ("ur5", "ur10", "panda", "kinova", "baxter", "romeo", "solo12", "double_pendulum", "z1")
SHORTEST = 0.05  # shortest link [m]
QUANTILES = (0, 5, 50, 95, 100)


def links_of(robot: Robot) -> list[tuple[float, float]]:
    """Mass per length [kg/m] of each link, and distance of its centre from the joint divided by the length."""
    model, out = robot.model, []
    for joint in range(1, model.njoints):
        ends = [float(np.linalg.norm(model.jointPlacements[child].translation)) for child in model.children[joint]]
        length, own = max(ends, default=0.0), model.inertias[joint]
        if length >= SHORTEST and own.mass > 0:
            out.append((own.mass / length, float(np.linalg.norm(own.lever)) / length))
    return out


def main() -> None:
    """Print the quantiles and the friction of each model."""
    links: list[tuple[float, float]] = []
    for name in MODELS:
        try:
            robot = load_robot(f"example:{name}")
        except PhantomDynError as error:
            print(f"{name}: {error}")
            continue
        links += links_of(robot)
        stated = [sorted(set(np.round(x, 4).tolist())) for x in (robot.coulomb_friction, robot.viscous_friction)]
        print(f"{name}: {robot.nv} joints, Coulomb friction {stated[0]}, viscous friction {stated[1]}")
    weights, levers = (np.percentile(x, QUANTILES) for x in np.array(links).T)
    print(f"{len(links)} links; quantiles {QUANTILES} %")
    print(f"mass per length [kg/m]: {np.round(weights, 2).tolist()}")
    print(f"centre over length: {np.round(levers, 2).tolist()}")


if __name__ == "__main__":
    main()
