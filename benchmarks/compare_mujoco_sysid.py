"""Compare MuJoCo's toolbox for system identification and this library on the toolbox's own arm of five joints.

    python benchmarks/compare_mujoco_sysid.py

Both get the same two seconds of noisy positions, speeds and torques and the same model. They identify the armature of
every joint, as the toolbox's own test does, and then armature and damping. The torque of another motion is predicted
with both results. The toolbox simulates with the same simulator that made the recording, and may not converge from a
start farther away than in its test; this library knows how that simulator's step uses the speed. The script prints a
table and exits with 1 if this library is slower. The first call installs the toolbox into an environment of its own; if
that fails, one sentence says so and the exit code is 0.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

if __package__ in (None, ""):  # called by its path: the checkout is not on the module path
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks.comparison import NotInstalled, Row, environment, missed, more_than, own, table, worker
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot, position_limits
from phantom_dyn.motion import Motion

REQUIREMENT = "mujoco[sysid]>=4.0,<5"
CONFIG = "torque_hold: instant\n"
"""In this simulator, the second difference of positions around a time results exactly from the torque of that time, so
it is not half a sample late as for a held torque."""


def held_out_error(robot: Robot, values: dict[str, float], path: Path) -> float:
    """Root mean square error of the torque of another motion divided by that torque [%], for the worst joint.

    Args:
        robot: Model from which the identification started.
        values: Armature and damping of every joint; missing ones are those of the model.
        path: File with exact positions, speeds and torques.
    """
    log = np.load(path)
    rate = 1.0 / (log["t"][1] - log["t"][0])
    # A step's torque acts on the state before it; damping acts on the speed after it.
    a = np.diff(log["v"], axis=0) * rate
    motion = Motion(log["t"][:-1], log["q"][:-1], log["v"][:-1], a)
    stated = {"armature": robot.rotor_inertia, "damping": robot.viscous_friction}
    armature, damping = (
        np.array([values.get(f"{f}.{joint}", stated[f][k]) for k, joint in enumerate(robot.joint_names)])
        for f in ("armature", "damping")
    )
    modelled = inverse_dynamics(robot, motion) - robot.viscous_friction * motion.v - robot.rotor_inertia * a
    error = modelled + armature * a + damping * log["v"][1:] - log["tau"][:-1]
    lower, upper = position_limits(robot)
    free = ((motion.q > lower) & (motion.q < upper)).all(axis=1)  # contact with a joint limit adds torque
    return 100 * float(np.max(np.sqrt(np.mean(error[free] ** 2, axis=0) / np.mean(log["tau"] ** 2, axis=0))))


def worst(values: dict[str, float], truth: dict[str, float]) -> float:
    """Largest relative error of a parameter [%]."""
    return 100 * max(abs(values[name] / true - 1) for name, true in truth.items())


def mujoco_rows(python: Path) -> list[Row]:
    """Seconds, error of the parameters, and error of the predicted torque."""
    return [row for fields in (("armature",), ("armature", "damping")) for row in _rows_of(python, fields)]


def _rows_of(python: Path, fields: tuple[str, ...]) -> list[Row]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        theirs = worker(python, "mujoco_sysid_worker.py", folder, *fields)
        (folder / "robot.yaml").write_text(CONFIG)
        ours = own("own_worker.py", "arm", folder / "arm.xml", folder / "fit.npz", *fields)
        robot = load_robot(folder / "arm.xml")
        torque = [held_out_error(robot, side["values"], folder / "held_out_exact.npz") for side in (theirs, ours)]
    off = [worst(side["values"], theirs["truth"]) for side in (theirs, ours)]
    work = f"MuJoCo's arm of five joints, 2 s at 500 Hz: {' and '.join(fields)}"
    return [
        Row(
            work,
            f"{theirs['seconds']:.2f} s",
            f"{ours['seconds']:.3f} s",
            *more_than(theirs["seconds"] / ours["seconds"], 1.0),
        ),
        _nearer(f"{work}, largest error of a parameter", off),
        _nearer(f"{work}, error of the torque of another motion", torque),
    ]


def _nearer(what: str, percent: list[float]) -> Row:
    return Row(
        what,
        f"{percent[0]:.2g} %",
        f"{percent[1]:.2g} %",
        f"{percent[1] / percent[0]:.2g} of theirs",
    )


def installed() -> Path:
    """Python interpreter of the toolbox's environment.

    Raises:
        NotInstalled: If the environment cannot be created.
    """
    return environment("mujoco-sysid-4", REQUIREMENT, "mujoco.sysid")


def main() -> int:
    """Print the table; return 1 if a goal is missed."""
    try:
        rows = mujoco_rows(installed())
    except NotInstalled as said:
        print(said)
        return 0
    print(table(rows))
    return missed(rows)


if __name__ == "__main__":
    sys.exit(main())
