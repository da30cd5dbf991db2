"""Recordings of known truth, and the command run on them."""

import re
from collections.abc import Callable
from pathlib import Path

import msgspec
import numpy as np
import pytest

from diagnosis_schema import Document
from identification.cli.main import main
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS


def make_columns(
    robot_file: Path | str, *, seconds: float = 10.0, rate: float = 200.0, seed: int = 0, friction: float = 0.4
) -> dict:
    """Columns of a recording of a robot that has more Coulomb friction on every joint than its model."""
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
    tau = inverse_dynamics(robot, Motion(t, q, v, a)) + friction * np.sign(v)
    tau += 0.01 * rng.standard_normal(tau.shape)
    positions = {f"q.{joint}": q[:, k] for k, joint in enumerate(robot.joint_names)}
    return {"t": t, **positions, **{f"tau.{joint}": tau[:, k] for k, joint in enumerate(robot.joint_names)}}


def write(path: Path, columns: dict) -> Path:
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
def made_columns() -> Callable[..., dict]:
    """Makes the columns of a recording, see `make_columns`."""
    return make_columns


@pytest.fixture(scope="session")
def written() -> Callable[[Path, dict], Path]:
    """Writes columns as CSV, see `write`."""
    return write


@pytest.fixture(scope="session")
def swing(pendulum) -> dict:
    """Columns of a recording of the pendulum, 10 s at 200 Hz."""
    return make_columns(pendulum)


@pytest.fixture
def log(tmp_path, swing) -> Path:
    """The pendulum's recording as CSV."""
    return write(tmp_path / "log.csv", swing)


@pytest.fixture
def refusal(tmp_path, capsys) -> Callable[..., str]:
    """Runs diagnose with ``--out``; asserts what holds for every refusal, and returns its sentence.

    Exit code 2, nothing on standard output, one line on standard error, and no folder made. Behind unknown names
    follows a map to copy, an entry a line.
    """

    def refuse(robot: Path | str, *words: object) -> str:
        out = tmp_path / "out"
        code = main(["diagnose", str(robot), *map(str, words), "--out", str(out)])
        captured = capsys.readouterr()
        assert (code, captured.out) == (2, "")
        assert not out.exists()
        assert captured.err.startswith("phantom-dyn: ")
        sentence, announced, entries = captured.err.partition(" as columns.yaml:\n")
        assert sentence.count("\n") == (0 if announced else 1)
        assert all(re.match(r"(# )?[\w.]+: ", line) for line in entries.splitlines())
        return captured.err.removeprefix("phantom-dyn: ").rstrip("\n")

    return refuse


@pytest.fixture(scope="session")
def document() -> Callable[[str | bytes], Document]:
    """Reads the text of a ``diagnosis.json`` and asserts the contract's schema; JSON itself knows no NaN."""

    def read(text: str | bytes) -> Document:
        found = msgspec.json.decode(text, type=Document, strict=True)
        for finding in found.findings:
            total = finding.probability + sum(rival.probability for rival in finding.rivals)
            assert abs(total - 1) < 1e-9, finding
            assert finding.verdict == ("one_of" if finding.rivals else "supported")
            assert finding.gap_closed_interval[0] <= finding.gap_closed_interval[1]
        return found

    return read
