"""What the measurement of a first run compares. Oracle: numba's own files, and the friction that the recording has."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks import first_run
from benchmarks.diagnosis_cost import Cost
from identification.data.reading import read_recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

pytestmark = pytest.mark.whole


def test_the_recording_is_that_of_the_rod_with_friction(tmp_path):
    _, robot_file, log, *_ = first_run.words_for(1, tmp_path)
    robot = load_robot(robot_file)
    recording = read_recording(log, robot)
    speed = np.gradient(recording.q, recording.t, axis=0)
    motion = Motion(recording.t, recording.q, speed, np.gradient(speed, recording.t, axis=0))
    left = (recording.tau - inverse_dynamics(robot, motion)) * np.sign(speed)
    assert np.median(left) == pytest.approx(0.4, abs=0.01)


def test_only_the_first_of_two_runs_finds_an_empty_folder(monkeypatch, capsys):
    seen = []

    def fresh(words):
        seen.append((first_run.os.environ["NUMBA_CACHE_DIR"], words[2]))
        return Cost(1.0, 12.0 if len(seen) == 1 else 3.0, 100.0)

    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.setattr(first_run, "fresh_process", fresh)
    monkeypatch.setattr("sys.argv", ["first_run.py"])
    first_run.main()
    assert len({folder for folder, _ in seen}) == 1
    assert [command for _, command in seen] == ["diagnose", "diagnose"]
    assert "9.0 s more: reached" in capsys.readouterr().out
