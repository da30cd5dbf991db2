"""Recordings that are sampled slowly, fast or for long, and joints that rest. Oracle: known truth, put in."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.checks.check_recording import check_recording
from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def swings(robot: Robot, t: np.ndarray, slowest_hz: float, noise: float = 0.0) -> Recording:
    """Two sines a joint, of the given frequency and twice to three times it, with the torque that they need."""
    q, v, a = (np.zeros((len(t), robot.nv)) for _ in range(3))
    for j in range(robot.nv):
        for f in (slowest_hz, (2.1 + 0.3 * j) * slowest_hz):
            w = 2 * np.pi * f
            q[:, j] += 0.2 * np.sin(w * t + j)
            v[:, j] += 0.2 * w * np.cos(w * t + j)
            a[:, j] -= 0.2 * w**2 * np.sin(w * t + j)
    rng = np.random.default_rng(0)
    tau = inverse_dynamics(robot, Motion(t, q, v, a))
    tau += 0.01 * tau.std(axis=0) * rng.standard_normal(tau.shape)
    return Recording("log.csv", robot.joint_names, t, q + noise * rng.standard_normal(q.shape), tau)


@pytest.mark.parametrize(
    ("rate", "seconds", "slowest_hz"),
    [(1.0, 3600.0, 0.01), (10.0, 7200.0, 0.05), (20_000.0, 4.0, 1.0)],
    ids=["one hertz", "two hours", "20 kHz"],
)
def test_any_rate_that_follows_the_motion_is_fine(arm, rate, seconds, slowest_hz):
    assert check_recording(swings(arm, np.arange(int(seconds * rate)) / rate, slowest_hz), arm) == ()


def test_a_motion_that_is_sampled_too_slowly_is_told_and_is_no_standstill(arm):
    # Sines of 0.4 Hz and more, sampled once a second: the positions are those of noise.
    said = check_recording(swings(arm, np.arange(300.0), 0.4), arm)
    assert not [sentence for sentence in said if "never moves" in sentence or "no joint moves" in sentence]
    (one,) = [sentence for sentence in said if "jump about" in sentence]
    assert one.startswith("log.csv: the positions of turn, tilt, slide jump about from sample to sample")
    assert one.endswith("record with far more than 1 Hz, or move more slowly.")


def test_a_joint_that_rests_with_a_noisy_encoder_never_moves(arm, changed):
    recording = swings(arm, np.arange(4000) / 200, 0.5)
    resting = recording.q.copy()
    resting[:, 0] = 0.3 + 2e-3 * np.random.default_rng(1).standard_normal(4000)
    said = check_recording(changed(recording, q=resting), arm)
    assert any("turn never moves" in sentence for sentence in said)
