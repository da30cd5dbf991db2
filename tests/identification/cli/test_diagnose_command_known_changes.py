"""The option --recordings of diagnose, as a user gives it."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from identification.cli.main import main

# What the pin has besides its model in both recordings, as an earlier diagnosis would have written it.
CORRECTED = """schema: phantom-dyn-model/1
robot: {source: pendulum.urdf, sha256: '0'}
effects:
- {effect: coulomb_friction, joint: pin, parameters: {torque: {value: 0.4, std: 0.01, unit: N m}}, gap_closed: 0.9}
adjusted: []
"""


@pytest.fixture
def two(tmp_path, pendulum, swing, made_columns, written):
    """The pendulum with 0.4 N m too much friction, twice; the second time it carries 1.5 kg 0.9 m below the pin."""
    # A motion of its own: noise that both recordings share would be structure.
    other = made_columns(pendulum, seed=1)
    q, t = other["q.pin"], other["t"]
    a = make_interp_spline(t, q, k=5).derivative(2)(t)
    loaded = other | {"tau.pin": other["tau.pin"] + 1.5 * 0.9**2 * a + 1.5 * 9.81 * 0.9 * np.sin(q)}
    return written(tmp_path / "a.csv", swing), written(tmp_path / "b.csv", loaded)


def stated(tmp_path, text):
    path = tmp_path / "recordings.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_what_is_known_of_all_and_of_one_recording_leaves_no_gap(two, tmp_path, pendulum):
    # Known truth: friction of the corrected model in both, and the mass in the second.
    corrected, out = tmp_path / "corrected.yaml", tmp_path / "d.json"
    corrected.write_text(CORRECTED, encoding="utf-8")
    known = stated(tmp_path, "recordings: [{file: b.csv, payload: {mass: 1.5, center: [0, 0, -0.9]}}]")
    words = ["--with", corrected, "--recordings", known, "--json", out]
    assert main(["diagnose", str(pendulum), *map(str, (*two, *words))]) == 0
    found = json.loads(out.read_text())
    assert (found["verdict"], found["findings"]) == ("no_gap", [])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("recordings: [{file: c.csv}]", "is c.csv, which is not among the recordings"),
        ("recordings: [{file: log.csv, changed: [friction]}]", "log.csv is the only recording that fits see"),
    ],
)
def test_what_cannot_be_used_is_refused(refusal, log, pendulum, tmp_path, text, message):
    assert message in refusal(pendulum, log, "--recordings", stated(tmp_path, text))


def test_recordings_by_themselves_have_nothing_between_them(refusal, log, pendulum, tmp_path):
    said = refusal(pendulum, log, "--each", "--recordings", stated(tmp_path, "recordings: []"))
    assert "--recordings was given with --each" in said
