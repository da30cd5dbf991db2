"""Recordings of known truth, the command run on them, and the contract's schema of what it writes."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import pytest

from identification.cli.main import main
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS

# The contract's diagnosis.json (schema gap-diagnosis/3) as types: every field, nothing besides.
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]
Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Regime = Literal[
    "velocity_reversal",
    "low_speed",
    "high_speed",
    "high_load",
    "high_acceleration",
    "one_direction",
    "periodic_in_angle",
    "posture",
    "saturated",
    "time_drift",
    "everywhere",
]
Effect = Literal[tuple(effect.name for effect in EFFECTS)]


class Strict(msgspec.Struct, forbid_unknown_fields=True):
    """Knows all its fields."""


class Joint(Strict):
    joint: str
    unit: Literal["N m", "N"]
    rms_before: NotNegative
    rms_after: NotNegative
    noise_floor: Positive
    hold_out_samples: Annotated[int, msgspec.Meta(ge=0)]
    rms_torque: NotNegative | None
    rms_within_tolerance: NotNegative | None
    noise_floor_interval: tuple[NotNegative, Positive] | None
    noise_floor_source: Literal["sensors", "repetitions", "none"] | None
    closed: float | None
    discrepancy: NotNegative | None


class Gap(Strict):
    closed: float | None
    interval: tuple[float, float] | None


class Value(Strict):
    value: float | list[float]
    std: float | list[float | None] | None
    unit: str


class EffectAt(Strict):
    effect: Effect
    joint: str | None


class Rival(Strict):
    effects: Annotated[list[EffectAt], msgspec.Meta(min_length=1)]
    probability: Annotated[float, msgspec.Meta(ge=0.05, le=1)]


class Finding(Strict):
    effect: Effect
    joint: str | None
    regime: Regime
    parameters: dict[str, Value]
    share: float | None
    gap_closed: float
    gap_closed_interval: tuple[float, float]
    probability: Share
    rivals: list[Rival]
    verdict: Literal["one_of", "supported"]


class Adjusted(Strict):
    quantity: str
    change: float
    tolerance: Positive
    at_limit: bool


class Where(Strict):
    joint: str | None
    regime: Regime | None
    times: list[tuple[float, float]]


class Law(Strict):
    joint: str
    inputs: list[str]
    formula: str
    gap_closed: float
    gap_closed_interval: tuple[float, float]
    valid: dict[str, tuple[float, float]]
    like: str | None


class Unexplained(Strict):
    fraction_of_explainable: Share
    structured: bool
    where: Where
    law: Law | None
    # What the rest depends on: beyond the contract, and only where there is a rest.
    dependence: dict[str, Any] | None = None


class Bound(Strict):
    effect: Effect
    joint: str | None
    parameter: str
    below: Positive
    unit: str
    of_torque: NotNegative | None


class NotTestable(Strict):
    effect: Effect
    joint: str | None
    why: str


class Gate(Strict):
    gate: str
    value: float | None
    needed: float | None
    unit: str
    passed: bool


class Entry(Strict):
    effects: list[EffectAt]
    gates: list[Gate]
    outcome: Literal["claimed", "minor", "not_claimed", "displaced"]
    instead: list[EffectAt]
    judged_by: Literal["torques", "poses", "rests"]
    figures: dict[str, float | None]


class File(Strict):
    file: str
    rms_left: dict[str, Positive]
    rms_given: dict[str, Positive]
    holds: list[str]
    lacks: list[str]
    refused: str = ""


class Document(Strict):
    schema: Literal["gap-diagnosis/3"]
    verdict: Literal["explained", "partly_explained", "unknown", "no_gap", "not_testable"]
    run: Annotated[str, msgspec.Meta(min_length=8)]
    robot: str
    gap: Gap
    joints: list[Joint]
    band_hz: tuple[float, Positive]
    findings: list[Finding]
    minor: list[Finding]
    adjusted: list[Adjusted]
    unexplained: Unexplained
    bounds: list[Bound]
    not_testable: list[NotTestable]
    data_warnings: list[str]
    next_experiment: dict[str, Any] | None
    rollout: dict[str, Any] | None
    ledger: list[Entry]
    files: list[File]
    seconds: Positive
    version: str


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
