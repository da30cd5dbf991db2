"""EMPS in the measures that its authors publish, beside ours: ``python examples/side_by_side.py``.

Relative errors are those of least squares on the whole recording. Simulation errors are those of the closed loop: the
axis moves as a model says, and the published controller, which runs at 1 kHz and saturates at 10 V, follows the
recorded reference. Published: A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS, Workshop on
Nonlinear System Identification Benchmarks, 2019.
"""

from __future__ import annotations

import sys

import numpy as np
from emps_log import PUBLISHED
from scipy.io import loadmat

from identification.data import datasets
from identification.data.recording import Recording
from identification.data.signals import process
from identification.estimators.weighted_least_squares import ols
from identification.regression.regressor import torque_regressor
from phantom_dyn import load_robot
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.errors import LogError

MASS, DIRECTIONAL = 95.1540, "direction_dependent_friction"
NAMES = ("torque_positive", "torque_negative", "coefficient_positive", "coefficient_negative")
SYMMETRIC = ("viscous_friction", "coulomb_friction", "torque_offset")
PUBLISHED_ERRORS = {"symmetric": 4.0834, "directional": 3.1117, "position": 0.0138, "force": 5.85}
PERIOD, SUBSTEPS, LARGEST_VOLTAGE = 1e-3, 10, 10.0


def simulated(data: dict, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions [m] and drive forces [N] of the closed loop.

    Args:
        data: The recording.
        theta: Mass [kg], Coulomb friction forwards and backwards [N], viscous friction forwards and backwards [N s/m].
    """
    mass, forwards, backwards, damped_forwards, damped_backwards = theta
    reference, gain, kp, kv = data["qg"], float(data["gtau"]), 160.18, 243.45
    q = before = mean_before = float(data["qm"][0])
    v, step = 0.0, PERIOD / SUBSTEPS
    positions, forces = np.empty(len(reference)), np.empty(len(reference))
    for k, wanted in enumerate(reference):
        # The controller takes the speed from means of two samples.
        mean = 0.5 * (q + before)
        voltage = kp * kv * (wanted - q) - kv * (mean - mean_before) / PERIOD
        force = gain * float(np.clip(voltage, -LARGEST_VOLTAGE, LARGEST_VOLTAGE))
        positions[k], forces[k], before, mean_before = q, force, q, mean
        for _ in range(SUBSTEPS):
            if v == 0.0 and -backwards < force < forwards:
                continue
            ahead = v > 0.0 or (v == 0.0 and force > 0.0)
            friction = forwards + damped_forwards * v if ahead else -backwards + damped_backwards * v
            after = v + step * (force - friction) / mass
            v = after if v * after >= 0.0 else 0.0
            q += step * v
    return positions, forces


def main() -> None:
    data = loadmat(datasets.fetch("emps") / "DATA_EMPS.mat", squeeze_me=True)
    robot, force = load_robot("emps"), data["gtau"] * data["vir"]
    recording = Recording("emps", robot.joint_names, data["t"], data["qm"][:, None], force[:, None])
    log = process(recording, robot)
    fits = {
        "symmetric": ols(torque_regressor(robot, log, [(effect_named(name), "axis") for name in SYMMETRIC])),
        "directional": ols(torque_regressor(robot, log, [(effect_named(DIRECTIONAL), "axis")])),
    }
    published = np.array([MASS, *(PUBLISHED[DIRECTIONAL, name] for name in NAMES)])
    rows: list[tuple[str, ...]] = [
        (f"relative error, {name} friction", f"{PUBLISHED_ERRORS[name]:.2f} %", "", f"{fit.relative_error[0]:.2f} %")
        for name, fit in fits.items()
    ]
    errors = [
        [100 * np.linalg.norm(a - b) / np.linalg.norm(b) for a, b in zip(run, (data["qm"], force), strict=True)]
        for run in (simulated(data, published), simulated(data, fits["directional"].theta))
    ]
    for k, name in enumerate(("position", "force")):
        own = [f"{error[k]:.2g} %" for error in errors]
        rows.append((f"error of the simulated {name}", f"{PUBLISHED_ERRORS[name]:g} %", *own))
    print("| EMPS | published | their numbers in our simulation | ours |\n|---|---|---|---|")
    for row in rows:
        print(f"| {' | '.join(row)} |")


if __name__ == "__main__":
    try:
        main()
    except LogError as error:
        sys.exit(str(error))
