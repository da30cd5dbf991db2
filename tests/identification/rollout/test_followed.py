"""Simulated windows beside the samples of the figures. Oracle: windows of known samples."""

from __future__ import annotations

import numpy as np

from identification.data.log import Band, Log
from identification.diagnosis.evidence import Evidence
from identification.rollout.compare import Rollout, WindowMotion
from identification.rollout.followed import with_followed
from identification.rollout.rollout_starts import Window
from phantom_dyn.motion import Motion


def evidence(samples: int) -> Evidence:
    none = np.zeros((samples, 1))
    return Evidence(np.arange(float(samples)), none, none, none, none, none, none, ({},))


def log() -> Log:
    """A second at 100 Hz, of which every fifth sample is drawn."""
    t, none = np.arange(101) / 100.0, np.zeros((101, 1))
    band = Band(100.0, 10.0, np.ones(1), 5)
    return Log("a.csv", ("j",), Motion(t, none, none, none), none, band, np.ones(101, dtype=bool))


def test_each_window_stands_at_its_own_samples_but_for_its_first():
    logs, read = (log(), log()), np.arange(50.0)[:, None]
    motions = (WindowMotion(Window(1, 20, 70, 0, 0), read, -read),)
    found = with_followed(evidence(42), Rollout(0.1, {}, {}, motions=motions, controlled=True), logs).followed
    assert found is not None
    assert (round(found.seconds, 9), found.controlled) == (0.49, True)
    expected = np.full(42, np.nan)
    expected[21 + np.arange(5, 14)] = 5.0 * np.arange(1, 10)
    np.testing.assert_array_equal(found.before[:, 0], expected)
    np.testing.assert_array_equal(found.after[:, 0], -expected)


def test_nothing_simulated_changes_nothing():
    given = evidence(21)
    assert with_followed(given, Rollout(None, {}, {}), (log(),)) is given
