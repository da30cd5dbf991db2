"""Writes public recordings of hobby servos and of a brushless motor as logs: ``python examples/real_logs.py [FOLDER]``.

The recordings hold several runs in one file, or a servo's raw registers. A log is one run with one array per column.
What stays as the recording has it (counts, amperes) is mapped by the ``columns.yaml`` beside the robot file.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from arguments import chosen_folder

from identification.data import datasets
from phantom_dyn.errors import LogError

Array = np.ndarray

# Runs without anti-cogging at two speeds; the first two begin with a fast turn back, which shows the rotor's inertia.
ODRIVE_RUNS = ("slow2_nocomp_1", "slow2_nocomp_2", "slow2_slower_nocomp_0")
# Two of four trajectories, at both gains: in the others the servo stands still for more than half of the run, which
# `phantom-dyn check` says should be left out, or falls without drive.
XL330_TRAJECTORIES = ("sin_sin", "sin_time_square")
XL330_FULL_SCALE = 885  # of the load register, the duty cycle of the bridge
STS3215_COUNTS = 4096  # a turn
STS3215_BAND = 0.225 * 9.81  # N at the end of the lever: 0.15 to 0.3 kgf are published
_TESTED, _PULLS_UP, _PULLS_DOWN = 5, 4, 3  # numbers of the servos: 4 pulls towards larger positions, 3 to smaller ones

# The gripper is left out: the recording has it from 0 to 1 and not as an angle.
SO101_JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")


def _written(path: Path, columns: Mapping[str, Array]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, allow_pickle=False, **{name: np.asarray(values, dtype=float) for name, values in columns.items()})
    return path


def write_xl330_logs(folder: Path) -> tuple[Path, ...]:
    """One NPZ a run of the servo with its pendulum: position and the motor's voltage, four runs that keep moving.

    The voltage is the duty cycle times the supply as measured. The servo's own speed lags its position by 20 ms and is
    left out: the speed that turns voltage into torque is then the position's.

    Raises:
        LogError: If the recording cannot be had; says how to get it.
    """
    folder_of_runs = datasets.fetch("bam_xl330")
    facts = json.loads((folder_of_runs / "runs.json").read_text())
    paths = []
    with np.load(folder_of_runs / "bam_xl330.npz") as runs:
        for run in sorted(name for name in facts if facts[name]["trajectory"] in XL330_TRAJECTORIES):
            columns = {
                "t": runs[f"{run}__timestamp"],
                "q.servo": runs[f"{run}__position"],
                "u.servo": runs[f"{run}__load"] / XL330_FULL_SCALE * runs[f"{run}__input_volts"],
            }
            paths.append(_written(folder / f"{run}.npz", columns))
    return tuple(paths)


def write_odrive_logs(folder: Path) -> tuple[Path, ...]:
    """One NPZ a slow run of the motor without anti-cogging, as recorded: counts and amperes.

    Raises:
        LogError: If the recording cannot be had; says how to get it.
    """
    with np.load(datasets.fetch("odrive_cogging") / "slow_and_pull.npz") as runs:
        return tuple(
            _written(folder / f"{run}.npz", {name: runs[f"{run}__{name}"] for name in ("t", "pos_counts", "iq_A")})
            for run in ODRIVE_RUNS
        )


def write_sts3215_log(folder: Path) -> tuple[Path, ...]:
    """The stand with one STS3215 as one NPZ: position and target in counts, and the force of the bands on its lever.

    The bands' force is not measured. It is taken in proportion to the travel of the servo that stretches them, with the
    middle of the published range at full travel. The load register is left out: it is the duty cycle of the bridge,
    which the servo computes from its own error, so that it says nothing that the error does not.

    Raises:
        LogError: If the recording cannot be had; says how to get it.
    """
    with (datasets.fetch("robonine_backlash") / "single.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))

    def register(name: str) -> Array:
        return np.array([float(row[name]) for row in rows])

    def stretched(number: int) -> Array:
        position, target = register(f"pos ({number})"), register(f"target pos ({number})")
        slack, tight = target[0], target[np.argmax(np.abs(target - target[0]))]
        return np.clip((position - slack) / (tight - slack), 0.0, 1.0)

    angle = register(f"pos ({_TESTED})") * 2 * np.pi / STS3215_COUNTS
    force = STS3215_BAND * (stretched(_PULLS_UP) - stretched(_PULLS_DOWN))
    columns = {
        "t": register("t_s"),
        "position": register(f"pos ({_TESTED})"),
        "target": register(f"target pos ({_TESTED})"),
        "f.tip.x": -force * np.sin(angle),
        "f.tip.y": force * np.cos(angle),
        "f.tip.z": np.zeros(len(force)),
    }
    return (_written(folder / "single.npz", columns),)


def write_so101_logs(folder: Path) -> tuple[Path, ...]:
    """One NPZ a motion of the arm: positions and commands under the joint names of its URDF, without the gripper.

    The zero positions are the recording's; its torques have no sign and are left out.

    Raises:
        LogError: If the recording cannot be had; says how to get it.
    """
    paths = []
    with np.load(datasets.fetch("sage_so101") / "so101.npz") as runs:
        for run in sorted({key.partition("__")[0] for key in runs}):
            columns = {"t": runs[f"{run}__t"]}
            for k, joint in enumerate(SO101_JOINTS):
                columns[f"q.{joint}"] = runs[f"{run}__q"][:, k]
                columns[f"q_ref.{joint}"] = runs[f"{run}__q_cmd"][:, k]
            paths.append(_written(folder / f"{run}.npz", columns))
    return tuple(paths)


WRITERS: dict[str, Callable[[Path], tuple[Path, ...]]] = {
    "xl330": write_xl330_logs,
    "odrive_cogging": write_odrive_logs,
    "sts3215": write_sts3215_log,
    "so101": write_so101_logs,
}


if __name__ == "__main__":
    try:
        to = chosen_folder(__doc__, "real")
        for name, write in WRITERS.items():
            for path in write(to / name):
                print(path)
    except LogError as error:
        sys.exit(str(error))
