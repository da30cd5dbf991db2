"""Transmission of one joint from a log: known truth of a simulated two-mass joint."""

from __future__ import annotations

import numpy as np
import pytest

from identification.data.log import Band, Log
from identification.data.signals import align_held_torque
from identification.diagnosis.columns.resonances import joint_response
from phantom_dyn.errors import LogError, RobotError
from phantom_dyn.haptics.device.axis import TwoMassAxis
from phantom_dyn.haptics.experiments.white_noise import simulate_white_noise
from phantom_dyn.motion import Motion

T = 1e-3
# A joint of a small arm: rotor 0.05 and link 0.2 kg m2, 800 N m/rad: it resonates at 22.5 Hz.
JOINT = TwoMassAxis(0.05, 0.2, 0.1, 0.2, 800.0, 0.3)


def log(rng, *, valid=None, torque=None) -> Log:
    """Torque of the first joint as noise that was held, taken to the instants as `identification.data.signals` does."""
    experiment = simulate_white_noise(JOINT, period=T, force=2.0, position_noise=1e-6, duration=80.0, rng=rng)
    q = np.column_stack([experiment.position, np.zeros_like(experiment.position)])
    tau = np.column_stack([experiment.force, np.ones_like(experiment.force)]) if torque is None else torque
    t = T * np.arange(len(q))
    keep = np.ones(len(t), dtype=bool) if valid is None else valid(t)
    motion = Motion(t, q, np.zeros_like(q), np.zeros_like(q))
    return Log("noise.csv", ("j1", "j2"), motion, align_held_torque(tau), Band(1 / T, 50.0, np.ones(1), 1), keep, q)


def test_only_the_longest_valid_stretch_is_used(rng):
    # Known truth: half of the recording is excluded, and what is there is left alone.
    given = log(rng, valid=lambda t: (t > 20.0) | (t < 5.0))
    broken = given.motion.q.copy()
    broken[given.motion.t < 5.0] = 1e3
    excluded = Log(given.file, given.joint_names, given.motion, given.tau, given.band, given.valid, broken)
    np.testing.assert_array_equal(joint_response(excluded, "j1").response, joint_response(given, "j1").response)


def test_response_ends_at_a_fifth_of_the_rate(rng):
    assert joint_response(log(rng), "j1").frequency[-1] <= 2 * np.pi * 200.0


def test_an_unknown_joint_is_refused(rng):
    with pytest.raises(RobotError, match=r"noise\.csv has no joint 'elbow': it has j1, j2"):
        joint_response(log(rng), "elbow")


def test_a_constant_torque_is_refused(rng):
    with pytest.raises(LogError, match="the torque of j2 never changes: drive it with noise or a chirp"):
        joint_response(log(rng), "j2")


def test_too_short_a_stretch_is_refused(rng):
    with pytest.raises(LogError, match="longest valid stretch has 100 samples"):
        joint_response(log(rng, valid=lambda t: t < 99.5 * T), "j1")
