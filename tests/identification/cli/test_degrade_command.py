from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from identification.cli.main import main
from identification.data.readers.read_table import read_table
from identification.data.reading import read_recording
from identification.pipeline import diagnose
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.motion import Motion
from places import ROBOTS

pytestmark = pytest.mark.whole

ARM = ROBOTS / "planar2.urdf"


@pytest.fixture(scope="module")
def clean(tmp_path_factory, written) -> Path:
    """A recording of the planar arm without a gap: 20 s at 250 Hz, noise on encoders and torques."""
    robot, rng = load_robot(ARM), np.random.default_rng(5)
    t = np.arange(5000) / 250.0
    w = 2 * np.pi * np.array([[0.23, 0.61, 1.13], [0.30, 0.72, 1.04]])
    size = np.array([[0.55, 0.35, 0.25], [0.6, 0.4, 0.2]])
    angle = w * t[:, None, None] + rng.uniform(0, 2 * np.pi, (2, 3))
    q, v, a = ((size * wave).sum(axis=2) for wave in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    tau = inverse_dynamics(robot, Motion(t, q, v, a)) + 0.02 * rng.standard_normal(q.shape)
    q = q + 1e-5 * rng.standard_normal(q.shape)
    columns = {"t": t}
    for name, values in (("q", q), ("tau", tau)):
        columns |= {f"{name}.{joint}": values[:, k] for k, joint in enumerate(robot.joint_names)}
    return written(tmp_path_factory.mktemp("clean") / "clean.csv", columns)


def degraded(clean: Path, out: Path, *words: str) -> int:
    return main(["degrade", str(ARM), str(clean), *words, "--out", str(out)])


@pytest.mark.parametrize(
    ("effect", "joint", "settings"),
    [
        ("coulomb_friction", "elbow", ["torque=0.3"]),
        ("cogging", "elbow", ["order=12", "amplitude=0.15", "phase=0.5"]),
        ("torque_constant", "shoulder", ["ratio=0.8"]),
        ("input_delay", "elbow", ["delay=0.006"]),
        ("backlash", "elbow", ["gap=0.002"]),
    ],
)
def test_the_diagnosis_finds_what_was_degraded(clean, tmp_path, effect, joint, settings):
    # Known truth: what was put in, and nothing else.
    out = tmp_path / "cheap.csv"
    assert degraded(clean, out, "--effect", effect, "--joint", joint, "--set", *settings) == 0
    robot = load_robot(ARM)
    found = diagnose(robot, (read_recording(out, robot),)).findings
    assert [(finding.effect, finding.joint) for finding in found] == [(effect, joint)]
    value, truth = next(iter(found[0].parameters.values())).value, float(settings[0].partition("=")[2])
    assert np.ravel(value)[0] == pytest.approx(truth, rel=0.1)


def test_groups_say_what_belongs_together(clean, tmp_path):
    # Known truth: the torque offset of each joint.
    groups = []
    for joint, torque in (("shoulder", "0.5"), ("elbow", "-0.25")):
        groups += ["--effect", "torque_offset", "--joint", joint, "--set", f"torque={torque}"]
    assert degraded(clean, tmp_path / "cheap.npz", *groups) == 0
    before, after = (read_table(path).columns for path in (clean, tmp_path / "cheap.npz"))
    assert list(after) == list(before)
    np.testing.assert_allclose(after["tau.shoulder"] - before["tau.shoulder"], -0.5, atol=1e-12)
    np.testing.assert_allclose(after["tau.elbow"] - before["tau.elbow"], 0.25, atol=1e-12)


def test_it_says_what_it_changed(clean, tmp_path, capsys):
    degraded(clean, tmp_path / "cheap.parquet", "--effect", "torque_offset", "--joint", "elbow", "--set", "torque=0.25")
    assert capsys.readouterr().out.splitlines() == [
        "tau.elbow changed by 0.25 rms",
        f"wrote {tmp_path / 'cheap.parquet'}",
    ]


OFFSET = ["--effect", "torque_offset", "--joint", "elbow", "--set", "torque=0.3"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "no --effect was given"),
        (["--joint", "elbow"], "--joint stands before any --effect"),
        ([*OFFSET, "--joint", "shoulder"], "--effect torque_offset has two joints: give --effect again"),
        ([*OFFSET, "--set", "torque=0.2"], "--set torque is given twice for torque_offset"),
        (["--effect", "torque_offset", "--set", "0.3"], "--set 0.3 was given, wanted name=value such as torque=0.3"),
        (["--effect", "torque_offset", "--set", "torque=much"], "--set torque=much was given, wanted name=value"),
        (["--effect", "stiction", "--joint", "elbow"], "Unknown effect 'stiction': the effects are viscous"),
        (["--effect", "backlash", "--joint", "wrist"], "backlash needs a place and 'wrist' was given"),
        (
            ["--effect", "backlash", "--joint", "elbow", "--set", "width=1"],
            "backlash has no parameter 'width': the parameters of backlash are gap [rad] of 0 or more",
        ),
    ],
)
def test_a_refusal_is_one_sentence_and_writes_nothing(clean, tmp_path, capsys, words, sentence):
    assert degraded(clean, tmp_path / "cheap.csv", *words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"phantom-dyn: {sentence}")
    assert captured.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_the_recording_itself_is_not_written_over(clean, capsys):
    before = clean.read_bytes()
    assert degraded(clean, clean, *OFFSET) == 2
    assert "is the LOG itself" in capsys.readouterr().err
    assert clean.read_bytes() == before


def test_a_format_that_is_not_written_is_refused_before_any_work(clean, tmp_path, capsys):
    assert degraded(clean, tmp_path / "cheap.bag", *OFFSET) == 2
    assert "wanted a log that ends in .csv, .npz, .parquet" in capsys.readouterr().err


def test_help_and_early_refusals_import_nothing_heavy(clean, tmp_path):
    script = (
        "import sys; from identification.cli.main import main; code = main(sys.argv[1:]); "
        "print(code, *sorted({'scipy', 'pinocchio', 'numba'} & set(sys.modules)), file=sys.stderr)"
    )
    for words, code in ((["--help"], "0"), ([str(ARM), "no.csv", *OFFSET, "--out", "o.csv"], "2")):
        child = subprocess.run(
            [sys.executable, "-c", script, "degrade", *words], capture_output=True, text=True, cwd=tmp_path, check=True
        )
        assert child.stderr.splitlines()[-1] == code
