"""``phantom-dyn identify``: what it writes, what it says, and what it refuses.

Oracle: the robot that made the recordings; Pinocchio, which loads the written model.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from identification.cli.main import main
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS

WRITTEN = {"identification.json", "report.html", "corrected.urdf", "corrected.xml"}


@pytest.fixture(scope="module")
def arm() -> Path:
    """Two hinges in gravity, with friction."""
    return ROBOTS / "planar2.urdf"


@pytest.fixture(scope="module")
def columns(arm) -> dict[str, np.ndarray]:
    """A recording of the planar arm with 0.5 N m more Coulomb friction in the elbow than its file states."""
    robot, rng = load_robot(arm), np.random.default_rng(3)
    t = np.arange(0, 8, 0.005)
    w = 2 * np.pi * np.array([[0.25, 0.7], [0.35, 1.1]])
    angle = w * t[:, None, None] + rng.uniform(0, 6, (2, 2))
    q, v, a = (0.4 * wave.sum(axis=2) for wave in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    tau = inverse_dynamics(robot, Motion(t, q, v, a)) + 0.01 * rng.standard_normal(q.shape)
    tau[:, 1] += 0.5 * np.sign(v[:, 1])
    parts = {"q": q, "tau": tau}
    named = {f"{part}.{name}": x[:, k] for part, x in parts.items() for k, name in enumerate(robot.joint_names)}
    return {"t": t, **named}


@pytest.fixture(scope="module")
def recording(columns, written, tmp_path_factory) -> Path:
    return written(tmp_path_factory.mktemp("recording") / "log.csv", columns)


@pytest.fixture(scope="module")
def folder(arm, recording, tmp_path_factory) -> Path:
    """What one run of the command has written."""
    out = tmp_path_factory.mktemp("identified") / "new" / "folder"
    assert main(["identify", str(arm), str(recording), "--out", str(out)]) == 0
    return out


def test_it_writes_the_files_of_the_contract_and_leaves_nothing_else(folder):
    assert {path.name for path in folder.iterdir()} == WRITTEN


def test_the_json_holds_the_friction_that_was_there(arm, folder):
    document = json.loads((folder / "identification.json").read_text())
    assert document["schema"] == "identification/1"
    assert "elbow.coulomb_friction.torque" in json.dumps(document)


def test_the_written_model_has_the_friction_that_was_there(arm, folder):
    given, found = load_robot(arm), load_robot(folder / "corrected.urdf")
    np.testing.assert_allclose(found.coulomb_friction - given.coulomb_friction, [0.0, 0.5], atol=0.02)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--estimator", "lasso"), "Unknown estimator 'lasso': known estimators are ols"),
        (("--estimator", "didim"), "states no controller of shoulder, elbow: add controller"),
        (("--friction", "stribeck"), "unknown term 'stribeck', the terms are viscous"),
        (("--friction", ""), "word 5 of the command is empty"),
        (("--exclude", "-1:100"), "the excluded stretches leave 0 of the 1600 rows"),
        (("--hold-out", "nowhere.csv"), "nowhere.csv does not exist"),
        (("--columns", "nowhere.yaml"), "nowhere.yaml cannot be read"),
    ],
)
def test_options_that_cannot_be_met_are_refused_in_one_sentence(arm, recording, tmp_path, capsys, words, message):
    out = tmp_path / "out"
    assert main(["identify", str(arm), str(recording), *words, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not out.exists()


def test_a_recording_too_short_for_its_parameters_is_refused_with_its_band(arm, columns, written, tmp_path, capsys):
    short = written(tmp_path / "short.csv", {name: values[:300] for name, values in columns.items()})
    assert main(["identify", str(arm), str(short), "--out", str(tmp_path / "out")]) == 2
    assert "parameters of 2 joints: motion and torque stand above their noise up to" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_files_of_others_are_kept_and_a_folder_in_the_way_is_refused(arm, recording, tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "report.html").mkdir()
    assert main(["identify", str(arm), str(recording), "--out", str(tmp_path)]) == 2
    assert "report.html is a folder, wanted a file" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"notes.txt", "report.html"}
