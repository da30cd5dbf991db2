"""Recordings of known truth, and the command run on them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from identification.cli.main import main
from phantom_dyn.dynamics import inverse_dynamics
from phantom_dyn.loading import load_robot
from phantom_dyn.motion import Motion

ROBOTS = Path(__file__).parents[2] / "robots"
MISSING_FRICTION = 0.4


def made_columns(robot_file: Path | str, *, seconds: float = 10.0, rate: float = 200.0, seed: int = 0) -> dict:
    """Columns of a recording of a robot that has 0.4 more Coulomb friction on every joint than its model."""
    robot = load_robot(robot_file)
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    q, v, a = (np.zeros((len(t), robot.nv)) for _ in range(3))
    for joint in range(robot.nv):
        for hz in rng.uniform(0.1, 1.0, 5):
            w, phase, size = 2 * np.pi * hz, rng.uniform(0, 2 * np.pi), 0.2 / max(hz, 0.3)
            q[:, joint] += size * np.sin(w * t + phase)
            v[:, joint] += size * w * np.cos(w * t + phase)
            a[:, joint] -= size * w**2 * np.sin(w * t + phase)
    tau = inverse_dynamics(robot, Motion(t, q, v, a)) + MISSING_FRICTION * np.sign(v)
    tau += 0.01 * rng.standard_normal(tau.shape)
    positions = {f"q.{joint}": q[:, k] for k, joint in enumerate(robot.joint_names)}
    return {"t": t, **positions, **{f"tau.{joint}": tau[:, k] for k, joint in enumerate(robot.joint_names)}}


def written(path: Path, columns: dict) -> Path:
    """A CSV of columns; nothing is rounded."""
    rows = np.column_stack(list(columns.values()))
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")
    return path


@pytest.fixture(scope="session")
def pendulum() -> Path:
    """A hanging rod, joint pin."""
    return ROBOTS / "pendulum.urdf"


@pytest.fixture(scope="session")
def arm() -> Path:
    """Joints turn, tilt and slide."""
    return ROBOTS / "arm3.urdf"


@pytest.fixture(scope="session")
def swing(pendulum) -> dict:
    """Columns of a recording of the pendulum, 10 s at 200 Hz."""
    return made_columns(pendulum)


@pytest.fixture
def log(tmp_path, swing) -> Path:
    """The pendulum's recording as CSV."""
    return written(tmp_path / "log.csv", swing)


@pytest.fixture
def refusal(tmp_path, capsys) -> Callable[..., str]:
    """Runs diagnose with ``--out``; asserts what holds for every refusal, and returns its sentence.

    Exit code 2, nothing on standard output, one line on standard error, no folder made.
    """

    def refuse(robot: Path | str, *words: object) -> str:
        out = tmp_path / "out"
        code = main(["diagnose", str(robot), *map(str, words), "--out", str(out)])
        captured = capsys.readouterr()
        assert (code, captured.out) == (2, "")
        assert not out.exists()
        assert captured.err.startswith("phantom-dyn: ")
        assert captured.err.count("\n") == 1
        return captured.err.removeprefix("phantom-dyn: ").rstrip("\n")

    return refuse
