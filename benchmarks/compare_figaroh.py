"""Compare FIGAROH 1.0.2 and this library on the same samples of a UR10.

    python benchmarks/compare_figaroh.py

The script prints a table, and exits with 1 if a goal is missed. The first call installs FIGAROH into an environment of
its own; if that fails, one sentence says so and the exit code is 0. Both sides run alternately in processes of their
own, with one thread for linear algebra, after a first run on a few samples. Seconds are medians of processor time. Both
have to find the same number of base parameters and the same residual, or the comparison fails.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.comparison import (
    NotInstalled,
    Row,
    environment,
    less_than,
    missed,
    more_than,
    own,
    several_sines,
    table,
    worker,
)
from benchmarks.core_speed import core_rows
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot
from phantom_dyn.model.robot_files import examples_folder, find_example

ROBOT, SAMPLES, RATE_HZ, NOISE = "example:ur10", 15_000, 500.0, 0.1
REQUIREMENT = "figaroh==1.0.2"
FRICTION = {"viscous_friction": 3.0, "coulomb_friction": 5.0, "torque_offset": 0.2}
"""Effects of FIGAROH's ``friction`` and ``joint_offset``, and their sizes on every joint."""

FASTER, SHARE = 10.0, 1 / 3
_SAME = 1e-6  # relative difference of the residuals of the same least-squares problem


def configuration(robot: Robot, *, friction: bool) -> str:
    """FIGAROH's configuration of a UR10 as in its example, without default values; JSON is valid YAML."""
    components = {"friction": friction, "joint_offset": friction, "actuator_inertia": False}
    problem = {"include_external_forces": False, "use_joint_torques": True, "model_components": components}
    signals = {"sampling_frequency": RATE_HZ, "cutoff_frequency": 50.0, "filter_type": "butterworth"}
    task = {"enabled": True, "problem": problem, "signal_processing": signals}
    joints = {"active_joints": list(robot.joint_names)}
    properties = {"joints": joints, "mechanics": {"reduction_ratios": [1.0] * robot.nv}}
    return json.dumps({"robot": {"name": "ur10", "properties": properties}, "tasks": {"identification": task}})


def write_recording(robot: Robot, path: Path) -> None:
    """Write samples with friction and noise, with derivatives."""
    rng = np.random.default_rng(20260101)
    motion = several_sines(robot.nv, SAMPLES, RATE_HZ, rng)
    tau = inverse_dynamics(robot, motion) + NOISE * rng.standard_normal(motion.q.shape)
    tau += FRICTION["viscous_friction"] * motion.v + FRICTION["coulomb_friction"] * np.sign(motion.v)
    np.savez(path, t=motion.t, q=motion.q, v=motion.v, a=motion.a, tau=tau + FRICTION["torque_offset"])


def packages_of(urdf: Path) -> Path:
    """Folder in which ``package://`` meshes of a robot file are found: the folder above the robot packages."""
    above = [folder for folder in urdf.parents if (folder / "example-robot-data").is_dir()]
    return above[0] if above else urdf.parent


def measured(python: Path, robot: Robot, folder: Path, *, friction: bool, repeats: int) -> list[dict[str, Any]]:
    """Medians of both sides, which run alternately; memory is the smallest of each.

    Raises:
        RuntimeError: If they did not solve the same problem.
    """
    recording, config = folder / "recording.npz", folder / f"config_{friction}.yaml"
    config.write_text(configuration(robot, friction=friction))
    urdf = find_example(robot.name, examples_folder())
    effects = ",".join(FRICTION) if friction else ""
    sides: tuple[list[dict[str, Any]], ...] = ([], [])
    for _ in range(repeats):
        sides[0].append(worker(python, "figaroh_worker.py", urdf, packages_of(urdf), recording, config))
        sides[1].append(own("own_worker.py", "fit", ROBOT, recording, effects))
    theirs, ours = ({key: statistics.median(run[key] for run in side) for key in side[0]} for side in sides)
    if theirs["rank"] != ours["rank"] or abs(theirs["rms"] - ours["rms"]) > _SAME * ours["rms"]:
        raise RuntimeError(
            f"Not the same problem: {theirs['rank']:g} base parameters and a residual of {theirs['rms']:.9g} N m "
            f"against {ours['rank']:g} and {ours['rms']:.9g}."
        )
    return [theirs, ours]


def figaroh_rows(python: Path, *, repeats: int = 3) -> list[Row]:
    """Seconds and memory of both sides, without and with friction."""
    robot, rows = load_robot(ROBOT), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_recording(robot, folder / "recording.npz")
        for friction in (False, True):
            theirs, ours = measured(python, robot, folder, friction=friction, repeats=repeats)
            rows += _rows_of(theirs, ours, "with friction and offset" if friction else "rigid body")
    return rows


def _rows_of(theirs: dict[str, float], ours: dict[str, float], what: str) -> list[Row]:
    case = f"UR10, {SAMPLES} samples, {what} ({ours['rank']:g} base parameters)"
    net = [side["peak_mb"] - side["bare_mb"] for side in (theirs, ours)]
    return [
        Row(
            f"{case}: samples to least squares and deviations (ours also with the memory of the noise)",
            f"{theirs['seconds']:.2f} s, {theirs['solve']:.2f} s of it `solve()`",
            f"{ours['seconds']:.3f} s",
            *more_than(theirs["seconds"] / ours["seconds"], FASTER),
        ),
        Row(
            f"{case}: the same with deviations for white noise, as theirs",
            f"{theirs['seconds']:.2f} s",
            f"{ours['reduced']:.3f} s",
            *more_than(theirs["seconds"] / ours["reduced"], FASTER),
        ),
        Row(
            f"{case}: memory of that work, beyond imports and robot",
            f"{net[0]:.0f} MB",
            f"{net[1]:.0f} MB",
            *less_than(net[1] / net[0], SHARE, "at most a third"),
        ),
        Row(
            f"{case}: peak of the whole process",
            f"{theirs['peak_mb']:.0f} MB",
            f"{ours['peak_mb']:.0f} MB",
            *less_than(ours["peak_mb"] / theirs["peak_mb"], SHARE, "at most a third"),
        ),
    ]


def installed() -> Path:
    """Python interpreter of FIGAROH's environment.

    Raises:
        NotInstalled: If the environment cannot be created.
    """
    return environment("figaroh-1.0.2", REQUIREMENT, "figaroh.identification.base_identification")


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if a goal is missed."""
    parser = argparse.ArgumentParser(description="FIGAROH and this library on the same samples of a UR10.")
    parser.add_argument("--repeats", type=int, default=3, help="processes of each side; the median counts")
    given = parser.parse_args(arguments)
    try:
        python = installed()
    except NotInstalled as said:
        print(said)
        return 0
    rows = figaroh_rows(python, repeats=given.repeats) + core_rows()
    print(table(rows))
    return missed(rows)


if __name__ == "__main__":
    sys.exit(main())
