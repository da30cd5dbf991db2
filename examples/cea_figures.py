"""Figures 7, 8 and 9 of the CEA paper: torques on an unseen motion, and what a hand feels about a natural posture.

Link lengths, posture and noise are not published. The posture is the one at which the published ranges hold together,
with the default lengths and 450 N m/rad at each joint.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from arguments import chosen_folder
from identify_cea import SEED
from matplotlib.figure import Figure

from identification.experiments.cea_identification import Conditions, equations, exciting_motion, identify, record
from identification.export.log_and_map_files import write_map
from phantom_dyn import load_robot
from phantom_dyn.devices.cea import MASS_RANGE_KG, STIFFNESS_RANGE, tip_position
from phantom_dyn.devices.cea_dynamics import STIFFNESS_OF_RANGES, nearest_posture
from phantom_dyn.maps.grid import read_grid
from phantom_dyn.maps.map_model import map_model
from phantom_dyn.maps.operational_map import OperationalMap, operational_map

QUANTITIES = ("apparent_mass", "stiffness", "coulomb_force", "viscous_friction")
REACH = 0.05  # m, to either side of the natural posture: a motion of a wrist
FOREARM = 2


def around_the_posture() -> OperationalMap:
    """Quantities of Figures 8 and 9 on a square of tip positions about the natural posture."""
    q, _ = nearest_posture()
    x, y, z = tip_position(q[None])[0]
    spans = (f"{name}={at - REACH:.4f}:{at + REACH:.4f}:41" for name, at in (("x", x), ("z", z)))
    model = map_model(load_robot("cea_branch"), posture=q, stiffness=np.full(3, STIFFNESS_OF_RANGES))
    return operational_map(model, read_grid(f"y={y:.4f}:{y:.4f}:1,{','.join(spans)}", model.joint_names), QUANTITIES)


def cross_test() -> Figure:
    """Figure 7: measured and estimated torque of the forearm, on a motion that the fit has not seen."""
    rng, conditions = np.random.default_rng(SEED), Conditions()
    train, test = (record(exciting_motion(conditions, rng), conditions, rng) for _ in range(2))
    found = identify(train, test, conditions)
    W, y = equations(test, conditions)
    rate = conditions.rate_hz / test.band.step
    shown = slice(0, round(20 * rate))
    t = np.arange(len(y))[shown] / rate
    out = Figure(figsize=(9, 4), layout="constrained")
    ax = out.subplots()
    ax.plot(t, y[shown, FOREARM], color="0.6", lw=2, label="measured (simulated)")
    ax.plot(t, (W @ found.fit.theta)[shown, FOREARM], color="C3", lw=1, label="estimated")
    ax.set_xlabel("time [s]")
    ax.set_ylabel("torque of q5 [N m]")
    ax.set_title(
        f"Cross test on the forearm: error {found.cross_error[FOREARM]:.1f} % of the torque; "
        f"noise of {conditions.torque_noise:g} N m assumed"
    )
    ax.legend()
    return out


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "figure_7.png"
    cross_test().savefig(path, dpi=120)
    print(f"Figure 7\nwrote {path}")
    result = around_the_posture()
    mass, stiffness = result.values["apparent_mass"], stiffnesses(result)
    print("Figures 8 and 9")
    print(f"apparent mass {np.nanmin(mass):.2f} to {np.nanmax(mass):.2f} kg, at most {MASS_RANGE_KG[1]} published")
    print(f"stiffness {stiffness.min():.0f} to {stiffness.max():.0f} N/m, ", end="")
    print(f"{STIFFNESS_RANGE[0]:g} to {STIFFNESS_RANGE[1]:g} published")
    for path in write_map(result, folder):
        print(f"wrote {path}")


def stiffnesses(result: OperationalMap) -> np.ndarray:
    """Diagonal of the stiffness [N/m] at all points, axes last."""
    return np.diagonal(result.values["stiffness"], axis1=-2, axis2=-1)


if __name__ == "__main__":
    main(chosen_folder(__doc__, "cea_figures"))
